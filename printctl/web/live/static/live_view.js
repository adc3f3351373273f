// The live view of a print: what has been written, the needle, what comes next.
//
//   const view = await liveView(element, { scene: "live/JOB/scene", source: "api/v1/events" });
//   view.update({ executed: 1200, acknowledged: 1230, position: [10.2, 4.1, 0.3] });
//
// `executed` and `acknowledged` count commands of the file as the link does. Only what was executed
// is drawn as written. `mends` are lines that were put in (`mends.js`). With `job`, events that name another one are left out. Without `live` or `source` the whole job is drawn as planned.
import { Feed } from "./feed.js";
import { Mends } from "./mends.js";
import { Needle } from "./needle.js";
import { Panel, element, listenToKeys } from "./panel.js";
import { SceneProblem, loadScene, movesAhead, movesDone, placeOf } from "./scene.js";

// While a print goes on, between two places of the needle, two pictures and two sentences. A picture
// costs a browser without a graphics card ten times what the needle does: there it comes half as often.
const LEAST_MS = { needle: 200, picture: 500, words: 1000 };
const SOFTWARE_PICTURE_MS = 1000;
const AHEAD_S = 10; // what comes next
const HELP = "Picture of the print. Arrow keys turn it, with Shift they move it, plus and minus zoom, "
  + "F fits it, 1, 2 and 3 look from the top, the front and the side.";

export async function liveView(host, options) {
  const view = new LiveView(host, options);
  await view.load();
  return view;
}

class LiveView {
  constructor(host, options) {
    this.options = { ahead: AHEAD_S, plain: false, ...options };
    this.live = Boolean(options.live || options.source);
    this.root = element("div", "live-view");
    this.stage = element("div", "live-stage");
    this.message = element("p", "live-message", "Reading the job \u2026");
    this.message.setAttribute("role", "status");
    this.stage.append(this.message);
    this.root.append(this.stage);
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
    if (drawer === null) {
      const { FlatPainter } = await import("./flat_painter.js");
      return new FlatPainter(this.stage, { onView });
    }
    const { GlPainter } = await import("./gl_painter.js");
    const software = /swiftshader|llvmpipe|software|basic render/i.test(drawer);
    if (software) this.least.picture = SOFTWARE_PICTURE_MS;
    return new GlPainter(this.stage, { software, onView });
  }

  begin() {
    const { about, moves } = this.scene;
    this.state = {
      written: this.live ? 0 : moves, next: this.live ? 0 : moves,
      layers: [0, about.layers.length], by: about.passes ? "vessel" : "layer",
      rest: true, travels: false,
    };
    if (about.passes && about.vessels < 2) this.state.by = "layer";
    this.painter.take(this.scene);
    this.painter.onDone = () => this.complete();
    this.flat = !this.painter.stage;
    this.mends = new Mends(this.stage);
    this.needle = new Needle(this.stage);
    this.panel = new Panel(this, this.flat);
    this.root.prepend(this.panel.bar);
    this.root.append(this.panel.foot);
    if (!this.live) this.panel.rest.hidden = true;
    this.message.remove();
    this.makeOperable();
    this.watchTheme();
    if (this.live) this.follow();
    this.speak();
    this.painter.show(this.state);
    this.painter.fit();
    if (this.options.source) {
      this.feed = new Feed(this.options.source, (said) => this.hear(said), (on) => this.line(on));
    }
  }

  makeOperable() {
    Object.assign(this.stage, { tabIndex: 0 });
    this.stage.setAttribute("role", "application");
    this.stage.setAttribute("aria-label", HELP);
    listenToKeys(this.stage, this);
    this.stage.addEventListener("pointerdown", () => this.painter.hold(true));
    this.stage.addEventListener("blur", () => this.painter.hold(false));
  }

