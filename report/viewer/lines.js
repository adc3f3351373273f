// Printed lines on a canvas: written ones to scale, travels, dots, outlines; colours and switches.
//
// Rows are columns of n numbers each: x, y, z (mm), act, width (mm), and what colours need. A row is
// the end of a move that began where the row before ends; after a jump it only says where.
import { FlatView } from "viewer/flat";
import { byId, hues, startPlaying } from "viewer/page";
import { Scale, cssOf } from "viewer/scale";

export const ACT = { TRAVEL: 0, LIFTED: 1, WRITE: 2, PRIME: 3, RETRACT: 4, WIPE: 5, JUMP: 6 };
const HUES = ["paper", "ink", "muted", "way", "lifted", "prime", "retract", "rim", "ground", "hot"];
const BINS = 48;
const OUTLINE_BINS = 31;
const TURN = 2 * Math.PI;
const STRAIGHT = 1e-3; // rad
const REACH_PX = 7;
const HAIR_PX = 1.2;
const THIN_PX = 1.4;
const LINE_ALPHA = 0.78;
// Left free at each side of a line that is wide enough, so that neighbours can be told apart.
const SEAM = { fromPx: 8, px: 0.3 };

// Adds a piece of a line, pixels, true width, round ends and corners; `before` is the direction of the
// piece that it joins, or null. All parts turn one way round: a non-zero fill is their union (bands.py).
function addBand(path, x0, y0, x1, y1, half, before, ends) {
  const angle = Math.atan2(y1 - y0, x1 - x0);
  const sector = (x, y, begin, span) => {
    path.moveTo(x, y);
    path.arc(x, y, half, begin, begin + span);
    path.closePath();
  };
  const [ax, ay] = [-Math.sin(angle) * half, Math.cos(angle) * half];
  path.moveTo(x0 - ax, y0 - ay);
  path.lineTo(x1 - ax, y1 - ay);
  path.lineTo(x1 + ax, y1 + ay);
  path.lineTo(x0 + ax, y0 + ay);
  path.closePath();
  if (before === null) sector(x0, y0, angle + Math.PI / 2, Math.PI);
  else {
    const turn = ((((angle - before + Math.PI) % TURN) + TURN) % TURN) - Math.PI;
    const begin = turn > 0 ? before - Math.PI / 2 : angle + Math.PI / 2;
    if (Math.abs(turn) >= STRAIGHT) sector(x0, y0, begin, Math.abs(turn));
  }
  if (ends) sector(x1, y1, angle - Math.PI / 2, Math.PI);
  return angle;
}

export class LinePainter {
  constructor(context, camera) {
    Object.assign(this, { context, camera, theme: {} });
  }

  // Calls action(i, u0, v0, u1, v1, wide) for the moves of rows `first` to `last` - 1 that `fits(i)`
  // and that are seen at all; `wide` is in pixels.
  each(rows, first, last, fits, action) {
    const { camera } = this;
    const { x, y, z, width } = rows;
    const [w, h] = camera.size;
    let at = -1;
    let u1 = 0;
    let v1 = 0;
    for (let i = Math.max(first, 1); i < last; i++) {
      if (!fits(i)) continue;
      const joins = at === i - 1;
      const u0 = joins ? u1 : camera.u(x[i - 1], y[i - 1]);
      const v0 = joins ? v1 : camera.v(x[i - 1], y[i - 1], z[i - 1]);
      at = i;
      u1 = camera.u(x[i], y[i]);
      v1 = camera.v(x[i], y[i], z[i]);
      const wide = (width[i] || 0) * camera.scale;
      if (Math.max(u0, u1) < -wide || Math.min(u0, u1) > w + wide
        || Math.max(v0, v1) < -wide || Math.min(v0, v1) > h + wide) continue;
      action(i, u0, v0, u1, v1, wide);
    }
  }

