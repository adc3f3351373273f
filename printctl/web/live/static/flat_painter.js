// Draws a job from above on a plain canvas, where there is no WebGL: the same numbers, the same
// choices, the same way of drawing what was executed on top of what is there.
import { Camera } from "./camera.js";
import { CanvasView } from "./canvas_view.js";
import { cssOf, hues, palette, texelOf } from "./palette.js";
import { ACT, WIDE } from "./scene.js";
import { fit, pan, startStrokes, zoom } from "./strokes.js";

const SLICE_MS = 30;
const LOOK_EVERY = 512; // moves between two looks at the clock
const USUAL_UM = 200;
const LEAST_MM = 0.5; // of a job that is fitted

export class FlatPainter extends CanvasView {
  constructor(element, { onView }) {
    const canvas = document.createElement("canvas");
    super(element, canvas, new Camera([0, 0, 0], [1, 1, 0]));
    this.onView = onView;
    canvas.style.touchAction = "pan-y";
    element.append(canvas);
    this.pen = canvas.getContext("2d");
    startStrokes(this, { taken: () => this.held });
  }

  take(scene) {
    this.scene = scene;
  }

  get finer() { return Math.min(devicePixelRatio || 1, 2); }

  fit() {
    const { about } = this.scene;
    const places = [about.written_low_mm, about.written_high_mm, ...about.outlines.flat()];
    const ends = [0, 1].map((axis) => {
      const all = places.map((at) => at[axis]);
      const [low, high] = [Math.min(...all), Math.max(...all)];
      const spare = Math.max(LEAST_MM - (high - low), 0) / 2;
      return [low - spare, high + spare];
    });
    this.camera.low = [ends[0][0], ends[1][0], 0];
    this.camera.high = [ends[0][1], ends[1][1], 0];
    this.fitted = true;
    this.resize();
  }

  show(state) {
    this.state = state;
    this.draw();
  }

  paint() {
    cancelAnimationFrame(this.going);
    if (!this.state) return;
    this.named = hues(this.holder);
    this.colours = palette(this.state.by, this.scene.about);
    const { written, rest, travels } = this.state;
    const next = Math.max(written, this.state.next);
    this.painted = { written, next };
    this.place();
    this.pen.clearRect(0, 0, this.canvas.width, this.canvas.height);
    this.drawOutlines();
    const { moves } = this.scene;
    const jobs = [
      ...(rest ? [["ghost", written, moves]] : []), ["solid", 0, written],
      ...(travels ? [["way", 0, moves]] : []), ["next", written, next],
    ];
    this.done = false;
    this.paintSlice(jobs);
  }

  // The transformation of a point's numbers to the canvas.
  place() {
    const { low_mm: low, step_mm: step } = this.scene.about;
    const { target, size } = this.camera;
    const px = this.camera.scale * this.finer;
    this.x = [px * step[0], px * (low[0] - target[0]) + (size[0] * this.finer) / 2];
    this.y = [-px * step[1], px * (target[1] - low[1]) + (size[1] * this.finer) / 2];
  }

  paintSlice(jobs) {
    const end = performance.now() + SLICE_MS;
    while (jobs.length && performance.now() < end) {
      const [look, first, last] = jobs[0];
      const at = this.stroke(look, first, last, end);
      if (at >= last) jobs.shift();
      else jobs[0][1] = at;
    }
    this.onView(this);
    if (jobs.length) {
      this.going = requestAnimationFrame(() => this.paintSlice(jobs));
      return;
    }
    this.done = true;
    if (this.onDone) this.onDone();
    this.advance(this.state);
  }

  // Strokes moves until the last, or until the time is over; returns how far it came.
  stroke(look, first, last, end = Infinity) {
    const { points } = this.scene;
    const [low, high] = this.state.layers;
    const { pen, x, y } = this;
    let style = "";
    let i = first;
    let joined = false;
    pen.lineCap = "round";
    pen.beginPath();
    for (; i < last; i++) {
      if (i % LOOK_EVERY === LOOK_EVERY - 1 && performance.now() > end) break;
      const at = WIDE * (i + 1);
      const act = points[at + 7];
      const layer = points[at + 3];
      const fits = (act === ACT.WRITE) === (look !== "way") && act !== ACT.JUMP;
      if (!fits || layer < low || layer > high) {
        joined = false;
        continue;
      }
      const wanted = this.styleOf(look, at);
      if (wanted !== style) {
        pen.stroke();
        pen.beginPath();
        this.dip(look, at);
        [style, joined] = [wanted, false];
      }
      if (!joined) {
        pen.moveTo(x[0] * points[at - WIDE] + x[1], y[0] * points[at - WIDE + 1] + y[1]);
      }
      pen.lineTo(x[0] * points[at] + x[1], y[0] * points[at + 1] + y[1]);
      joined = true;
    }
    pen.stroke();
    return i;
  }

  // One number for colour and width, so that moves alike are stroked together.
  styleOf(look, at) {
    if (look !== "solid") return look;
    const { points } = this.scene;
    const wide = Math.round(Math.log2(1 + points[at + 6]) * 4);
    return `${texelOf(this.colours, points[at + this.colours.column])} ${wide}`;
  }

  dip(look, at) {
    const { points } = this.scene;
    const um = points[at + 6] || USUAL_UM;
    const true_px = um * 1e-3 * this.camera.scale * this.finer;
    this.pen.lineWidth = look === "solid" ? Math.max(true_px, 1.2) : look === "next" ? 2 : 1;
    this.pen.strokeStyle = look === "solid"
      ? cssOf(this.colours, texelOf(this.colours, points[at + this.colours.column]))
      : this.named[look].text;
  }

  drawOutlines() {
    this.pen.strokeStyle = this.named.rim.text;
    this.pen.lineWidth = this.finer;
    for (const line of this.scene.about.outlines) {
      this.pen.beginPath();
      line.forEach((at, k) => {
        const [px, py] = this.project(at).map((value) => value * this.finer);
        if (k) this.pen.lineTo(px, py);
        else this.pen.moveTo(px, py);
      });
      this.pen.stroke();
    }
  }

  advance(state) {
    this.state = state;
    if (!this.done) return;
    const { written, next } = this.painted;
    const ahead = Math.max(state.next, state.written);
    if (state.written < written || ahead < next || state.written - written > 32768) {
      this.draw();
      return;
    }
    if (ahead === next && state.written === written) return;
    this.stroke("solid", written, state.written);
    this.stroke("next", state.written, ahead);
    this.painted = { written: state.written, next: ahead };
  }

  project(place) { return [this.camera.u(...place), this.camera.v(...place)]; }

  look() { fit(this); }
  hold(held) {
    this.held = held;
    this.canvas.style.touchAction = held ? "none" : "pan-y";
  }
  orbit(across, up) { pan(this, -60 * across, -60 * up); }
  pan(across, up) { pan(this, -across, up); }
  zoom(factor) { zoom(this, factor); }

  dispose() {
    this.observer.disconnect();
    cancelAnimationFrame(this.going);
    this.state = null;
    this.canvas.remove();
  }
}
