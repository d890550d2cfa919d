// The live page: follows one session by server-sent events, and goes on by itself where the connection was lost.
import {Charts, short} from "/charts.js";
import {hueOf, kActive, Maps} from "/maps.js";
import {kPhases, Plan} from "/plan.js";

const kFrames = 600;          // in the charts
const kSilenceMs = 12000;     // the server speaks at least every 5 s
const kTryAgainMs = 2000;
const kDrawEveryMs = 40;
const kChartsEveryMs = 500;

const at = (id) => document.getElementById(id);
const page = {
    started: null, causes: [], session: null, sessions: [], frames: [], lost: 0, chosen: null, cascade: 0, unit: "texels",
    paused: false, heardAt: performance.now(), live: false, drawnAt: 0, chartsAt: 0, dirty: true, settings: [], errors: null, maps: null, charts: null, plan: new Plan(),
};
let source = null, again = null;

// --- connection

function connect() {
    clearTimeout(again);
    source?.close();
    page.heardAt = performance.now();
    source = new EventSource("/events" + (page.chosen === null ? "" : `?session=${page.chosen}`));
    source.addEventListener("hello", (event) => hello(JSON.parse(event.data)));
    source.addEventListener("news", (event) => news(JSON.parse(event.data)));
    source.addEventListener("beat", heard);
    source.onerror = () => {
        say("lost", "disconnected; trying again");
        if (source.readyState === EventSource.CLOSED) again = setTimeout(connect, kTryAgainMs);
    };
}

function heard() { page.heardAt = performance.now(); }

function say(state, text) {
    page.live = state === "live";
    const status = at("status");
    if (status.dataset.state === state && status.textContent === text) return;
    status.dataset.state = state;
    status.textContent = text;
}

function hello(told) {
    heard();
    if (page.started !== null && page.started !== told.started) page.chosen = null;  // another process: other sessions
    if (page.started !== told.started) reset();
    page.started = told.started;
    if (!page.maps) {
        page.causes = told.causes;
        page.maps = new Maps(told.causes);
        page.charts = new Charts(told.causes, kFrames);
        colours();
    }
}

function reset() {
    page.session = null;
    page.frames = [];
    page.settings = [];
    page.plan.reset();
    page.maps?.reset();
    at("cascades").querySelectorAll("label").forEach((label) => label.remove());
    page.dirty = true;
}

function news(told) {
    heard();
    if (!page.maps) return;
    page.sessions = told.sessions;
    if (!page.paused) showSessions(told.session?.id ?? null);
    at("empty").hidden = told.session !== null;
    if (told.session === null) {
        say("live", told.sessions.length ? "live; this session has ended" : "live; no session");
        at("empty").textContent = told.sessions.length ? "This session has ended. Choose another one above; what it did last stays below."
                                                       : "No session is open. The page follows the first that opens.";
        if (told.sessions.length && page.chosen === null) connect();
        return;
    }
    if (page.session !== told.session.id) {
        reset();
        page.session = told.session.id;
    }
    const last = page.frames.at(-1)?.n ?? 0;
    told.frames = told.frames.filter((f) => f.n > last);
    say("live", "live");
    page.lost = told.lost;
    page.frames.push(...told.frames);
    page.frames.splice(0, Math.max(0, page.frames.length - kFrames));
    page.plan.take(told);
    page.maps.take(told, performance.now());
    page.maps.fetchNew(page.session, () => { page.dirty = true; });
    page.settings = told.settings ?? page.settings;
    page.errors = told.errors;
    show();
}

function show() {
    if (page.paused || page.session === null) return;
    showSettings(page.settings);
    showCascades();
    showFacts(page.errors);
    showErrors(page.errors);
    showKeys();
    page.dirty = true;
}

// --- what is shown

function element(name, text, className) {
    const made = document.createElement(name);
    if (text !== undefined) made.textContent = text;
    if (className) made.className = className;
    return made;
}

/// Replaces the content only where it is another one, so that nothing jumps under a reader.
function put(parent, key, make) {
    if (parent.dataset.key === key) return;
    parent.dataset.key = key;
    parent.replaceChildren(...make());
}