  // Written lines as unions of one colour each; where lines overlap their colours do, too.
  // `colour(i)` is a CSS colour.
  bands(rows, first, last, colour) {
    const { context } = this;
    const writes = (i) => rows.act[i] === ACT.WRITE;
    let [path, fill, before, at] = [null, "", null, -2];
    const flush = () => {
      context.fillStyle = fill;
      if (path) context.fill(path, "nonzero");
      path = null;
    };
    Object.assign(context, { globalAlpha: LINE_ALPHA, lineCap: "round", lineJoin: "round" });
    this.each(rows, first, last, writes, (i, u0, v0, u1, v1, wide) => {
      const now = colour(i);
      if (at !== i - 1) before = null;
      at = i;
      if (wide < THIN_PX) {
        flush();
        this.line(u0, v0, u1, v1, now, Math.max(wide, Number.isNaN(rows.width[i]) ? HAIR_PX : 0.3));
        before = Math.atan2(v1 - v0, u1 - u0);
        return;
      }
      if (!path || now !== fill || before === null) {
        flush();
        [path, fill] = [new Path2D(), now];
      }
      const half = wide / 2 - (wide > SEAM.fromPx ? SEAM.px : 0);
      before = addBand(path, u0, v0, u1, v1, half, before, i + 1 >= last || !writes(i + 1));
    });
    flush();
    context.globalAlpha = 1;
  }

  line(u0, v0, u1, v1, colour, width) {
    Object.assign(this.context, { strokeStyle: colour, lineWidth: width });
    this.context.beginPath();
    this.context.moveTo(u0, v0);
    this.context.lineTo(u1, v1);
    this.context.stroke();
  }

  // Written lines in space: round, the nearer ones over the farther ones, each with a dark rim.
  // Parts are { rows, first, last, colour }.
  tubes(parts) {
    const { context, camera } = this;
    const pieces = [];
    for (const { rows, first, last, colour } of parts) {
      const { x, y, z } = rows;
      const writes = (i) => rows.act[i] === ACT.WRITE;
      this.each(rows, first, last, writes, (i, u0, v0, u1, v1, wide) => {
        const depth = camera.depth(x[i] + x[i - 1], y[i] + y[i - 1], z[i] + z[i - 1]);
        pieces.push({ depth, ends: [u0, v0, u1, v1], wide: Math.max(wide, HAIR_PX), hue: colour(i) });
      });
    }
    pieces.sort((a, b) => a.depth - b.depth);
    for (const { ends, wide, hue } of pieces) {
      // The rim along the sides only: round it would draw a ring at each joint.
      context.lineCap = "butt";
      if (wide > 2.5) this.line(...ends, this.theme.rim, wide);
      context.lineCap = "round";
      this.line(...ends, hue, wide > 2.5 ? wide - Math.min(1.6, 0.3 * wide) : wide);
    }
  }

  // Moves that `fits(i)` as strokes; `penOf(i, wide)` gives { hue, width } in pixels, one object as long
  // as it is the same.
  strokes(rows, first, last, fits, penOf, { alpha = 1, dashes = [] } = {}) {
    const { context } = this;
    context.globalAlpha = alpha;
    context.setLineDash(dashes);
    context.beginPath();
    let [at, pen] = [-2, null];
    this.each(rows, first, last, fits, (i, u0, v0, u1, v1, wide) => {
      const now = penOf(i, wide);
      if (now !== pen) {
        context.stroke();
        context.beginPath();
        [pen, at] = [now, -2];
        Object.assign(context, { strokeStyle: pen.hue, lineWidth: pen.width });
      }
      if (at !== i - 1) context.moveTo(u0, v0);
      context.lineTo(u1, v1);
      at = i;
    });
    context.stroke();
    context.setLineDash([]);
    context.globalAlpha = 1;
  }

  // The needle's path along written lines as a hairline; with `width` null as wide as the lines.
  hairs(rows, first, last, colour, width, alpha) {
    let pen = { hue: colour, width };
    this.strokes(rows, first, last, (i) => rows.act[i] === ACT.WRITE, (_, wide) => {
      const now = width ?? Math.max(wide, HAIR_PX);
      if (now !== pen.width) pen = { hue: colour, width: now };
      return pen;
    }, { alpha });
  }

