// A predicted print by its time: what lies there, what is being laid, where the needle is.
import { Camera, corners } from "viewer/flat";
import { ACT, LinePainter, LinesView, startControls } from "viewer/lines";
import {
  bisect, byId, clock, facts, fixed, holdWhileFocused, make, onKeys, short, showScaleBar, startPage,
  startView, zoomKeys,
} from "viewer/page";
import { swatch } from "viewer/scale";
import { unpackTable } from "viewer/unpack";

const FAINT = 0.5;
const STEP = 0.005; // of all the time, a key
const FIT_POINTS = 20000;
const at = (name) => byId(`play-${name}`);

async function readRows(data) {
  const rows = await unpackTable(data.rows);
  // A travel that leaves a thread is drawn as what lies there.
  rows.act = rows.planned.map((act, i) => (act === ACT.TRAVEL && rows.width[i] > 0 ? ACT.WRITE : act));
  return rows;
}

// Shows all that is written as large as the stage allows, from any side.
function cameraOf(data, rows) {
  const every = Math.max(1, Math.floor(rows.n / FIT_POINTS));
  const points = [];
  for (let i = 1; i < rows.n; i += every) {
    if (rows.planned[i] !== ACT.WRITE) continue;
    for (const k of [i - 1, i]) points.push([rows.x[k], rows.y[k], rows.z[k]]);
  }
  if (!points.length) return new Camera(corners(data.low, data.high));
  const half = Math.max(...rows.width.filter((width) => width > 0).slice(0, FIT_POINTS), 0) / 2;
  return new Camera(points, { margin: 0.92, half });
}

// First rows of the layers, and after the last the end; a layer that isn't drawn has no rows.
function layerStarts(rows, count) {
  const first = new Int32Array(count + 1).fill(-1);
  for (let i = rows.n - 1; i >= 0; i--) first[rows.layer[i]] = i;
  first[count] = rows.n;
  for (let k = count - 1; k >= 0; k--) if (first[k] < 0) first[k] = first[k + 1];
  return first;
}

class PlayView extends LinesView {
  constructor(data, rows, element) {
    super(data, element, cameraOf(data, rows),
      { travels: !data.passes, dots: !data.passes, faint: true });
    this.rows = rows;
    this.count = data.layer_z.length;
    this.first = layerStarts(rows, this.count);
    this.duration = rows.time[rows.n - 1];
    this.time = this.duration;
    this.base = { canvas: document.createElement("canvas"), key: "" };
    if (this.passes) this.camera.look(30, 30);
    this.colour(data.colourings[0].key);
    // Wheel and fingers scroll the page until the view is clicked.
    holdWhileFocused(element, (held) => { element.style.touchAction = held ? "none" : ""; });
    this.listen({ taken: () => document.activeElement === element, turns: this.passes ? "drag" : "" });
  }

  // A thread along a travel belongs to nothing, whatever it is coloured by.
  value(rows, i) {
    if (this.key === "width") return rows.width[i];
    if (rows.planned[i] !== ACT.WRITE) return NaN;
    return this.key === "off" ? this.offBy(rows, i) : rows[this.key][i];
  }

  // Percent that a row is wider than it is to be; NaN where that isn't known.
  offBy(rows, i) {
    return rows.wanted[i] > 0 ? 100 * (rows.width[i] / rows.wanted[i] - 1) : NaN;
  }

  get whole() { return this.time >= this.duration; }

  restart() { this.to(0); }

  // The row under way, the first that ends after the time; once all is done the last.
  get row() {
    const { time, n } = this.rows;
    return this.whole ? n - 1 : bisect(1, n - 1, (i) => time[i] > this.time);
  }

  get layer() { return this.rows.layer[this.row]; }

  // How much of the row under way is done.
  get share() {
    const { rows, row } = this;
    const [a, b] = [rows.time[row - 1], rows.time[row]];
    if (rows.act[row] === ACT.JUMP) return 0;
    return b > a ? Math.min(Math.max((this.time - a) / (b - a), 0), 1) : 1;
  }

  between(column) {
    const [a, b] = [column[this.row - 1], column[this.row]];
    return a + this.share * (b - a);
  }

  get place() { return ["x", "y", "z"].map((axis) => this.between(this.rows[axis])); }