function showSessions(current) {
    const select = at("session"), list = page.sessions;
    const key = JSON.stringify([list.map((s) => [s.id, s.name, s.world]), current]);
    put(select, key, () => {
        const options = list.map((s) => {
            const option = element("option", `${s.name || "session " + s.id} on ${s.world}`);
            option.value = s.id;
            option.selected = s.id === current;
            return option;
        });
        if (current === null) options.unshift(Object.assign(element("option", list.length ? "ended" : "none"), {value: "", selected: true}));
        return options;
    });
    select.disabled = list.length === 0;
}

function showFacts(errors) {
    const frames = page.frames.slice(-100), frame = frames.at(-1);
    if (!frame) return;
    const drawn = page.maps.cascades.filter((c) => c.drawn).length, all = Math.max(1, drawn * page.maps.side ** 2);
    const mean = (f) => frames.reduce((a, b) => a + f(b), 0) / frames.length;
    const redrawn = mean((f) => f.texels.slice(0, -1).reduce((a, b) => a + b, 0));
    const median = [...frames].map((f) => f.ms).sort((a, b) => a - b)[frames.length >> 1];
    const facts = [
        ["Frame", frame.frame.toLocaleString("en"), `at ${frame.t.toFixed(2)} s of the client's time`],
        ["Redrawn", `${(100 * redrawn / all).toPrecision(2)} %`, `of the maps' texels a frame, mean of ${frames.length}`],
        ["Frame time", `${median.toPrecision(3)} ms`, `median of ${frames.length} frames`],
        ["Memory", `${((frame.resident + frame.geometry) / 2 ** 20).toFixed(1)} MiB`, "chunks, meshes, geometry"],
        ["Behind the world", frame.unknown + frame.stale === 0 ? "nothing" : `${short(frame.unknown + frame.stale)} texels`,
         `${short(frame.unknown)} unknown, ${short(frame.stale)} stale; ${frame.missing} chunks missing`],
        ["Errors", errors.count.toLocaleString("en"), errors.count ? "items left out, listed below" : "no item was left out"],
    ];
    put(at("facts"), JSON.stringify(facts), () => facts.map(([name, value, note]) => {
        const group = element("div"), dd = element("dd", value);
        dd.append(element("small", note));
        group.append(element("dt", name), dd);
        return group;
    }));
}

function showErrors(errors) {
    at("errorPart").hidden = errors.count === 0;
    put(at("errors"), JSON.stringify(errors.last), () => [...errors.last].reverse().map((text) => element("li", text)));
}

function showSettings(settings) {
    put(at("settings"), JSON.stringify(settings), () => settings.map(([name, value]) => {
        const group = element("div");
        group.append(element("dt", name), element("dd", value));
        return group;
    }));
}

function showKeys() {
    const seen = page.maps.seen, list = [...page.causes.keys(), kActive].filter((c) => seen.has(c));
    put(at("causes"), JSON.stringify(list), () => list.map((cause) => {
        const name = page.maps.nameOf(cause), item = element("li"), swatch = element("i");
        swatch.style.background = hueOf(name);
        item.dataset.cause = name;
        item.append(swatch, name === "active" ? "active casters" : name);
        return item;
    }));
    const counts = page.plan.counts(), tints = page.tints;
    if (!tints) return;
    put(at("phases"), JSON.stringify([counts, tints]), () => kPhases.slice(1).map((name, k) => {
        const item = element("li", undefined, counts[k + 1] ? "" : "off"), swatch = element("i");
        swatch.style.background = tints[name];
        swatch.style.borderColor = tints.muted;
        if (name === "wanted") swatch.style.borderStyle = "dashed";
        item.dataset.phase = name;
        item.append(swatch, `${name} ${counts[k + 1]}`);
        return item;
    }));
}

function showCascades() {
    const field = at("cascades"), labels = field.querySelectorAll("label"), cascades = page.maps.cascades;
    if (labels.length !== cascades.length) {
        labels.forEach((label) => label.remove());
        page.cascade = Math.min(page.cascade, Math.max(0, cascades.length - 1));
        const several = cascades.some((c) => c.camera > 0), each = cascades.filter((c) => c.camera === 0).length;
        cascades.forEach((cascade, k) => {
            const label = element("label"), input = element("input"), canvas = element("canvas");
            Object.assign(input, {type: "radio", name: "cascade", value: k, checked: k === page.cascade});
            input.addEventListener("change", () => { page.cascade = k; page.dirty = true; });
            canvas.width = canvas.height = 112;
            canvas.setAttribute("aria-hidden", "true");
            label.append(input, canvas, element("b", (several ? `camera ${cascade.camera}, ` : "") + `cascade ${k % each}`), element("small"));
            field.append(label);
        });
    }
    field.querySelectorAll("small").forEach((small, k) => {
        const c = cascades[k], text = (c.asleep ? "asleep" : `to ${c.split >= 10 ? c.split.toFixed(0) : c.split.toFixed(1)} m`);
        if (small.textContent !== text) small.textContent = text;
    });
}

