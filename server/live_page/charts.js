// Rolling charts of the last frames, drawn by Chart.js. Frames that follow each other share a bar, so that what is drawn
// does not grow with the rate of frames; which of them do depends on their numbers alone, so bars do not flicker.
import {hueOf} from "/maps.js";

const kBars = 100;

/// Frames in groups of equal numbers of frames: [{first, frames}].
function grouped(frames, most) {
    const each = Math.max(1, Math.ceil(most / kBars)), groups = [];
    for (const frame of frames) {
        const key = Math.floor(frame.n / each);
        if (groups.at(-1)?.key !== key) groups.push({key, first: frame.frame, frames: []});
        groups.at(-1).frames.push(frame);
    }
    return groups;
}

const sum = (values) => values.reduce((a, b) => a + b, 0);
function quantile(values, q) {
    const sorted = [...values].sort((a, b) => a - b);
    return sorted.length ? sorted[Math.min(sorted.length - 1, Math.floor(q * sorted.length))] : 0;
}

export function short(value) {
    for (const [unit, name] of [[1e9, " G"], [1e6, " M"], [1e3, " k"]])
        if (value >= unit) return (value / unit).toPrecision(3).replace(/\.0+$/, "") + name;
    return value >= 100 || Number.isInteger(value) ? value.toFixed(0) : value.toPrecision(2);
}

export class Charts {
    constructor(causes, most) {
        this.most = most;
        this.names = [...causes, "active"];
        this.styled = this.names.map((name) => ({label: name, data: [], backgroundColor: hueOf(name), stack: "cost",
                                                 barPercentage: 1, categoryPercentage: 0.92}));
        const line = (label, borderColor, more) => ({label, data: [], borderColor, backgroundColor: borderColor, borderWidth: 1.6, pointRadius: 0, ...more});
        this.cost = this.make("costChart", "bar", [], {});
        this.time = this.make("timeChart", "line", [
            line("slowest of its frames", "#d4351c"), line("median", "#2f7df6"), line("GPU, median", "#009e73", {spanGaps: true})],
            {type: "logarithmic", ticks: {callback: (v) => /^0*\.?0*[125]/.test(String(v)) ? short(v) : null}});
        this.memory = this.make("memoryChart", "line", [
            line("chunks and meshes", "#2f7df6"), line("geometry on the GPU", "#e69f00")], {beginAtZero: true});
    }

    make(id, type, datasets, y) {
        return new Chart(document.getElementById(id), {
            type, data: {labels: [], datasets},
            options: {
                animation: false, responsive: true, maintainAspectRatio: false, normalized: true,
                interaction: {mode: "index", intersect: false},
                plugins: {legend: {position: "bottom", align: "start", labels: {boxWidth: 11, boxHeight: 11, padding: 10, usePointStyle: false}}},
                scales: {
                    x: {title: {display: true, text: "frame"}, grid: {display: false}, ticks: {maxTicksLimit: 8, maxRotation: 0, autoSkip: true}},
                    y: {ticks: {maxTicksLimit: 6, callback: (v) => short(v)}, ...y},
                },
            },
        });
    }

    /// Colours of text and lines, after the scheme.
    style(text, muted, line) {
        for (const chart of [this.cost, this.time, this.memory]) {
            chart.options.color = text;
            for (const axis of Object.values(chart.options.scales)) {
                axis.ticks.color = muted;
                axis.title = {...axis.title, color: muted};
                axis.grid = {...axis.grid, color: line, borderColor: line};
            }
        }
    }

    /// Redraws all. What the charts say in words comes back.
    draw(frames, unit) {
        const groups = grouped(frames, this.most), labels = groups.map((g) => g.first);
        const each = Math.max(1, Math.ceil(this.most / kBars));
        const mean = this.names.map((_, c) => groups.map((g) => sum(g.frames.map((f) => f[unit][c])) / g.frames.length));
        this.styled.forEach((set, c) => { set.data = mean[c]; });
        this.cost.data.labels = labels;
        this.cost.data.datasets = this.styled.filter((set) => set.data.some((v) => v > 0));
        const bars = groups.map((_, k) => sum(mean.map((values) => values[k])));
        const top = quantile(bars, 0.95) * 1.3, cut = bars.filter((b) => b > top).length;
        this.cost.options.scales.y.max = cut > 0 && top > 0 ? top : undefined;
        this.cost.update("none");

        this.time.data.labels = labels;
        const positive = (v) => v > 0 ? v : null;
        this.time.data.datasets[0].data = groups.map((g) => positive(Math.max(...g.frames.map((f) => f.ms))));
        this.time.data.datasets[1].data = groups.map((g) => positive(quantile(g.frames.map((f) => f.ms), 0.5)));
        this.time.data.datasets[2].data = groups.map((g) => positive(quantile(g.frames.map((f) => f.gpu).filter((v) => v > 0), 0.5)));
        this.time.update("none");

        this.memory.data.labels = labels;
        const last = (name) => groups.map((g) => g.frames.at(-1)[name] / 2 ** 20);
        this.memory.data.datasets[0].data = last("resident");
        this.memory.data.datasets[1].data = last("geometry");
        this.memory.update("none");
        return this.words(frames, unit, each, cut, top, bars);
    }

    words(frames, unit, each, cut, top, bars) {
        if (frames.length === 0) return "No frame yet.";
        const total = sum(frames.map((f) => sum(f[unit])));
        const parts = [`The last ${frames.length} frames: ${short(total / frames.length)} ${unit} a frame; a bar is the mean of ${each} frames.`];
        const largest = this.names.map((name, c) => [name, sum(frames.map((f) => f[unit][c]))]).sort((a, b) => b[1] - a[1])[0];
        if (total > 0) parts.push(`Most for ${largest[0]} (${(100 * largest[1] / total).toFixed(0)} %).`);
        if (cut > 0 && top > 0) parts.push(`${cut} taller ${cut === 1 ? "bar is" : "bars are"} cut off, the tallest at ${short(Math.max(...bars))}.`);
        if (unit === "texels") parts.push("“active” are texels restored in the working maps under what moves; the rest is redrawn in the cache.");
        return parts.join(" ");
    }
}