  travels(rows, first, last) {
    const act = (i) => rows.act[i];
    const [way, lifted] = ["way", "lifted"].map((name) => ({ hue: this.theme[name], width: 1 }));
    this.strokes(rows, first, last, (i) => act(i) === ACT.TRAVEL, () => way, { alpha: 0.9 });
    this.strokes(rows, first, last, (i) => act(i) === ACT.LIFTED || act(i) === ACT.WIPE,
      () => lifted, { alpha: 0.9, dashes: [5, 4] });
  }

  circle(u, v, radius, { fill = null, stroke = null, width = 1.5 }) {
    const { context } = this;
    context.beginPath();
    context.arc(u, v, radius, 0, TURN);
    Object.assign(context, { fillStyle: fill, strokeStyle: stroke, lineWidth: width });
    if (fill) context.fill();
    if (stroke) context.stroke();
  }

  seen(rows, i) {
    return [this.camera.u(rows.x[i], rows.y[i]), this.camera.v(rows.x[i], rows.y[i], rows.z[i])];
  }

  // A prime is a full dot, a retraction a larger ring, since both often stand on one spot.
  dots(rows, first, last) {
    const { prime, retract } = this.theme;
    for (let i = first; i < last; i++) {
      if (rows.act[i] === ACT.PRIME) this.circle(...this.seen(rows, i), 2.6, { fill: prime });
      if (rows.act[i] === ACT.RETRACT) this.circle(...this.seen(rows, i), 4.4, { stroke: retract });
    }
  }

  needle(place) {
    const { context, camera, theme } = this;
    const [u, v] = [camera.u(...place), camera.v(...place)];
    for (const [stroke, width] of [[theme.paper, 5], [theme.ink, 2]]) {
      this.circle(u, v, 8, { stroke, width });
      for (const [a, b] of [[-13, 0], [13, 0], [0, -13], [0, 13]]) {
        context.beginPath();
        context.moveTo(u + 0.45 * a, v + 0.45 * b);
        context.lineTo(u + a, v + b);
        context.stroke();
      }
    }
  }

  mark(rows, i) {
    const path = new Path2D();
    const wide = Math.max((rows.width[i] || 0) * this.camera.scale, 3);
    addBand(path, ...this.seen(rows, i - 1), ...this.seen(rows, i), wide / 2, null, true);
    this.context.fillStyle = this.theme.hot;
    this.context.fill(path, "nonzero");
  }

  // The design's outline: points x, y, `begins` where a ring does, coloured by `beyond` (µm). A dark
  // rim, so that pale colours are seen on lines and between them; the colours over it.
  outline({ n, x, y, begins, beyond }, z, scale) {
    const { context, camera } = this;
    const hueOf = scale.table(OUTLINE_BINS).map(cssOf);
    const [rim, paths] = [new Path2D(), hueOf.map(() => new Path2D())];
    let [u, v] = [0, 0];
    for (let i = 0; i < n; i++) {
      const [a, b] = [camera.u(x[i], y[i]), camera.v(x[i], y[i], z)];
      if (begins[i]) rim.moveTo(a, b);
      else {
        rim.lineTo(a, b);
        const path = paths[scale.bin(beyond[i], OUTLINE_BINS)];
        path.moveTo(u, v);
        path.lineTo(a, b);
      }
      [u, v] = [a, b];
    }
    Object.assign(context, { lineJoin: "round", lineCap: "butt", lineWidth: 4.6 });
    context.strokeStyle = this.theme.ink;
    context.stroke(rim);
    context.lineWidth = 2.8;
    paths.forEach((path, k) => { context.strokeStyle = hueOf[k]; context.stroke(path); });
  }

