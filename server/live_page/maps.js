// The cascades' maps: pictures that are fetched now and then, and over them, newer, what frames drew and why.

export const kActive = -1;
/// By cause, in the order in which the server names them; a hue means the same in all charts of the page.
const kHues = {
    start: "#8c8c8c", sun: "#f0e442", rebase: "#7a5c3e", jump: "#c9a0dc", scroll: "#e69f00", departure: "#d4351c",
    demotion: "#ff7f7f", level: "#00a3a3", edit: "#a6761d", arrival: "#009e73", promotion: "#86c440", active: "#2f7df6",
};
export const hueOf = (cause) => kHues[cause] ?? "#888888";

const kFadeMs = 1600;
const kUnknown = [138, 43, 160];

function grayOf(values, side) {
    const image = new ImageData(side, side);
    for (let y = 0; y < side; ++y) {
        for (let x = 0; x < side; ++x) {
            const v = values[y * side + x], at = ((side - 1 - y) * side + x) * 4;
            if (v === 255) continue;  // no caster: what is behind the canvas
            const gray = 232 - v * 0.74;
            [image.data[at], image.data[at + 1], image.data[at + 2]] = v === 0 ? kUnknown : [gray, gray, gray];
            image.data[at + 3] = 255;
        }
    }
    return image;
}

export class Maps {
    constructor(causes) {
        this.causes = causes;
        this.scroll = causes.indexOf("scroll");
        this.still = matchMedia("(prefers-reduced-motion: reduce)").matches;
        this.reset();
    }

    reset() {
        this.cascades = [];
        this.pictures = [];  // per cascade: {n, x, y, texels, near, far, canvas}
        this.asked = [];     // per cascade: a picture is on its way
        this.marks = [];     // {cascade, cause, x, y, width, height, at [ms]}
        this.seen = new Map();  // cause -> rectangles so far
    }

    nameOf(cause) { return cause === kActive ? "active" : this.causes[cause]; }

    /// `at` [ms]: when the news came.
    take(news, at) {
        this.side = news.side;
        this.cascades = news.cascades;
        // Only where active casters are now: one frame's rectangles lie over those of the frame before.
        const newest = news.frames.at(-1)?.n ?? 0;
        if (newest > 0) this.marks = this.marks.filter((m) => m.cause !== kActive);
        for (const [n, cascade, cause, x, y, width, height] of news.marks) {
            if (cause !== kActive || n === newest) this.marks.push({cascade, cause, x, y, width, height, at});
            this.seen.set(cause, (this.seen.get(cause) ?? 0) + 1);
        }
        this.forget(at);
    }

    forget(at) {
        if (this.marks.some((m) => at - m.at > kFadeMs)) this.marks = this.marks.filter((m) => at - m.at <= kFadeMs);
    }

    /// Fetches the pictures that are newer than those here; `done` after each.
    fetchNew(session, done) {
        this.cascades.forEach((cascade, k) => {
            if (cascade.picture === 0 || this.asked[k] || this.pictures[k]?.n >= cascade.picture) return;
            this.asked[k] = true;
            const pictures = this.pictures;
            fetch(`/map?session=${session}&cascade=${k}`).then(async (answer) => {
                if (!answer.ok) return;
                const bytes = new Uint8Array(await answer.arrayBuffer()), end = bytes.indexOf(10);
                const picture = JSON.parse(new TextDecoder().decode(bytes.subarray(0, end)));
                picture.canvas = new OffscreenCanvas(picture.side, picture.side);
                picture.canvas.getContext("2d").putImageData(grayOf(bytes.subarray(end + 1), picture.side), 0, 0);
                pictures[k] = picture;
                done(k);
            }).catch(() => {}).finally(() => { this.asked[k] = false; });
        });
    }

    /// Draws a cascade's window, light-space y up. True while something fades.
    draw(canvas, k, now) {
        const size = canvas.width, context = canvas.getContext("2d"), cascade = this.cascades[k];
        context.clearRect(0, 0, size, size);
        if (!cascade?.drawn) return false;
        const scale = size / this.side, picture = this.pictures[k];
        const left = (x) => (x - cascade.x) * scale, top = (y, height) => size - (y + height - cascade.y) * scale;
        if (picture && picture.texels === this.side) {
            context.imageSmoothingEnabled = size < picture.side;
            context.drawImage(picture.canvas, left(picture.x), top(picture.y, this.side), size, size);
        }
        let fading = false;
        for (const m of this.marks) {
            if (m.cascade !== k) continue;
            const age = (now - m.at) / kFadeMs;
            if (age > 1) continue;
            fading = true;
            const strength = this.still ? 1 : 1 - age, hue = hueOf(this.nameOf(m.cause));
            const box = [left(m.x), top(m.y, m.height), Math.max(2, m.width * scale), Math.max(2, m.height * scale)];
            const whole = m.width * m.height >= 0.9 * this.side * this.side;
            context.fillStyle = hue;
            context.globalAlpha = strength * (m.cause === kActive ? 0.4 : whole ? 0.22 : 0.5);
            context.fillRect(...box);
            if (m.cause === this.scroll) continue;  // strips lie side by side: outlines would hide the map
            context.globalAlpha = strength;
            context.strokeStyle = hue;
            context.lineWidth = size > 300 ? 1.5 : 1;
            context.strokeRect(...box);
        }
        context.globalAlpha = 1;
        return fading;
    }

    /// A cascade in words.
    describe(k, newest) {
        const cascade = this.cascades[k], picture = this.pictures[k];
        if (!cascade) return "";
        if (!cascade.drawn) return "This cascade has slept from the start: nothing is drawn in it.";
        const parts = [`Serves up to ${round(cascade.split)} m from the eye; a texel is ${round(cascade.texel * 100)} cm, the window ` +
                       `${round(cascade.texel * this.side)} m wide.`];
        if (cascade.asleep) parts.push("It sleeps: nothing that it serves is in view.");
        for (const [name, texels] of [["unknown", cascade.unknown], ["stale", cascade.stale], ["lacking a chunk", cascade.missing]])
            if (texels > 0) parts.push(`${(100 * texels / this.side ** 2).toFixed(2)} % of its texels are ${name}.`);
        parts.push(picture ? `The picture is ${newest - picture.n} frames older than the rectangles; lighter is nearer the sun, ` +
                             `${round(picture.far - picture.near)} m from lightest to darkest.`
                           : "Its picture has not come yet.");
        return parts.join(" ");
    }
}

const round = (value) => value >= 100 ? value.toFixed(0) : value.toPrecision(3).replace(/\.?0+$/, "");
