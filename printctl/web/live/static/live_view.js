// The live view of a print: what has been written, the needle, what comes next.
//
//   const view = await liveView(element, { scene: "live/JOB/scene", live: true });
//   view.update({ executed: 1200, acknowledged: 1230, position: [10.2, 4.1, 0.3] });
//
// `executed` and `acknowledged` count commands of the file as the link does. Only what was executed
// is drawn as written. `mends` are lines that were put in: { look, written, strokes: [[[x, y, z], ...],
// ...] }. Without `live` the whole job is drawn as planned.
import { make, onTheme, short, startViewKeys } from "viewer/page";
import {
  COLUMN, SceneProblem, WIDE, bandOf, colourings, loadScene, movesAhead, movesDone, placeOf, scaleOf,
} from "live/scene";

// While a print goes on, between two places of the needle, two pictures and two sentences. A picture
// costs a browser without a graphics card ten times what the needle does: there it comes half as often.
const LEAST_MS = { needle: 200, picture: 500, words: 1000 };
const SOFTWARE_PICTURE_MS = 1000;
const AHEAD_S = 10; // what comes next
const SHAFT_MM = 14;
const ZOOM = 1.3;
const VIEWS = { Oblique: "Fit", Top: "Top", Front: "Front", Side: "Side" };
const HELP = "Picture of the print. Arrow keys turn it, with Shift they move it, plus and minus zoom, "
  + "F fits it, 1, 2 and 3 look from the top, the front and the side.";

export async function liveView(host, options) {
  const view = new LiveView(host, options);
  await view.load();
  return view;
}

// The needle, over the picture: moving it draws nothing of the job again.
class Needle {
  constructor(element) {
    this.lines = ["live-halo", "live-shaft"].map((name) => make("svg:line", { class: name }));
    this.svg = make("svg:svg", { class: "live-needle", "aria-hidden": "true" },
      ...this.lines, make("svg:circle", { class: "live-tip", r: "4.5" }));
    element.append(this.svg);
  }

  // The projection is parallel: as long as nobody turns the view, the needle keeps its shape and is
  // only shifted, for which the browser paints nothing again.
  draw(painter) {
    this.svg.style.display = this.place ? "" : "none";
    if (!this.place) return;
    const [x, y] = painter.project(this.place);
    const [a, b] = painter.project([this.place[0], this.place[1], this.place[2] + SHAFT_MM]);
    const shape = [(a - x).toFixed(1), (b - y).toFixed(1)];
    if (`${shape}` !== this.shape) {
      this.shape = `${shape}`;
      for (const line of this.lines) [0, 1].forEach((k) => line.setAttribute(["x2", "y2"][k], shape[k]));
    }
    const at = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
    if (this.svg.style.transform !== at) this.svg.style.transform = at;
  }
}

// What an observer had written again, over the picture: lines of their own, however the job is
// coloured. Drawn through where they lie; dashed until they are executed.
class Mends {
  constructor(element) {
    this.svg = make("svg:svg", { class: "live-mends", "aria-hidden": "true" });
    this.shown = [];
    this.words = "";
    element.append(this.svg);
  }

  take(mends) {
    this.shown = mends.flatMap(({ written, strokes }) => strokes.map((places) => ({
      places,
      lines: ["live-mend-halo", written ? "live-mend" : "live-mend live-mend-ahead"]
        .map((name) => make("svg:polyline", { class: name })),
    })));
    this.svg.replaceChildren(...this.shown.flatMap(({ lines }) => lines));
    const written = mends.filter((one) => one.written).length;
    const count = written === 1 ? "1 mend" : `${written} mends`;
    this.words = mends.length ? ` ${count} written (violet).` : "";
  }

  draw(painter) {
    for (const { places, lines } of this.shown) {
      const points = places.map((place) => painter.project(place)
        .map((px) => px.toFixed(1)).join(",")).join(" ");
      for (const line of lines) {
        if (line.getAttribute("points") !== points) line.setAttribute("points", points);
      }
    }
  }
}

