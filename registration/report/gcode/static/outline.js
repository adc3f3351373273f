// The design's outline in a layer, coloured by how far ink lies beyond it (see outline_pack.py
// beside this folder), and seams: where closed lines begin and end.
import { mix } from "gcode/colours";
import { ACT, integers, summed } from "gcode/moves";
import { unpack } from "report/unpack";

const BINS = 31;
const RIM_PX = 4.6;
const LINE_PX = 2.8;
const SEAM_PX = 2.4;

export class Outlines {
  constructor(said) {
    Object.assign(this, said);
    this.data = document.querySelectorAll("script.outline");
    this.table = Array.from({ length: BINS }, (_, i) => mix(this.scale, i / (BINS - 1)));
  }

  async get(k) {
    const n = this.points[k];
    if (!n) return null;
    const bytes = await unpack(this.data[k].textContent, Uint8Array);
    const [x, y] = [0, 1].map((axis) => Float32Array.from(
      summed(integers(bytes.subarray(4 * n * axis, 4 * n * (axis + 1)), n)), (um) => um / 1000));
    return { n, x, y, begins: bytes.subarray(8 * n, 9 * n),
      beyond: new Int16Array(bytes.slice(9 * n).buffer) };
  }

  // A dark rim, so that pale colours are seen on lines and between them; the colours over it.
  draw({ context, camera, theme }, rings, z) {
    const { n, x, y, begins, beyond } = rings;
    const paths = Array.from({ length: BINS }, () => new Path2D());
    const rim = new Path2D();
    let [u, v] = [0, 0];
    for (let i = 0; i < n; i++) {
      const [a, b] = [camera.u(x[i], y[i], z), camera.v(x[i], y[i], z)];
      if (begins[i]) rim.moveTo(a, b);
      else {
        rim.lineTo(a, b);
        const path = paths[this.bin(beyond[i])];
        path.moveTo(u, v);
        path.lineTo(a, b);
      }
      [u, v] = [a, b];
    }
    Object.assign(context, { lineJoin: "round", lineCap: "butt", lineWidth: RIM_PX,
      strokeStyle: theme.ink });
    context.stroke(rim);
    context.lineWidth = LINE_PX;
    paths.forEach((path, k) => { context.strokeStyle = this.table[k]; context.stroke(path); });
  }

  bin(um) {
    const share = (um + this.limit) / (2 * this.limit);
    return Math.round(Math.min(Math.max(share, 0), 1) * (BINS - 1));
  }

  legend() {
    const box = document.createElement("div");
    const [title, ramp, ticks] = ["p", "div", "div"].map((tag) => document.createElement(tag));
    [title.className, ramp.className, ticks.className] = ["legend-title", "ramp", "ticks"];
    title.textContent = "Ink beyond the design’s outline / µm";
    ramp.style.background = `linear-gradient(to right, ${this.scale.join(", ")})`;
    [`−${this.limit}, lumen wider`, "0", `${this.limit}, narrower`].forEach((text, k) => {
      const tick = document.createElement("span");
      tick.textContent = text;
      tick.style.left = `${50 * k}%`;
      ticks.append(tick);
    });
    box.append(title, ramp, ticks);
    return box;
  }
}

export function drawSeams({ context, camera, theme }, { chunk, first, last }) {
  const close = (run) => {
    const [from, to] = run;
    const wide = chunk.width[from + 1] || 0;
    if (to - from < 3) return;
    if (Math.hypot(chunk.x[to] - chunk.x[from], chunk.y[to] - chunk.y[from]) > wide) return;
    context.beginPath();
    context.arc(camera.u(chunk.x[from], chunk.y[from], chunk.z[from]),
      camera.v(chunk.x[from], chunk.y[from], chunk.z[from]), SEAM_PX, 0, 2 * Math.PI);
    context.fill();
    context.stroke();
  };
  Object.assign(context, { fillStyle: theme.ink, strokeStyle: theme.paper, lineWidth: 1 });
  let from = -1;
  for (let i = Math.max(first, 1); i <= last; i++) {
    const writes = i < last && chunk.act[i] === ACT.WRITE;
    if (writes && from < 0) from = i - 1;
    if (!writes && from >= 0) { close([from, i - 1]); from = -1; }
  }
}