  // Where closed lines begin and end.
  seams(rows, first, last) {
    let from = -1;
    for (let i = Math.max(first, 1); i <= last; i++) {
      const writes = i < last && rows.act[i] === ACT.WRITE;
      if (writes && from < 0) from = i - 1;
      if (writes || from < 0) continue;
      const gap = Math.hypot(rows.x[i - 1] - rows.x[from], rows.y[i - 1] - rows.y[from]);
      if (i - 1 - from >= 3 && gap <= (rows.width[from + 1] || 0)) {
        this.circle(...this.seen(rows, from), 2.4,
          { fill: this.theme.ink, stroke: this.theme.paper, width: 1 });
      }
      from = -1;
    }
  }

  // The move nearest to a pointer, of parts { rows, first, last } and acts that are `shown`: a written
  // line under it, else a way or a dot beside it. Of lines that lie over each other the last written.
  nearest(parts, u, v, shown) {
    let [best, found] = [REACH_PX, null];
    for (const { rows, first, last } of parts) {
      for (let i = Math.max(first, 1); i < last; i++) {
        const act = rows.act[i];
        if (act === ACT.JUMP || !shown(act)) continue;
        const dot = act === ACT.PRIME || act === ACT.RETRACT;
        const edge = act === ACT.WRITE ? ((rows.width[i] || 0) * this.camera.scale) / 2 : -1;
        const beyond = this.distance(rows, i, u, v) - edge;
        const value = dot ? beyond - 3 : Math.max(beyond, 0);
        if (value < best || (value === best && value < REACH_PX)) [best, found] = [value, { rows, i }];
      }
    }
    return found;
  }

  distance(rows, i, u, v) {
    const [[u0, v0], [u1, v1]] = [this.seen(rows, i - 1), this.seen(rows, i)];
    const [du, dv] = [u1 - u0, v1 - v0];
    const along = du * du + dv * dv;
    const t = along ? Math.min(Math.max(((u - u0) * du + (v - v0) * dv) / along, 0), 1) : 0;
    return Math.hypot(u - u0 - t * du, v - v0 - t * dv);
  }
}

// A view of lines with colourings (`data.colourings`, `data.colours`) and switches (`shown`). Heirs
// give `paintLines()` and `value(rows, i, ends)`, which a row is coloured by.
export class LinesView extends FlatView {
  constructor(data, element, camera, shown) {
    super(element, element.querySelector("canvas"), camera);
    Object.assign(this, { data, shown, passes: data.passes });
    this.painter = new LinePainter(this.context, camera);
  }

  colour(key) {
    const { colourings, colours } = this.data;
    this.scale = new Scale(colourings.find((one) => one.key === key) ?? colourings[0], colours);
    this.key = this.scale.key;
    const hueOf = this.scale.table(BINS).map(cssOf);
    this.hue = (value) => hueOf[this.scale.bin(value, BINS)] ?? colours.none;
    this.draw();
  }

  // Rows to draw, with the colour of each; `ends` are where the order of writing begins and ends.
  part(rows, first, last, ends = [first, last]) {
    return { rows, first, last, colour: (i) => this.hue(this.value(rows, i, ends)) };
  }

  paint() {
    if (!this.hue || !this.isReady()) return;
    this.painter.theme = hues(HUES);
    this.clear();
    this.paintLines();
    this.changed();
  }

  isReady() { return true; }
}

// The controls beside a view of lines whose ids begin with `prefix`: colour, switches, directions, play.
export function startControls(view, prefix, advance) {
  const at = (id) => byId(prefix + id);
  for (const { key, name } of view.data.colourings) at("colouring").add(new Option(name, key));
  at("colouring").value = view.key;
  at("colouring").addEventListener("change", () => view.colour(at("colouring").value));
  for (const what of Object.keys(view.shown)) {
    const box = at(`show-${what}`);
    if (!box) continue;
    box.checked = view.shown[what];
    box.addEventListener("change", () => { view.shown[what] = box.checked; view.draw(); });
  }
  for (const button of at("turn")?.querySelectorAll("button") ?? []) {
    button.addEventListener("click", () => view.turn(...button.dataset.turn.split(",").map(Number)));
  }
  return startPlaying(at("play"), view, advance);
}
