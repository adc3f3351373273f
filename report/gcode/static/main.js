// The G-code page: one layer, or passes up to one, and how much of it is written.
import { Camera, corners } from "viewer/flat";
import { ACT, LinesView, startControls } from "viewer/lines";
import {
  byId, facts, make, onKeys, short, showScaleBar, startPage, startView, zoomKeys,
} from "viewer/page";
import { Scale } from "viewer/scale";
import { unpack, unpackColumns } from "viewer/unpack";

const KEPT_CHUNKS = 6;
const PLAY_FRAMES = 600;
const ACTS = {
  [ACT.TRAVEL]: "Travel", [ACT.LIFTED]: "Lifted travel", [ACT.WRITE]: "Written",
  [ACT.PRIME]: "Prime", [ACT.RETRACT]: "Retraction", [ACT.WIPE]: "Retraction on the way",
};

// Pieces of the page, unpacked when they are needed; the latest few, or all of them, are kept.
class Chunks {
  constructor({ rows, columns, passes }) {
    Object.assign(this, { rows, columns, kept: new Map(), most: passes ? rows.length : KEPT_CHUNKS });
    this.data = document.querySelectorAll("script.chunk");
    this.text = document.querySelectorAll("script.lines");
  }

  get(k) {
    const found = this.kept.get(k) ?? this.read(k);
    this.kept.delete(k);
    this.kept.set(k, found);
    if (this.kept.size > this.most) this.kept.delete(this.kept.keys().next().value);
    return found;
  }

  async read(k) {
    const chunk = await unpackColumns(this.data[k].textContent, this.rows[k], this.columns);
    const text = this.text[k].textContent;
    chunk.text = text ? new TextDecoder().decode(await unpack(text)).split("\n") : null;
    return chunk;
  }
}

// The file's text of a row: a row of the same line as the one before has none of its own.
function textOf({ text, line }, row) {
  let i = row;
  while (text && i > 0 && line[i - 1] === line[row]) i--;
  return text?.[i] ?? "";
}

class GcodeView extends LinesView {
  constructor(data, element) {
    super(data, element, new Camera(corners(data.low, data.high)), {
      travels: true, dots: true, below: data.passes, path: false,
      seams: !data.passes, outline: Boolean(data.outline),
    });
    this.chunks = new Chunks(data);
    this.layers = data.layers;
    this.count = data.layers.z.length;
    this.outlineScale = data.outline && new Scale(data.outline.scale, data.colours);
    this.outlineData = document.querySelectorAll("script.outline");
    this.hovered = null;
    this.colour(data.first.colour);
    this.listen({ point: (u, v) => this.point(u, v), turns: data.passes ? "button" : "" });
  }

  // Shows a layer whole, or as far as a move (counted from 1).
  async show(layer, move = Infinity) {
    const k = Math.min(Math.max(Math.round(layer), 0), this.count - 1);
    this.wanted = k;
    // The layer, after what is shown with it: the one below, or all passes before.
    const from = this.passes ? 0 : Math.max(k - 1, 0);
    const parts = Array.from({ length: k - from + 1 }, (_, i) => this.fetch(from + i));
    const [rings, ...known] = await Promise.all([this.ringsOf(k), ...parts]);
    // Meanwhile another layer may have been chosen.
    if (this.wanted !== k) return;
    const now = known.pop();
    Object.assign(this, { layer: k, before: known, now, rings, hovered: null });
    this.moves = now.last - now.first;
    this.to(move);
    this.changed();
  }

  async fetch(k) {
    const { chunk, from, to } = this.layers;
    const rows = await this.chunks.get(chunk[k]);
    // A row that only says where the first move starts is none of its moves.
    const first = from[k] + (rows.act[from[k]] === ACT.JUMP ? 1 : 0);
    return this.part(rows, first, to[k]);
  }

  ringsOf(k) {
    const n = this.data.outline?.points[k];
    return n ? unpackColumns(this.outlineData[k].textContent, n, this.data.outline.columns) : null;
  }

