// A view on a plain canvas: an orthographic camera, size, theme, pointer and wheel. Heirs paint.
import { ZOOM, onTheme, soon } from "viewer/page";

const DEG = Math.PI / 180;
const DRAG_DEG = 0.4; // a pixel

// Target in mm, pixels per mm and direction.
export class Camera {
  // `points` are to fill the picture, each `half` mm wide either way.
  constructor(points, { margin = 0.9, half = 0 } = {}) {
    Object.assign(this, { points, margin, half, size: [1, 1], target: [0, 0, 0], scale: 1 });
    this.look(0, 90);
    this.fit();
  }

  look(azimuth, elevation) {
    this.azimuth = azimuth;
    this.elevation = Math.min(Math.max(elevation, -90), 90);
    const [ca, sa] = [Math.cos(azimuth * DEG), Math.sin(azimuth * DEG)];
    const [ce, se] = [Math.cos(this.elevation * DEG), Math.sin(this.elevation * DEG)];
    this.right = [ca, sa, 0];
    this.up = [-sa * se, ca * se, ce];
    this.towards = [sa * ce, -ca * ce, se];
  }

  fit() {
    const axes = [this.right, this.up, this.towards];
    const spans = axes.map(([a, b, c]) => {
      let [low, high] = [Infinity, -Infinity];
      for (const [x, y, z] of this.points) {
        const along = a * x + b * y + c * z;
        if (along < low) low = along;
        if (along > high) high = along;
      }
      return [low, high];
    });
    const [wide, high] = spans.map(([from, to]) => Math.max(to - from + 2 * this.half, 1e-3));
    const middle = spans.map(([from, to]) => (from + to) / 2);
    this.target = [0, 1, 2].map((k) => axes.reduce((sum, axis, i) => sum + axis[k] * middle[i], 0));
    this.scale = this.margin * Math.min(this.size[0] / wide, this.size[1] / high);
    this.fittedScale = this.scale;
  }

  u(x, y) {
    const { right, target, scale } = this;
    return this.size[0] / 2 + scale * (right[0] * (x - target[0]) + right[1] * (y - target[1]));
  }

  v(x, y, z) {
    const { up, target, scale } = this;
    return this.size[1] / 2 - scale
      * (up[0] * (x - target[0]) + up[1] * (y - target[1]) + up[2] * (z - target[2]));
  }

  depth(x, y, z) {
    return this.towards[0] * x + this.towards[1] * y + this.towards[2] * z;
  }

  pan(du, dv) {
    this.target = this.target.map(
      (t, k) => t - (du / this.scale) * this.right[k] + (dv / this.scale) * this.up[k]);
  }

  zoom(factor, u, v) {
    const [least, most] = [ZOOM.least, ZOOM.most].map((times) => times * this.fittedScale);
    const scale = Math.min(Math.max(this.scale * factor, least), most);
    const moved = 1 - scale / this.scale;
    this.scale = scale;
    this.pan((u - this.size[0] / 2) * moved, (v - this.size[1] / 2) * moved);
  }
}

// The eight corners of a box.
export function corners(low, high) {
  return Array.from({ length: 8 }, (_, i) => low.map((value, k) => (i & (1 << k) ? high[k] : value)));
}

export class FlatView {
  constructor(element, canvas, camera) {
    Object.assign(this, { element, canvas, camera, fitted: true, held: true, listeners: [], finest: Infinity });
    this.context = canvas.getContext("2d");
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(element);
    this.endTheme = onTheme(() => this.draw());
  }

  // Whether wheel and one-finger strokes are the view's.
  hold(held) {
    this.held = held;
    this.canvas.style.touchAction = held ? "none" : "pan-y";
  }

  dispose() {
    this.observer.disconnect();
    this.endTheme();
    this.canvas.remove();
  }

  // Pixels of the canvas to one of the page.
  get finer() { return Math.min(devicePixelRatio || 1, this.finest); }

  pixelsPerMm() { return this.camera.scale; }

  project(place) { return [this.camera.u(...place), this.camera.v(...place)]; }

  onDraw(action) { this.listeners.push(action); }

  resize() {
    const { width, height } = this.element.getBoundingClientRect();
    if (!width || !height) return;
    [this.canvas.width, this.canvas.height] = [width * this.finer, height * this.finer];
    this.camera.size = [width, height];
    if (this.fitted) this.camera.fit();
    // A canvas of a new size is blank, and would be seen so until the next frame.
    this.paintNow();
  }

  draw() {
    if (this.waiting) return;
    this.waiting = true;
    soon(() => { if (this.waiting) this.paintNow(); });
  }

  paintNow() {
    this.waiting = false;
    this.paint();
  }

  // Empties the picture; from then on the page's pixels are the unit.
  clear(context = this.context) {
    context.setTransform(this.finer, 0, 0, this.finer, 0, 0);
    context.clearRect(0, 0, ...this.camera.size);
  }

  changed() { for (const action of this.listeners) action(this); }

  fit() {
    this.fitted = true;
    this.camera.fit();
    this.draw();
  }

  turn(azimuth, elevation) {
    this.camera.look(azimuth, elevation);
    this.fit();
  }

  // Moves the camera, pixels; the picture goes the other way.
  pan(across, up) {
    this.fitted = false;
    this.camera.pan(-across, up);
    this.draw();
  }

  zoom(factor, [u, v] = this.camera.size.map((x) => x / 2)) {
    this.fitted = false;
    this.camera.zoom(factor, u, v);
    this.draw();
  }

  // Pointer and wheel move the camera. `taken`: whether the wheel is the view's; `point` gets where a
  // pointer is that drags nothing; `turns`: whether the view turns, by "drag" or else by the right
  // button or Alt.
  listen({ taken = () => this.held, point = () => {}, turns = "" } = {}) {
    const held = new Map();
    const place = (event) => {
      const box = this.element.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    const on = (name, action, options) => this.element.addEventListener(name, action, options);
    on("contextmenu", (event) => turns && event.preventDefault());
    on("pointerdown", (event) => {
      if (event.isTrusted) this.element.setPointerCapture(event.pointerId);
      held.set(event.pointerId, place(event));
    });
    for (const name of ["pointerup", "pointercancel"]) on(name, (event) => held.delete(event.pointerId));
    on("pointerleave", () => point(null, null));
    on("pointermove", (event) => {
      const [before, now] = [held.get(event.pointerId), place(event)];
      if (!before) return void point(...now);
      const rotates = turns && (event.buttons === 2 || event.altKey
        || (turns === "drag" && !event.shiftKey));
      const other = held.size === 2 && [...held].find(([id]) => id !== event.pointerId)[1];
      this.drag(before, now, other, rotates);
      held.set(event.pointerId, now);
    });
    on("wheel", (event) => {
      if (!taken()) return;
      event.preventDefault();
      this.zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)), place(event));
    }, { passive: false });
    on("dblclick", () => this.fit());
  }

  // A stroke from one place to another; `other` is where a second finger is.
  drag(before, now, other, rotates) {
    const [du, dv] = [now[0] - before[0], now[1] - before[1]];
    if (other) {
      const apart = (a) => Math.hypot(a[0] - other[0], a[1] - other[1]);
      this.zoom(apart(now) / Math.max(apart(before), 1), other);
    } else if (rotates) {
      this.fitted = false;
      const { azimuth, elevation } = this.camera;
      this.camera.look(azimuth - DRAG_DEG * du, elevation + DRAG_DEG * dv);
      this.draw();
    } else this.pan(-du, dv);
  }
}
