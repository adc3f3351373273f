// Draws a job from above on a plain canvas, where there is no WebGL: the same numbers, the same
// choices, the same way of drawing what was executed on top of what is there.
import { Camera, FlatView, corners } from "viewer/flat";
import { ACT, LinePainter } from "viewer/lines";
import { hues } from "viewer/page";
import { cssOf } from "viewer/scale";
import { COLUMN, HUES, TEXELS, USUAL_UM, WIDE, painted, partsOf, placesOf } from "live/scene";

const SLICE_MS = 30;
const BLOCK = 512; // moves between two looks at the clock
const LEAST_MM = 0.5; // of a job that is fitted
const SAME_PX = 0.25; // widths that are drawn as one
const MAX_ON_TOP = 32768; // moves that are drawn over the picture at once

export class FlatPainter extends FlatView {
  constructor(element, { onView }) {
    const canvas = document.createElement("canvas");
    super(element, canvas, new Camera(corners([0, 0, 0], [1, 1, 0])));
    Object.assign(this, { onView, finest: 2, lines: new LinePainter(this.context, this.camera) });
    element.append(canvas);
    this.hold(false);
    this.listen();
  }

  take(scene) {
    this.scene = scene;
    const { points, moves, about } = scene;
    this.rows = { n: moves + 1 };
    for (const [name, k] of Object.entries(COLUMN)) {
      const [low, step] = [about.low_mm[k] ?? 0, about.step_mm[k] ?? 1];
      const column = new Float32Array(moves + 1);
      for (let i = 0; i <= moves; i++) column[i] = low + step * points[WIDE * i + k];
      this.rows[name] = column;
    }
    this.rows.width = this.rows.width.map((um) => (um || USUAL_UM) / 1000);
    const ends = [0, 1].map((axis) => {
      const all = placesOf(about).map((at) => at[axis]);
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
    const { written } = this.state;
    const next = Math.max(written, this.state.next);
    this.painted = { written, next };
    this.clear();
    this.drawOutlines();
    this.done = false;
    this.paintSlice([...partsOf(this.state, this.scene.moves), ["next", written, next]]);
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
    const { hueOf, state: { layers: [low, high], by, scale }, rows: { act, layer, [by]: value } } = this;
    const travels = look === "way";
    const fits = (i) => (act[i] === ACT.WRITE) !== travels && act[i] !== ACT.JUMP
      && layer[i] >= low && layer[i] <= high;
    // One pen as long as it is the same: moves alike are stroked together.
    let pen = { value: NaN, wide: NaN, hue: this.named[look], width: look === "next" ? 2 : 1 };
    const penOf = look !== "solid" ? () => pen : (i, wide) => {
      if (value[i] === pen.value && Math.abs(wide - pen.wide) < SAME_PX) return pen;
      const hue = hueOf[scale.bin(value[i], TEXELS)];
      pen = { value: value[i], wide, hue, width: Math.max(wide, 1.2) };
      return pen;
    };
    this.context.lineCap = "round";
    this.lines.strokes(this.rows, first + 1, last + 1, fits, penOf);
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

  orbit(across, up) { this.pan(60 * across, -60 * up); }

  dispose() {
    super.dispose();
    cancelAnimationFrame(this.going);
    this.state = null;
  }
}
