// Draws a job from above on a plain canvas, where there is no WebGL: the same numbers, the same
// choices, the same way of drawing what was executed on top of what is there.
import { cssOf, hues, palette, texelOf } from "./palette.js";
import { ACT, WIDE } from "./scene.js";

const SLICE_MS = 30;
const LOOK_EVERY = 512; // moves between two looks at the clock
const USUAL_UM = 200;

export class FlatPainter {
  constructor(element, { onView }) {
    this.element = element;
    this.onView = onView;
    this.canvas = document.createElement("canvas");
    this.canvas.style.touchAction = "pan-y";
    element.append(this.canvas);
    this.pen = this.canvas.getContext("2d");
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(element);
    this.fingers = new Map();
    this.listen();
  }

  take(scene) {
    this.scene = scene;
  }

  listen() {
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      this.fingers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    this.canvas.addEventListener("pointermove", (event) => this.drag(event));
    for (const name of ["pointerup", "pointercancel"]) {
      this.canvas.addEventListener(name, (event) => this.fingers.delete(event.pointerId));
    }
    this.canvas.addEventListener("wheel", (event) => {
      if (!this.held) return;
      event.preventDefault();
      this.zoom(event.deltaY < 0 ? 1.15 : 1 / 1.15);
    }, { passive: false });
  }

  drag(event) {
    const before = this.fingers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const others = [...this.fingers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
    this.fingers.set(event.pointerId, now);
    const share = 1 / (1 + others.length);
    this.shift((now[0] - before[0]) * share, (now[1] - before[1]) * share);
    if (!others.length) return;
    const reach = (at) => Math.hypot(at[0] - others[0][0], at[1] - others[0][1]);
    this.zoom(reach(now) / Math.max(reach(before), 1));
  }

  fit() {
    const { about } = this.scene;
    const places = [about.written_low_mm, about.written_high_mm, ...about.outlines.flat()];
    this.low = [0, 1].map((axis) => Math.min(...places.map((at) => at[axis])));
    this.high = [0, 1].map((axis) => Math.max(...places.map((at) => at[axis])));
    this.centre = [0, 1].map((axis) => (this.low[axis] + this.high[axis]) / 2);
    this.zoomed = 1;
    this.resize();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.element;
    if (!width || !height || !this.centre) return;
    this.ratio = Math.min(window.devicePixelRatio, 2);
    this.canvas.width = width * this.ratio;
    this.canvas.height = height * this.ratio;
    const reach = [0, 1].map((axis) => Math.max(this.high[axis] - this.low[axis], 0.5) * 1.12);
    this.fitted = Math.min(width / reach[0], height / reach[1]);
    this.paint();
  }

  get scale() { return this.fitted * this.zoomed; } // CSS pixels per mm

  show(state) {
    this.state = state;
    this.redraw();
  }

  redraw() {
    if (this.waiting) return;
    this.waiting = requestAnimationFrame(() => this.paint());
  }

  paint() {
    cancelAnimationFrame(this.waiting);
    cancelAnimationFrame(this.going);
    this.waiting = 0;
    if (!this.state || !this.fitted) return;
    this.named = hues(this.element);
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
    const px = this.scale * this.ratio;
    this.x = [px * step[0], px * (low[0] - this.centre[0]) + this.canvas.width / 2];
    this.y = [-px * step[1], px * (this.centre[1] - low[1]) + this.canvas.height / 2];
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
    const true_px = um * 1e-3 * this.scale * this.ratio;
    this.pen.lineWidth = look === "solid" ? Math.max(true_px, 1.2) : look === "next" ? 2 : 1;
    this.pen.strokeStyle = look === "solid"
      ? cssOf(this.colours, texelOf(this.colours, points[at + this.colours.column]))
      : this.named[look].text;
  }

  drawOutlines() {
    this.pen.strokeStyle = this.named.rim.text;
    this.pen.lineWidth = this.ratio;
    for (const line of this.scene.about.outlines) {
      this.pen.beginPath();
      line.forEach((at, k) => {
        const [px, py] = this.project(at).map((value) => value * this.ratio);
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
      this.redraw();
      return;
    }
    if (ahead === next && state.written === written) return;
    this.stroke("solid", written, state.written);
    this.stroke("next", state.written, ahead);
    this.painted = { written: state.written, next: ahead };
  }

  project([x, y]) {
    const { clientWidth, clientHeight } = this.element;
    return [
      clientWidth / 2 + (x - this.centre[0]) * this.scale,
      clientHeight / 2 - (y - this.centre[1]) * this.scale,
    ];
  }

  shift(across, down) {
    this.centre[0] -= across / this.scale;
    this.centre[1] += down / this.scale;
    this.redraw();
  }

  look() { this.fit(); }
  hold(held) {
    this.held = held;
    this.canvas.style.touchAction = held ? "none" : "pan-y";
  }
  orbit(across, up) { this.shift(-60 * across, -60 * up); }
  pan(across, up) { this.shift(-across, up); }
  zoom(factor) {
    this.zoomed = Math.min(Math.max(this.zoomed * factor, 0.2), 500);
    this.redraw();
  }

  dispose() {
    this.observer.disconnect();
    cancelAnimationFrame(this.waiting);
    cancelAnimationFrame(this.going);
    this.canvas.remove();
  }
}