  value(rows, i, [first, last]) {
    if (this.key === "line") return 0;
    if (this.key === "height") return (rows.z[i] + rows.z[i - 1]) / 2;
    if (this.key === "order") return (i - first) / Math.max(last - first - 1, 1);
    return rows[this.key][i];
  }

  to(move) {
    this.move = Math.min(Math.max(move, 0), this.moves);
    this.draw();
  }

  restart() { this.to(1); }

  get whole() { return this.move >= this.moves; }

  // Parts that can be pointed at, as far as they are shown.
  get drawn() {
    const now = { ...this.now, last: this.now.first + this.move };
    return this.passes && this.shown.below ? [...this.before, now] : [now];
  }

  isReady() { return Boolean(this.now); }

  paintLines() {
    const { painter, shown, passes, now: { rows, first, colour } } = this;
    const { ground, way, ink } = painter.theme;
    const last = first + this.move;
    const below = this.before.at(-1);
    if (passes) painter.tubes(this.drawn);
    else {
      if (shown.below && below) painter.hairs(below.rows, below.first, below.last, ground, null, 1);
      painter.bands(rows, first, last, colour);
      // Lines of one colour merge where they touch: their middles tell them apart.
      if (this.key === "line") painter.hairs(rows, first, last, way, 1, 0.4);
    }
    if (shown.path) painter.hairs(rows, first, last, ink, 1, 0.75);
    for (const each of this.drawn) {
      if (shown.travels && (!passes || each.first === first)) {
        painter.travels(each.rows, each.first, each.last);
      }
      if (shown.dots) painter.dots(each.rows, each.first, each.last);
    }
    if (shown.outline && this.rings) {
      painter.outline(this.rings, this.layers.z[this.layer], this.outlineScale);
    }
    if (shown.seams && !passes) painter.seams(rows, first, last);
    if (this.hovered) painter.mark(this.hovered.rows, this.hovered.i);
    if (!this.whole && this.move > 0) {
      painter.needle(["x", "y", "z"].map((axis) => rows[axis][last - 1]));
    }
  }

  point(u, v) {
    const shown = (act) => act === ACT.WRITE
      || (act === ACT.PRIME || act === ACT.RETRACT ? this.shown.dots : this.shown.travels);
    const found = this.now && u !== null ? this.painter.nearest(this.drawn, u, v, shown) : null;
    if (found?.i === this.hovered?.i && found?.rows === this.hovered?.rows) return;
    this.hovered = found;
    this.draw();
  }
}

function duration(seconds) {
  if (seconds < 90) return `${short(seconds)} s`;
  return seconds < 5400 ? `${short(seconds / 60)} min` : `${short(seconds / 3600)} h`;
}

function layerFacts({ layers, layer: k, passes, data }) {
  const of = (key) => layers[key][k];
  // How far ink lies beyond the design's outline: 5, 50 and 95 % of the outline stay below.
  const beyond = data.outline?.beyond[k] ?? [];
  return [
    [passes ? "Highest tip z" : "Tip at z", `${short(of("z"), 6)} mm`],
    ...(of("height") === null ? [] : [["Line height", `${short(of("height"), 4)} mm`]]),
    ...(passes ? [] : [["Unbroken lines", short(of("lines"))]]),
    ["Moves that write", short(of("written"))],
    ["Written", of("ul") === null ? "not known" : `${short(of("ul"), 4)} µL`],
    ["Way written", `${short(of("way_mm"), 4)} mm`],
    ["Way between", `${short(of("travel_mm"), 4)} mm`],
    ["Time as fed", duration(of("time_s"))],
    ["Lines of the file", of("last_line") ? `${of("first_line")}–${of("last_line")}` : "–"],
    ...(beyond.length
      ? [["Past outline, 5/50/95 %", `${beyond.map((um) => short(um)).join(" / ")} µm`]] : []),
  ];
}

