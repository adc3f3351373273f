// The stage at a moment: what lies there, what is being laid, where the needle is.
import { CanvasView } from "gcode/canvas_view";
import { Painter } from "gcode/draw";
import { hues } from "gcode/hues";
import { ACT } from "gcode/moves";
import { fit } from "gcode/strokes";
import { SnugCamera } from "play/camera";
import { cutRow, layerStarts, rowAt, shareAt } from "play/data";
import { Shades } from "play/shades";

const FAINT = 0.5;

export class PlayView extends CanvasView {
  constructor(data, chunk, holder) {
    super(holder, holder.querySelector("canvas"), new SnugCamera(data.low, data.high, chunk));
    Object.assign(this, { data, chunk, passes: data.passes, turnsByDrag: true });
    this.count = data.layer_z.length;
    this.first = layerStarts(chunk, this.count);
    this.duration = chunk.time[chunk.n - 1];
    this.time = this.duration;
    this.painter = new Painter(this.canvas.getContext("2d"), this.camera, {});
    this.base = { canvas: document.createElement("canvas"), key: "" };
    this.shown = { travels: !this.passes, dots: !this.passes, faint: true };
    if (this.passes) this.camera.look(30, 30);
    this.colour(data.colourings[0].key);
    this.watchTheme();
  }

  colour(key) {
    const { colourings, scales, none } = this.data;
    this.colours = new Shades(colourings.find((one) => one.key === key) ?? colourings[0], scales, none);
    this.draw();
  }

  get whole() { return this.time >= this.duration; }

  // The row under way; once all is done the last.
  get row() { return this.whole ? this.chunk.n - 1 : rowAt(this.chunk, this.time); }

  get layer() { return this.chunk.layer[this.row]; }

  get place() {
    const part = cutRow(this.chunk, this.row, shareAt(this.chunk, this.row, this.time));
    return [part.x[1], part.y[1], part.z[1]];
  }

  get laid() {
    const { chunk, row } = this;
    const share = shareAt(chunk, row, this.time);
    return chunk.laid[row - 1] + share * (chunk.laid[row] - chunk.laid[row - 1]);
  }

  to(time) {
    this.time = Math.min(Math.max(time, 0), this.duration);
    this.draw();
  }

  // The next layer's end, or that of the one before.
  step(layers) {
    const ends = (k) => this.chunk.time[this.first[k + 1] - 1];
    const done = this.time >= ends(this.layer) - 1e-6;
    const k = this.layer + layers - (layers > 0 && !done ? 1 : 0);
    this.to(k < 0 ? 0 : ends(Math.min(k, this.count - 1)));
  }

  // To the end of a stretch: the next, or the one before.
  stretch(way) {
    const { chunk, row } = this;
    const at = way > 0 ? (chunk.time[row] > this.time ? row : row + 1) : row - 1;
    this.to(chunk.time[Math.min(Math.max(at, 0), chunk.n - 1)] + (way > 0 ? 0 : -1e-4));
  }

  fit() { fit(this); }

  paint() {
    const { painter, row } = this;
    const share = shareAt(this.chunk, row, this.time);
    painter.theme = hues();
    this.clear(painter.context);
    if (this.passes) this.paintPasses(row, share);
    else this.paintLayer(row, share);
    const from = this.passes && this.whole ? 0 : this.first[this.layer];
    if (this.shown.travels) painter.travels(this.chunk, from, row + (this.whole ? 1 : 0));
    if (this.shown.dots) painter.dots(this.chunk, this.passes ? 0 : from, row);
    if (!this.whole) this.paintNeedle();
    this.changed();
  }

  paintLayer(row, share) {
    const { painter, chunk, first, layer, colours } = this;
    const ends = [first[layer], first[layer + 1]];
    if (this.shown.faint && layer > 0) {
      painter.hairs(chunk, first[layer - 1], first[layer], painter.theme.ground, null, 1);
    }
    painter.bands(chunk, first[layer], row, colours, ends);
    painter.bands(cutRow(chunk, row, share), 1, 2, colours, [0, 2]);
  }

  // What lay before the pass is kept as a picture; the pass itself lies over it.
  paintPasses(row, share) {
    const { painter, chunk, colours, whole } = this;
    const from = this.passFrom(row);
    this.paintBase(whole ? chunk.n : from);
    const { context } = painter;
    context.save();
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.globalAlpha = this.shown.faint && !whole ? FAINT : 1;
    context.drawImage(this.base.canvas, 0, 0);
    context.restore();
    if (whole) return;
    painter.tubes([{ chunk, first: from, last: row }], colours);
    painter.tubes([{ chunk: cutRow(chunk, row, share), first: 1, last: 2 }], colours);
  }

  // Where the pass begins that is under way; while the needle goes there, the one before.
  passFrom(row) {
    const { chunk, first, layer } = this;
    for (let i = first[layer]; i <= row; i++) if (chunk.planned[i] === ACT.WRITE) return first[layer];
    return first[Math.max(layer - 1, 0)];
  }

  paintBase(last) {
    const { camera, colours, base, chunk } = this;
    const key = [last, colours.key, camera.scale, camera.azimuth, camera.elevation,
      ...camera.target, ...camera.size, this.canvas.width, this.painter.theme.rim].join();
    if (key === base.key) return;
    base.key = key;
    [base.canvas.width, base.canvas.height] = [this.canvas.width, this.canvas.height];
    const context = base.canvas.getContext("2d");
    this.clear(context);
    new Painter(context, camera, this.painter.theme).tubes([{ chunk, first: 0, last }], colours);
  }

  paintNeedle() {
    const { painter, camera } = this;
    const [x, y, z] = this.place;
    const { context, theme } = painter;
    if (this.passes) {
      const up = this.data.high[2] - this.data.low[2];
      Object.assign(context, { strokeStyle: theme.muted, lineWidth: 2, globalAlpha: 0.7 });
      context.beginPath();
      context.moveTo(camera.u(x, y, z), camera.v(x, y, z));
      context.lineTo(camera.u(x, y, z + up), camera.v(x, y, z + up));
      context.stroke();
      context.globalAlpha = 1;
    }
    painter.needle({ x: [x], y: [y], z: [z] }, 0);
  }

  doing() {
    const { chunk, row } = this;
    if (this.whole) return "done";
    if (chunk.planned[row] === ACT.WRITE) return "writes";
    if (chunk.planned[row] === ACT.PRIME) return "lets out a drop";
    const still = Math.hypot(...["x", "y", "z"].map((k) => chunk[k][row] - chunk[k][row - 1])) < 1e-4;
    if (still) return "stands";
    return chunk.width[row] > 0 ? "leaves a thread" : "travels";
  }
}
