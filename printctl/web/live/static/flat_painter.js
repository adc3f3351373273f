// Draws a job from above on a plain canvas, where there is no WebGL: the same numbers, the same
// choices, the same way of drawing what was executed on top of what is there.
import { Camera, FlatView, corners } from "viewer/flat";
import { ACT, LinePainter } from "viewer/lines";
import { hues } from "viewer/page";
import { cssOf } from "viewer/scale";
import { COLUMN, HUES, TEXELS, USUAL_UM, WIDE, painted } from "live/scene";

const SLICE_MS = 30;
const BLOCK = 512; // moves between two looks at the clock
const LEAST_MM = 0.5; // of a job that is fitted
const MAX_ON_TOP = 32768; // moves that are drawn over the picture at once

export class FlatPainter extends FlatView {
  constructor(element, { onView }) {
    const canvas = document.createElement("canvas");
    super(element, canvas, new Camera(corners([0, 0, 0], [1, 1, 0])));
    Object.assign(this, { onView, finest: 2, lines: new LinePainter(this.context, this.camera) });
    element.append(canvas);
    this.hold(false);
    this.listen({ taken: () => this.held });
  }

  take(scene) {
    this.scene = scene;
    const { points, moves, about } = scene;
    this.rows = { n: moves + 1 };
    for (const [name, k] of Object.entries(COLUMN)) {
      const [low, step] = [about.low_mm[k] ?? 0, about.step_mm[k] ?? 1];
      this.rows[name] = Float32Array.from({ length: moves + 1 },
        (_, i) => low + step * points[WIDE * i + k]);
    }
    this.rows.width = this.rows.width.map((um) => (um || USUAL_UM) / 1000);
    const places = [about.written_low_mm, about.written_high_mm, ...about.outlines.flat()];
    const ends = [0, 1].map((axis) => {
      const all = places.map((at) => at[axis]);
      const [low, high] = [Math.min(...all), Math.max(...all)];
      const spare = Math.max(LEAST_MM - (high - low), 0) / 2;
      return [low - spare, high + spare];
    });
    this.camera.points = corners([ends[0][0], ends[1][0], 0], [ends[0][1], ends[1][1], 0]);
    this.resize();
  }

  show(state) {
    this.state = state;
    this.draw();
  }

  paint() {
    cancelAnimationFrame(this.going);
    if (!this.state) return;
    this.named = hues(HUES, this.element, "--live-");
    this.hueOf = this.state.scale.table(TEXELS).map(cssOf);
    const { written, rest, travels } = this.state;
    const next = Math.max(written, this.state.next);
    this.painted = { written, next };
    this.clear();
    this.drawOutlines();
    const { moves } = this.scene;
    this.done = false;
    this.paintSlice([
      ...(rest ? [["ghost", written, moves]] : []), ["solid", 0, written],
      ...(travels ? [["way", 0, moves]] : []), ["next", written, next],
    ]);
  }

  paintSlice(jobs) {
    const end = performance.now() + SLICE_MS;
    while (jobs.length && performance.now() < end) {
      const [look, first, last] = jobs[0];
      jobs[0][1] = Math.min(first + BLOCK, last);
      this.stroke(look, first, jobs[0][1]);
      if (jobs[0][1] >= last) jobs.shift();
    }
    this.onView(this);
    if (jobs.length) {
      this.going = requestAnimationFrame(() => this.paintSlice(jobs));
      return;
    }
    this.done = true;
    this.onDone?.();
    this.advance(this.state);
  }

  // Strokes moves from 0; a move is the row after it.
  stroke(look, first, last) {
    const { rows, hueOf, state: { layers: [low, high], by, scale } } = this;
    const travels = look === "way";
    const fits = (i) => (rows.act[i] === ACT.WRITE) !== travels && rows.act[i] !== ACT.JUMP
      && rows.layer[i] >= low && rows.layer[i] <= high;
    const pen = look === "solid"
      ? (i, wide) => [hueOf[scale.bin(rows[by][i], TEXELS)], Math.max(Math.round(4 * wide) / 4, 1.2)]
      : () => [this.named[look], look === "next" ? 2 : 1];
    this.context.lineCap = "round";
    this.lines.strokes(rows, first + 1, last + 1, fits, pen);
  }

  drawOutlines() {
    Object.assign(this.context, { strokeStyle: this.named.rim, lineWidth: 1 });
    for (const line of this.scene.about.outlines) {
      this.context.beginPath();
      for (const place of line) this.context.lineTo(...this.project(place));
      this.context.stroke();
    }
  }

  advance(state) {
    this.state = state;
    const step = this.done && painted(this, MAX_ON_TOP);
    if (!step) return;
    this.stroke("solid", ...step.solid);
    this.stroke("next", ...step.next);
  }

  look() { this.fit(); }

  hold(held) {
    this.held = held;
    this.canvas.style.touchAction = held ? "none" : "pan-y";
  }

  orbit(across, up) { this.pan(60 * across, -60 * up); }

  dispose() {
    this.observer.disconnect();
    this.endTheme();
    cancelAnimationFrame(this.going);
    this.state = null;
    this.canvas.remove();
  }
}