  // The page's theme may change while the view is open.
  watchTheme() {
    const again = () => this.painter.show(this.state);
    this.themes = new MutationObserver(again);
    for (const one of [document.documentElement, document.body]) {
      this.themes.observe(one, { attributes: true, attributeFilter: ["class", "data-theme"] });
    }
    this.dark = window.matchMedia("(prefers-color-scheme: dark)");
    this.again = again;
    this.dark.addEventListener("change", again);
  }

  complete() {
    this.root.dataset.drawn = String(Number(this.root.dataset.drawn ?? 0) + 1);
    if (this.whole) return;
    this.whole = true;
    performance.mark("live-view:drawn");
  }

  choose(change) {
    Object.assign(this.state, change);
    this.painter.show(this.state);
  }

  // News of another job's print aren't this one's.
  hear(said) {
    const { job } = this.options;
    if (!job || said.job === undefined || said.job === job) this.update(said);
  }

  // Takes this view's own names, or a print event as the server sends it.
  update(said) {
    const taken = {
      executed: said.executed ?? fileCount(said.lines_executed, said.inserted),
      acknowledged: said.acknowledged ?? fileCount(said.lines_done, said.inserted),
      position: said.position ?? said.position_mm,
    };
    for (const [name, value] of Object.entries(taken)) {
      if (value !== undefined && value !== null) this.status[name] = value;
    }
    if (said.mends) this.status.mends = said.mends;
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
    this.late = setTimeout(() => this.settle(), this.least.words);
  }

  isDue(what) {
    const now = performance.now();
    if (now - this.last[what] < this.least[what]) return false;
    this.last[what] = now;
    return true;
  }

  // The last news of all, when none come after it.
  settle() {
    this.painter.advance(this.state);
    this.speak();
  }

  follow() {
    const { executed, acknowledged, position } = this.status;
    this.state.written = movesDone(this.scene, executed);
    this.state.next = Math.max(
      movesDone(this.scene, acknowledged), movesAhead(this.scene, this.state.written, this.options.ahead),
    );
    const last = this.state.written ? placeOf(this.scene, this.state.written) : null;
    this.needle.moveTo(position ?? last);
    if (this.status.mends !== this.mended) {
      this.mended = this.status.mends;
      this.mends.take(this.mended);
      this.mends.draw(this.painter);
    }
  }

  line(on) {
    this.lost = on ? "" : `No news of the print since ${new Date().toLocaleTimeString()}. `;
    this.root.classList.toggle("live-lost", !on);
    this.speak();
  }

  speak() {
    const { about, points } = this.scene;
    const count = (value) => value.toLocaleString("en").replaceAll(",", "\u202f");
    if (!this.live) {
      this.panel.say(`${about.name}: the job as planned, ${count(about.commands)} commands.`);
      return;
    }
    const { executed } = this.status;
    this.root.dataset.written = this.state.written;
    const layer = points[8 * this.state.written + 3] + 1;
    const noun = about.passes ? "pass" : "layer";
    this.panel.say(`${this.lost ?? ""}${noun} ${layer} of ${about.layers.length}, `
      + `${count(executed)} of ${count(about.commands)} commands executed.${this.mends.said}`);
  }

  dispose() {
    clearTimeout(this.timer);
    clearTimeout(this.late);
    this.feed?.close();
    this.themes?.disconnect();
    this.dark?.removeEventListener("change", this.again);
    this.painter?.dispose();
    this.root.remove();
  }
}

// What draws WebGL 2 here; null for nothing.
// How many of a job's lines are the file's own: an observer may have inserted some.
function fileCount(done, inserted) {
  if (done === undefined || done === null) return done;
  const before = ([after, count]) => Math.min(Math.max(done - after, 0), count);
  return (inserted ?? []).reduce((left, one) => left - before(one), done);
}

function webGlDrawer() {
  try {
    const pen = document.createElement("canvas").getContext("webgl2");
    if (!pen) return null;
    const names = pen.getExtension("WEBGL_debug_renderer_info");
    const said = pen.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : pen.RENDERER);
    pen.getExtension("WEBGL_lose_context")?.loseContext();
    return String(said);
  } catch {
    return null;
  }
}