// Buttons, choices, the sliders over layers, and the line of words below the picture.
class Panel {
  constructor(view) {
    this.view = view;
    const { scene: { about }, state, painter, flat } = view;
    const looks = Object.entries(VIEWS).slice(0, flat ? 1 : undefined).map(([look, text]) =>
      button(text, look === "Oblique" ? "Fit the job" : `From the ${text.toLowerCase()}`,
        () => painter.look(look)));
    this.rest = tick("still to come", state.rest, (rest) => view.choose({ rest }));
    this.bar = make("div", { className: "live-bar", role: "group", "aria-label": "View" }, ...looks,
      button("+", "Nearer", () => painter.zoom(ZOOM)),
      button("\u2212", "Farther", () => painter.zoom(1 / ZOOM)),
      ...this.colours(colourings(about)), this.rest,
      tick("travels", state.travels, (travels) => view.choose({ travels })));
    this.words = make("p", { className: "live-words" });
    this.foot = make("div", { className: "live-foot" }, ...this.layers(about), this.words);
  }

  colours(known) {
    if (known.length < 2) return [];
    const select = make("select", {}, ...known.map(([key, name]) => new Option(name, key)));
    select.addEventListener("change", () => this.view.choose({ by: select.value }));
    return [make("label", { className: "live-tick" }, "colour by ", select)];
  }

  layers({ layers, passes }) {
    const count = layers.length;
    if (count < 2) return [];
    this.noun = passes ? ["pass", "passes"] : ["layer", "layers"];
    this.ends = ["First", "Last"].map((which, k) => {
      const range = make("input", { type: "range", min: 1, max: count, value: k ? count : 1,
        "aria-label": `${which} ${this.noun[0]} shown` });
      range.addEventListener("input", () => this.slide(k));
      return range;
    });
    this.range = make("span", { className: "live-range" });
    this.slide(0);
    return [make("div", { className: "live-layers", role: "group",
      "aria-label": `${passes ? "Passes" : "Layers"} shown` }, ...this.ends, this.range)];
  }

  slide(moved) {
    if (Number(this.ends[0].value) > Number(this.ends[1].value)) {
      this.ends[1 - moved].value = this.ends[moved].value;
    }
    const [first, last] = this.ends.map((end) => Number(end.value));
    const { layers, passes } = this.view.scene.about;
    const height = passes ? "" : `, z ${layers[first - 1]} to ${layers[last - 1]} mm`;
    this.range.textContent = `${this.noun[1]} ${first} to ${last} of ${layers.length}${height}`;
    this.view.choose({ layers: [first - 1, last - 1] });
  }

  write(text) {
    if (this.words.textContent !== text) this.words.textContent = text;
  }
}

function button(text, label, action) {
  const given = { type: "button", className: "button", title: label, "aria-label": label };
  const found = make("button", given, text);
  found.addEventListener("click", action);
  return found;
}

function tick(text, checked, action) {
  const box = make("input", { type: "checkbox", checked });
  box.addEventListener("change", () => action(box.checked));
  return make("label", { className: "live-tick" }, box, text);
}

class LiveView {
  constructor(host, options) {
    this.options = { ahead: AHEAD_S, plain: false, ...options };
    this.live = Boolean(options.live);
    this.message = make("p", { className: "live-message", role: "status" }, "Reading the job \u2026");
    this.stage = make("div", { className: "live-stage" }, this.message);
    this.root = make("div", { className: "live-view" }, this.stage);
    host.replaceChildren(this.root);
    this.status = { executed: 0, acknowledged: 0, position: null };
    this.least = { ...LEAST_MS };
    this.last = { needle: -Infinity, picture: -Infinity, words: -Infinity };
  }

  async load() {
    try {
      [this.scene, this.painter] = await Promise.all([
        loadScene(this.options.scene), this.makePainter(),
      ]);
      performance.mark("live-view:moves");
      this.begin();
    } catch (problem) {
      this.message.textContent = problem instanceof SceneProblem ? problem.message
        : `The view can't be drawn: ${problem.message}`;
      this.message.classList.add("live-problem");
      if (!(problem instanceof SceneProblem)) console.error(problem);
    }
  }

  // WebGL where the browser has it, else the plain canvas; its 700 kB only where they are of use.
  async makePainter() {
    const drawer = this.options.plain ? null : webGlDrawer();
    const onView = (painter) => {
      this.mends.draw(painter);
      this.needle.draw(painter);
    };
    this.flat = drawer === null;
    if (this.flat) {
      const { FlatPainter } = await import("live/flat_painter");
      return new FlatPainter(this.stage, { onView });
    }
    const { GlPainter } = await import("live/gl_painter");
    const software = /swiftshader|llvmpipe|software|basic render/i.test(drawer);
    if (software) this.least.picture = SOFTWARE_PICTURE_MS;
    return new GlPainter(this.stage, { software, onView });
  }