function moveFacts(rows, i, vessels) {
  const act = rows.act[i];
  const way = Math.hypot(...["x", "y", "z"].map((axis) => rows[axis][i] - rows[axis][i - 1]));
  const still = act === ACT.PRIME || act === ACT.RETRACT;
  const width = rows.width[i];
  return [
    ...(act === ACT.WRITE && !Number.isNaN(width) ? [["Width", `${short(width, 4)} mm`]] : []),
    ...(still || act === ACT.WIPE ? [["Pushed", `${short(rows.dose[i])} µL`]] : []),
    ...(still ? [] : [["Length", `${short(way, 4)} mm`]]),
    ["Speed, as fed", `${short(rows.speed[i], 4)} mm/s`],
    ["To", ["x", "y", "z"].map((axis) => short(rows[axis][i], 6)).join(", ")],
    ...(vessels && rows.vessel[i] >= 0 ? [["Vessel", String(rows.vessel[i])]] : []),
  ];
}

function startPanel(view) {
  for (const id of ["panel", "moves", "scalebar"]) byId(id).hidden = false;
  for (const id of ["layer", "layer-tag"]) byId(id).hidden = view.count < 2;
  for (const id of ["layer", "number"]) {
    byId(id).addEventListener("input", () => byId(id).value && view.show(byId(id).value - 1));
  }
  byId("number").addEventListener("change", () => { byId("number").value = view.wanted + 1; });
  byId("up").addEventListener("click", () => view.show(view.layer + 1));
  byId("down").addEventListener("click", () => view.show(view.layer - 1));
  byId("move").addEventListener("input", () => view.to(Number(byId("move").value)));
  startControls(view, "", () =>
    view.to(view.move + Math.max(1, Math.round(view.moves / PLAY_FRAMES))));
  view.onDraw(() => view.now && showNumbers(view));
  const step = (event) => (event.shiftKey ? 10 : 1);
  onKeys(document, {
    ArrowUp: (event) => view.show(view.layer + step(event)),
    ArrowDown: (event) => view.show(view.layer - step(event)),
    ArrowRight: (event) => view.to(view.move + step(event)),
    ArrowLeft: (event) => view.to(view.move - step(event)),
    Home: () => view.show(0), End: () => view.show(view.count - 1), 0: () => view.fit(),
    ...zoomKeys(view),
  }, "input:not([type=checkbox]), select");
}

function showNumbers(view) {
  const { now: { rows, first, last }, layer: k, move } = view;
  if (document.activeElement !== byId("number")) byId("number").value = k + 1;
  byId("layer").value = k + 1;
  byId("layer-tag").textContent = `${view.passes ? "pass" : "layer"} ${k + 1}`;
  [byId("move").max, byId("move").value] = [view.moves, move];
  byId("move-tag").textContent = `${short(move)} of ${short(view.moves)} moves`;
  byId("numbers").replaceChildren(...facts(layerFacts(view)));
  const kinds = view.key === "kind" ? new Set(rows.kind.subarray(first, last)) : null;
  byId("legend").replaceChildren(
    ...(view.outlineScale && view.shown.outline ? [view.outlineScale.legend()] : []),
    view.scale.legend(kinds));
  showScaleBar(byId("scalebar"), view.pixelsPerMm());
  showMove(view);
}

// The move under the pointer, else the needle's while it is on its way.
function showMove({ now, move, whole, hovered, data }) {
  const here = hovered ?? (!whole && move > 1 ? { rows: now.rows, i: now.first + move - 1 } : null);
  byId("probe").hidden = !here;
  byId("line").replaceChildren();
  if (!here) return;
  const { rows, i } = here;
  const kind = rows.act[i] === ACT.WRITE && data.kinds[rows.kind[i]];
  byId("probe").replaceChildren(`${rows.line[i]}\u2003`, make("code", {}, textOf(rows, i)));
  byId("line").append(
    make("h3", {}, `${kind || ACTS[rows.act[i]]}, line ${rows.line[i]}`),
    make("dl", {}, ...facts(moveFacts(rows, i, data.vessels))));
}

startPage(() => startView(byId("viewer"), async () => {
  const data = JSON.parse(byId("view-data").textContent);
  const view = new GcodeView(data, byId("stage"));
  startPanel(view);
  byId("viewer").dataset.state = "ready";
  view.resize();
  await view.show(data.first.layer);
}));
