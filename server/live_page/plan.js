// The chunks from above, x to the right and z down, and the way of the first camera.

export const kPhases = ["away", "wanted", "loading", "coarse", "resident", "failed"];
const kWayPoints = 4000;

export class Plan {
    constructor() { this.reset(); }

    reset() {
        this.places = [];
        this.size = 0;
        this.away = 0;
        this.way = [];  // [x, z]
        this.eye = null;
        this.ahead = [0, 0];
    }

    take(news) {
        for (const frame of news.frames) {
            const [x, , z] = frame.eye, last = this.way.at(-1);
            if (!last || Math.hypot(x - last[0], z - last[1]) > 0.25) this.way.push([x, z]);
            this.eye = [x, z];
            this.ahead = frame.ahead;
        }
        if (this.way.length > kWayPoints) this.way.splice(0, this.way.length - kWayPoints);
        if (news.chunks) [this.places, this.size, this.away] = [news.chunks.places, news.chunks.size, news.chunks.away];
    }

    counts() {
        const counts = kPhases.map(() => 0);
        for (let k = 2; k < this.places.length; k += 3) ++counts[this.places[k]];
        return counts;
    }

    /// Where the picture's middle lies and how many metres it shows: all chunks that it is told of.
    extent() {
        let [x0, x1, z0, z1] = [Infinity, -Infinity, Infinity, -Infinity];
        const add = (x, z) => { x0 = Math.min(x0, x); x1 = Math.max(x1, x); z0 = Math.min(z0, z); z1 = Math.max(z1, z); };
        for (let k = 0; k < this.places.length; k += 3) {
            add(this.places[k] * this.size, this.places[k + 1] * this.size);
            add((this.places[k] + 1) * this.size, (this.places[k + 1] + 1) * this.size);
        }
        if (this.eye) add(...this.eye);
        if (!(x1 >= x0)) return {x: 0, z: 0, metres: 100};
        return {x: (x0 + x1) / 2, z: (z0 + z1) / 2, metres: Math.max(x1 - x0, z1 - z0, 20) * 1.06};
    }

    draw(canvas, colours) {
        const size = canvas.width, context = canvas.getContext("2d"), {x, z, metres} = this.extent();
        const scale = size / metres, px = (v) => size / 2 + (v - x) * scale, pz = (v) => size / 2 + (v - z) * scale;
        context.clearRect(0, 0, size, size);
        const edge = this.size * scale, gap = Math.min(2, edge * 0.08);
        for (let k = 0; k < this.places.length; k += 3) {
            const phase = kPhases[this.places[k + 2]];
            const left = px(this.places[k] * this.size) + gap / 2, top = pz(this.places[k + 1] * this.size) + gap / 2, side = edge - gap;
            context.fillStyle = colours[phase];
            context.fillRect(left, top, side, side);
            if (phase === "resident") continue;
            context.strokeStyle = phase === "failed" ? colours.text : colours.muted;
            context.lineWidth = 1;
            context.setLineDash(phase === "wanted" ? [3, 3] : []);
            context.strokeRect(left + 0.5, top + 0.5, side - 1, side - 1);
            context.setLineDash([]);
            if (phase !== "failed") continue;
            context.beginPath();
            context.moveTo(left, top);
            context.lineTo(left + side, top + side);
            context.moveTo(left + side, top);
            context.lineTo(left, top + side);
            context.stroke();
        }
        this.drawWay(context, px, pz, colours, size);
        this.drawScale(context, scale, colours, size);
    }

    drawWay(context, px, pz, colours, size) {
        if (!this.eye) return;
        context.lineJoin = "round";
        for (const [width, colour] of [[5, colours.page], [2.5, colours.text]]) {
            context.lineWidth = width;
            context.strokeStyle = colour;
            context.beginPath();
            this.way.forEach(([x, z], k) => k === 0 ? context.moveTo(px(x), pz(z)) : context.lineTo(px(x), pz(z)));
            context.stroke();
        }
        const [ex, ez] = [px(this.eye[0]), pz(this.eye[1])], r = size / 34;
        if (Math.hypot(...this.ahead) > 0) {
            const angle = Math.atan2(this.ahead[1], this.ahead[0]);
            context.fillStyle = colours.camera;
            context.globalAlpha = 0.45;
            context.beginPath();
            context.moveTo(ex, ez);
            context.arc(ex, ez, r * 2.6, angle - 0.45, angle + 0.45);
            context.fill();
            context.globalAlpha = 1;
        }
        context.beginPath();
        context.arc(ex, ez, r / 2.2, 0, 7);
        context.fillStyle = colours.camera;
        context.fill();
        context.lineWidth = 2;
        context.strokeStyle = colours.page;
        context.stroke();
    }

    drawScale(context, scale, colours, size) {
        const most = size / 4 / scale, power = 10 ** Math.floor(Math.log10(most));
        const metres = [5, 2, 1].map((f) => f * power).find((m) => m <= most), pixels = metres * scale, unit = size / 100;
        context.font = `${Math.round(size / 40)}px system-ui, sans-serif`;
        const text = `${metres} m`, width = Math.max(pixels, context.measureText(text).width);
        context.globalAlpha = 0.85;
        context.fillStyle = colours.page;
        context.fillRect(unit, size - 6.2 * unit, width + 3 * unit, 5.2 * unit);
        context.globalAlpha = 1;
        context.fillStyle = colours.text;
        context.fillText(text, 2.5 * unit, size - 3.2 * unit);
        context.fillRect(2.5 * unit, size - 2.3 * unit, pixels, Math.max(2, unit / 2.5));
    }
}