  // The row under way as far as it is done, as rows of its own.
  get begun() {
    const cut = { n: 2 };
    for (const [name, column] of Object.entries(this.rows)) {
      if (name !== "n") cut[name] = [column[this.row - 1], column[this.row]];
    }
    this.place.forEach((value, k) => { cut["xyz"[k]][1] = value; });
    cut.act[0] = ACT.JUMP;
    return this.part(cut, 1, 2);
  }

  to(time) {
    this.time = Math.min(Math.max(time, 0), this.duration);
    this.draw();
  }

  // The next layer's end, or that of the one before.
  step(layers) {
    const endOf = (k) => this.rows.time[this.first[k + 1] - 1];
    const done = this.time >= endOf(this.layer) - 1e-6;
    const k = this.layer + layers - (layers > 0 && !done ? 1 : 0);
    this.to(k < 0 ? 0 : endOf(Math.min(k, this.count - 1)));
  }

  // To the end of a stretch: the next, or the one before.
  stretch(way) {
    const { rows, row } = this;
    const k = way > 0 ? (rows.time[row] > this.time ? row : row + 1) : row - 1;
    this.to(rows.time[Math.min(Math.max(k, 0), rows.n - 1)] + (way > 0 ? 0 : -1e-4));
  }

  paintLines() {
    const { painter, rows, row, passes, whole, shown } = this;
    const begins = this.first[this.layer];
    if (passes) this.paintPasses();
    else {
      if (shown.faint && this.layer > 0) {
        painter.hairs(rows, this.first[this.layer - 1], begins, painter.theme.ground, null, 1);
      }
      for (const part of [this.part(rows, begins, row), this.begun]) {
        painter.bands(part.rows, part.first, part.last, part.colour);
      }
    }
    const from = passes && whole ? 0 : begins;
    if (shown.travels) painter.travels(rows, from, row + (whole ? 1 : 0));
    if (shown.dots) painter.dots(rows, passes ? 0 : from, row);
    if (!whole) this.paintNeedle();
  }

  // What lay before the pass is kept as a picture; the pass itself lies over it.
  paintPasses() {
    const { rows, row, whole, context } = this;
    const from = this.passFrom(row);
    this.paintBase(whole ? rows.n : from);
    context.save();
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.globalAlpha = this.shown.faint && !whole ? FAINT : 1;
    context.drawImage(this.base.canvas, 0, 0);
    context.restore();
    if (whole) return;
    this.painter.tubes([this.part(rows, from, row)]);
    this.painter.tubes([this.begun]);
  }

  // Where the pass begins that is under way; while the needle goes there, the one before.
  passFrom(row) {
    const { rows, first, layer } = this;
    for (let i = first[layer]; i <= row; i++) if (rows.planned[i] === ACT.WRITE) return first[layer];
    return first[Math.max(layer - 1, 0)];
  }

  paintBase(last) {
    const { camera, base, painter } = this;
    const key = [last, this.key, camera.scale, camera.azimuth, camera.elevation, ...camera.target,
      ...camera.size, this.canvas.width, painter.theme.rim].join();
    if (key === base.key) return;
    base.key = key;
    [base.canvas.width, base.canvas.height] = [this.canvas.width, this.canvas.height];
    const context = base.canvas.getContext("2d");
    this.clear(context);
    Object.assign(new LinePainter(context, camera), { theme: painter.theme })
      .tubes([this.part(this.rows, 0, last)]);
  }

  paintNeedle() {
    const { painter, context, camera, data, place: [x, y, z] } = this;
    if (this.passes) {
      const top = z + data.high[2] - data.low[2];
      context.globalAlpha = 0.7;
      painter.line(camera.u(x, y), camera.v(x, y, z), camera.u(x, y), camera.v(x, y, top),
        painter.theme.muted, 2);
      context.globalAlpha = 1;
    }
    painter.needle([x, y, z]);
  }

  get doing() {
    const { rows, row } = this;
    if (this.whole) return "done";
    if (rows.planned[row] === ACT.WRITE) return "writes";
    if (rows.planned[row] === ACT.PRIME) return "lets out a drop";
    const still = Math.hypot(...["x", "y", "z"].map((k) => rows[k][row] - rows[k][row - 1])) < 1e-4;
    if (still) return "stands";
    return rows.width[row] > 0 ? "leaves a thread" : "travels";
  }
}

