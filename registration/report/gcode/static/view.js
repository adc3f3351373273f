// The stage: which layer and how much of it is shown, and what the pointer is over.
import { Camera } from "gcode/camera";
import { CanvasView } from "gcode/canvas_view";
import { Colours } from "gcode/colours";
import { Painter } from "gcode/draw";
import { hues } from "gcode/hues";
import { ACT, Chunks } from "gcode/moves";
import { drawSeams, Outlines } from "gcode/outline";
import { nearest } from "gcode/pick";

export class View extends CanvasView {
  constructor(data, holder) {
    super(holder, holder.querySelector("canvas"), new Camera(data.low, data.high));
    Object.assign(this, { data, layers: data.layers, passes: data.passes });
    this.chunks = new Chunks(data.rows, data.passes);
    this.shown = { travels: true, dots: true, below: data.passes, path: false,
      seams: !data.passes, outline: Boolean(data.outline) };
    this.outlines = data.outline ? new Outlines(data.outline) : null;
    this.painter = new Painter(this.canvas.getContext("2d"), this.camera, {});
    this.hovered = null;
    this.colour(data.first.colour);
    this.watchTheme();
  }

  get count() { return this.layers.z.length; }

  colour(key) {
    const found = this.data.colourings.find((each) => each.key === key) ?? this.data.colourings[0];
    this.colours = new Colours(found, this.data.scale, this.data.none);
    this.draw();
  }

  // Shows a layer whole, or as far as a move (counted from 1).
  async show(layer, move = Infinity) {
    const k = Math.min(Math.max(layer, 0), this.count - 1);
    this.wanted = k;
    const [rings, ...parts] = await Promise.all(
      [this.outlines?.get(k), ...this.partsOf(k).map((each) => this.fetch(each))]);
    // Meanwhile another layer may have been asked for.
    if (this.wanted !== k) return;
    const part = parts.pop();
    Object.assign(this, { layer: k, before: parts, part, rings, hovered: null });
    this.rows = part.last - part.first;
    this.to(move);
    this.changed();
  }

  // The layer, after what is shown with it: the one below, or all passes before.
  partsOf(k) {
    const first = this.passes ? 0 : Math.max(k - 1, 0);
    return Array.from({ length: k - first + 1 }, (_, i) => first + i);
  }

  async fetch(k) {
    const { chunk: of, from, to } = this.layers;
    const chunk = await this.chunks.get(of[k]);
    // A row that only says where the first move starts is none of its moves.
    const first = from[k] + (chunk.act[from[k]] === ACT.JUMP ? 1 : 0);
    return { chunk, first, last: to[k] };
  }

  to(move) {
    this.move = Math.min(Math.max(move, 0), this.rows);
    this.draw();
  }

  get whole() { return this.move >= this.rows; }

  // Parts that can be pointed at, as far as they are shown.
  get drawn() {
    const now = { ...this.part, last: this.part.first + this.move };
    return this.passes && this.shown.below ? [...this.before, now] : [now];
  }

  paint() {
    const { painter, part, shown, colours } = this;
    if (!part) return;
    painter.theme = hues();
    this.clear(painter.context);
    const [first, last] = [part.first, part.first + this.move];
    const below = this.before.at(-1);
    if (this.passes) painter.tubes(this.drawn, colours);
    else {
      if (shown.below && below) {
        painter.hairs(below.chunk, below.first, below.last, painter.theme.ground, null, 1);
      }
      painter.bands(part.chunk, first, last, colours, [part.first, part.last]);
      // Lines of one colour merge where they touch: their middles tell them apart.
      if (colours.key === "line") painter.hairs(part.chunk, first, last, painter.theme.way, 1, 0.4);
    }
    if (shown.path) painter.hairs(part.chunk, first, last, painter.theme.ink, 1, 0.75);
    for (const each of this.drawn) {
      if (shown.travels && (!this.passes || each.first === first)) {
        painter.travels(each.chunk, each.first, each.last);
      }
      if (shown.dots) painter.dots(each.chunk, each.first, each.last);
    }
    if (shown.outline && this.rings) this.outlines.draw(painter, this.rings, this.layers.z[this.layer]);
    if (shown.seams && !this.passes) drawSeams(painter, { chunk: part.chunk, first, last });
    if (this.hovered) painter.mark(this.hovered.chunk, this.hovered.i);
    if (!this.whole && this.move > 0) painter.needle(part.chunk, last - 1);
    this.changed();
  }

  point(u, v) {
    const shown = (act) => act === ACT.WRITE
      || (act === ACT.PRIME || act === ACT.RETRACT ? this.shown.dots : this.shown.travels);
    const found = this.part && u !== null ? nearest(this.drawn, this.camera, u, v, shown) : null;
    if (found?.i === this.hovered?.i && found?.chunk === this.hovered?.chunk) return;
    this.hovered = found;
    this.draw();
  }
}
