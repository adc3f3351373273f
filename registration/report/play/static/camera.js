// A camera that shows all that is written as large as the stage allows, from any side.
import { Camera } from "gcode/camera";
import { ACT } from "gcode/moves";

const POINTS = 20000;
const MARGIN = 0.92;

export class SnugCamera extends Camera {
  constructor(low, high, chunk) {
    super(low, high);
    const step = Math.max(1, Math.floor(chunk.n / POINTS));
    this.points = [];
    for (let i = 1; i < chunk.n; i += step) {
      if (chunk.planned[i] !== ACT.WRITE) continue;
      for (const k of [i - 1, i]) this.points.push([chunk.x[k], chunk.y[k], chunk.z[k]]);
    }
    this.half = Math.max(...chunk.width.filter((width) => width > 0).slice(0, POINTS), 0) / 2;
  }

  fit() {
    super.fit();
    if (!this.points?.length) return;
    const [w, h] = this.size;
    const reach = [[Infinity, -Infinity], [Infinity, -Infinity]];
    for (const place of this.points) {
      [this.u(...place), this.v(...place)].forEach((at, k) => {
        reach[k][0] = Math.min(reach[k][0], at);
        reach[k][1] = Math.max(reach[k][1], at);
      });
    }
    const edge = 2 * this.half * this.scale;
    const [wide, high] = reach.map(([from, to]) => Math.max(to - from + edge, 1));
    this.pan(w / 2 - (reach[0][0] + reach[0][1]) / 2, h / 2 - (reach[1][0] + reach[1][1]) / 2);
    this.zoom(MARGIN * Math.min(w / wide, h / high), w / 2, h / 2);
  }
}
