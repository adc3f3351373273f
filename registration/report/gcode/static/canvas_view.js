// A camera on a canvas that fills its holder: sizes, the next frame, the theme. Heirs paint.
import { soon } from "gcode/soon";

export class CanvasView {
  constructor(holder, canvas, camera) {
    Object.assign(this, { holder, canvas, camera, fitted: true, listeners: [] });
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(holder);
  }

  // Pixels of the canvas to one of the page.
  get finer() { return devicePixelRatio || 1; }

  watchTheme() {
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
    new MutationObserver(() => this.draw()).observe(
      document.documentElement, { attributeFilter: ["data-theme"] });
  }

  resize() {
    const { width, height } = this.holder.getBoundingClientRect();
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

  clear(context) {
    context.setTransform(this.finer, 0, 0, this.finer, 0, 0);
    context.clearRect(0, 0, ...this.camera.size);
  }

  changed() { for (const tell of this.listeners) tell(); }
}