function startPanel(view, own) {
  view.onDraw(() => showNumbers(view));
  at("time").max = view.duration;
  at("time").addEventListener("input", () => view.to(Number(at("time").value)));
  at("back").addEventListener("click", () => view.step(-1));
  at("on").addEventListener("click", () => view.step(1));
  // A warning's mark and its row go to the moment; the list lies below, so the view comes back.
  for (const button of document.querySelectorAll("button[data-time]")) {
    button.addEventListener("click", () => {
      view.to(Number(button.dataset.time));
      if (button.classList.contains("go")) at("viewer").scrollIntoView({ block: "nearest" });
    });
  }
  const toggle = startControls(view, "play-", (seconds) => {
    const pace = at("pace").value === "real" ? 1 : view.duration / Number(at("pace").value);
    view.to(view.time + seconds * pace);
  });
  const go = (way) => (event) => (event.shiftKey ? view.stretch(way)
    : view.to(view.time + way * STEP * view.duration));
  const step = (layers) => () => view.step(layers);
  // In a page of its own keys mean the slider wherever they are struck.
  onKeys(own ? document : at("viewer"), {
    ArrowRight: go(1), ArrowLeft: go(-1), ArrowUp: step(1), ArrowDown: step(-1),
    PageUp: step(1), PageDown: step(-1),
    Home: () => view.to(0), End: () => view.to(view.duration), " ": toggle, 0: () => view.fit(),
    ...zoomKeys(view),
  });
}

function showNumbers(view) {
  const noun = view.passes ? "Pass" : "Layer";
  at("time").value = view.time;
  at("clock").textContent = `${clock(view.time)} of ${clock(view.duration)}`;
  at("tag").textContent = `${noun} ${view.layer + 1} of ${short(view.count)}`;
  at("numbers").replaceChildren(...facts(numbers(view, noun)));
  const legend = view.scale.legend();
  if (view.key !== "width") {
    const none = view.key === "off" ? "nothing to hold it against" : "threads along travels";
    legend.append(make("p", { className: "swatches small" }, swatch(view.data.colours.none, none)));
  }
  at("legend").replaceChildren(legend);
  showScaleBar(at("scalebar"), view.pixelsPerMm());
}

function numbers(view, noun) {
  const { rows, row, data, place: [x, y, z] } = view;
  const [width, off] = [rows.width[row], view.offBy(rows, row)];
  const percent = Number.isNaN(off) ? "" : `, ${off > 0 ? "+" : ""}${fixed(off, 1)}\u202f%`;
  const layerZ = `${view.passes ? "≤ " : ""}${short(data.layer_z[view.layer], 4)}`;
  return [
    ["Time", clock(view.time)],
    [noun, `${view.layer + 1}, z ${layerZ} mm`],
    ["Ink laid", `${short(view.between(rows.laid), 4)} of ${short(rows.laid[rows.n - 1], 4)} µL`],
    ["Needle x, y", `${x.toFixed(3)}, ${y.toFixed(3)}`],
    ["Needle z", `${z.toFixed(3)} mm`],
    ["The needle", view.doing],
    ["Line", rows.line[row] ? String(rows.line[row]) : "–"],
    ["Width", width > 0 ? `${width.toFixed(3)} mm${percent}` : "–"],
    ...(view.passes ? [["Vessel", rows.vessel[row] < 0 ? "–" : String(rows.vessel[row])]] : []),
    ...(data.inks.length > 1 ? [["Ink", data.inks[rows.head[row]]]] : []),
  ];
}

// #t=0.5 is half of the time; &colour=width is the colouring.
function followAddress(view) {
  const given = new URLSearchParams(location.hash.slice(1));
  const [share, colour] = [Number(given.get("t")), given.get("colour")];
  if (view.data.colourings.some(({ key }) => key === colour)) {
    at("colouring").value = colour;
    view.colour(colour);
  }
  if (given.has("t") && Number.isFinite(share)) view.to(share * view.duration);
}

async function start() {
  const data = JSON.parse(at("data").textContent);
  const view = new PlayView(data, await readRows(data), at("stage"));
  startPanel(view, document.body.classList.contains("play-page"));
  at("viewer").dataset.state = "ready";
  window.addEventListener("hashchange", () => followAddress(view));
  followAddress(view);
  view.resize();
}

const startPlay = () => startView(at("viewer"), start);
if (document.body.classList.contains("play-page")) startPage(startPlay);
else startPlay();