  begin() {
    const { about, moves } = this.scene;
    this.state = {
      written: this.live ? 0 : moves, next: this.live ? 0 : moves,
      layers: [0, about.layers.length], rest: true, travels: false,
      by: about.passes && about.vessels > 1 ? "vessel" : "layer",
    };
    this.colour();
    this.painter.take(this.scene);
    this.painter.onDone = () => this.complete();
    this.mends = new Mends(this.stage);
    this.needle = new Needle(this.stage);
    this.panel = new Panel(this);
    this.root.prepend(this.panel.bar);
    this.root.append(this.panel.foot);
    this.panel.rest.hidden = !this.live;
    this.message.remove();
    this.startKeys();
    // The page's theme may change while the view is open.
    this.endTheme = onTheme(() => this.painter.show(this.state));
    if (this.live) this.follow();
    this.speak();
    this.painter.show(this.state);
    this.painter.fit();
  }

  startKeys() {
    this.stage.tabIndex = 0;
    this.stage.setAttribute("role", "application");
    this.stage.setAttribute("aria-label", HELP);
    const look = (name) => () => this.painter.look(name);
    startViewKeys(this.stage, this.painter, {
      f: look("Oblique"), Home: look("Oblique"), 1: look("Top"), 2: look("Front"), 3: look("Side"),
    });
  }

  complete() {
    this.root.dataset.drawn = String(Number(this.root.dataset.drawn ?? 0) + 1);
    if (!this.whole) performance.mark("live-view:drawn");
    this.whole = true;
  }

  // A legend elsewhere on the page shows the colours that are drawn.
  colour() {
    const { state: { by }, scene: { about } } = this;
    this.state.scale = scaleOf(by, about);
    document.documentElement.style.setProperty("--live-written", bandOf(by, about));
  }

  choose(change) {
    Object.assign(this.state, change);
    this.colour();
    this.painter.show(this.state);
  }

  update(news) {
    Object.assign(this.status, news);
    this.live = true;
    if (this.timer || !this.panel) return;
    const wait = Math.max(this.last.needle + this.least.needle - performance.now(), 0);
    this.timer = setTimeout(() => this.tick(), wait);
  }

  tick() {
    this.timer = 0;
    this.panel.rest.hidden = false;
    this.follow();
    this.last.needle = performance.now();
    this.needle.draw(this.painter);
    if (this.isDue("picture")) this.painter.advance(this.state);
    if (this.isDue("words")) this.speak();
    clearTimeout(this.late);
    // The last news of all, when none come after it.
    this.late = setTimeout(() => {
      this.painter.advance(this.state);
      this.speak();
    }, this.least.words);
  }

  isDue(what) {
    const now = performance.now();
    if (now - this.last[what] < this.least[what]) return false;
    this.last[what] = now;
    return true;
  }

  follow() {
    const { executed, acknowledged, position, mends } = this.status;
    const written = movesDone(this.scene, executed);
    this.state.written = written;
    this.state.next = Math.max(
      movesDone(this.scene, acknowledged), movesAhead(this.scene, written, this.options.ahead));
    this.needle.place = position ?? (written ? placeOf(this.scene, written) : null);
    if (mends === this.mended) return;
    this.mended = mends;
    this.mends.take(mends);
    this.mends.draw(this.painter);
  }

  speak() {
    const { about, points } = this.scene;
    if (!this.live) {
      this.panel.write(`${about.name}: the job as planned, ${short(about.commands)} commands.`);
      return;
    }
    const { written } = this.state;
    this.root.dataset.written = written;
    const layer = points[WIDE * written + COLUMN.layer] + 1;
    this.panel.write(`${about.passes ? "pass" : "layer"} ${layer} of `
      + `${about.layers.length}, ${short(this.status.executed)} of ${short(about.commands)} commands `
      + `executed.${this.mends.words}`);
  }

  dispose() {
    clearTimeout(this.timer);
    clearTimeout(this.late);
    this.endTheme?.();
    this.painter?.dispose();
    this.root.remove();
  }
}

// What draws WebGL 2 here; null for nothing.
function webGlDrawer() {
  try {
    const pen = document.createElement("canvas").getContext("webgl2");
    if (!pen) return null;
    const names = pen.getExtension("WEBGL_debug_renderer_info");
    const drawer = pen.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : pen.RENDERER);
    pen.getExtension("WEBGL_lose_context")?.loseContext();
    return String(drawer);
  } catch {
    return null;
  }
}