/// What canvases cannot take from the style sheet.
function colours() {
    const style = getComputedStyle(document.documentElement), value = (name) => style.getPropertyValue("--" + name).trim();
    page.tints = {page: value("page"), text: value("text"), muted: value("muted"), camera: value("bad"), failed: value("bad"), away: "transparent"};
    for (const name of ["wanted", "loading", "coarse", "resident"]) page.tints[name] = value(name);
    page.charts?.style(value("text"), value("muted"), value("line"));
    page.dirty = true;
}

function fit(canvas) {
    const size = Math.round(canvas.clientWidth * Math.min(2, devicePixelRatio || 1));
    if (size > 0 && canvas.width !== size) canvas.width = canvas.height = size;
}

function draw(now) {
    requestAnimationFrame(draw);
    if (now - page.heardAt > kSilenceMs) {
        say("lost", "nothing heard; trying again");
        connect();
    }
    if (!page.dirty || page.paused || page.session === null || document.hidden || now - page.drawnAt < kDrawEveryMs) return;
    page.dirty = false;
    page.drawnAt = now;
    fit(at("map"));
    fit(at("plan"));
    let fading = page.maps.draw(at("map"), page.cascade, now);
    at("cascades").querySelectorAll("canvas").forEach((canvas, k) => { fading = page.maps.draw(canvas, k, now) || fading; });
    page.maps.forget(now);
    page.plan.draw(at("plan"), page.tints);
    page.dirty = fading;
    const newest = page.frames.at(-1)?.n ?? 0;
    tell("mapNote", page.maps.describe(page.cascade, newest));
    at("map").setAttribute("aria-label", `Shadow map of cascade ${page.cascade}`);
    at("plan").setAttribute("aria-label", "Plan of the chunks with the camera's path");
    const away = page.plan.away ? ` ${page.plan.away} chunks farther away are not shown.` : "";
    tell("planNote", page.plan.eye ? `Seen from above, x to the right, z down; the camera is at (${page.plan.eye.map((v) => v.toFixed(1)).join(", ")}) m.` + away : "");
    if (now - page.chartsAt < kChartsEveryMs) {
        page.dirty = true;
        return;
    }
    page.chartsAt = now;
    const words = page.charts.draw(page.frames, page.unit);
    tell("costNote", words + (page.lost ? ` ${short(page.lost)} frames came faster than the page could follow.` : ""));
    at("costChart").setAttribute("aria-label", words);
    const last = page.frames.at(-1);
    if (last) at("timeChart").setAttribute("aria-label", `Frame times; the last frame took ${last.ms.toPrecision(3)} milliseconds`);
    if (last) at("memoryChart").setAttribute("aria-label", `Memory; now ${((last.resident + last.geometry) / 2 ** 20).toFixed(1)} mebibytes`);
}

function tell(id, text) {
    if (at(id).textContent !== text) at(id).textContent = text;
}

// --- what a reader can do

at("session").addEventListener("change", (event) => {
    if (event.target.value === "") return;
    page.chosen = Number(event.target.value);
    connect();
});
at("pause").addEventListener("click", (event) => {
    page.paused = !page.paused;
    event.target.setAttribute("aria-pressed", String(page.paused));
    event.target.textContent = page.paused ? "Paused" : "Pause";
    if (!page.paused) showSessions(page.session);
    show();
});
document.querySelectorAll("input[name=unit]").forEach((input) => input.addEventListener("change", () => {
    page.unit = input.value;
    page.chartsAt = 0;
    page.dirty = true;
}));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", colours);
addEventListener("resize", () => { page.dirty = true; });

connect();
requestAnimationFrame(draw);
