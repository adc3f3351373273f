// Draws a job by WebGL and keeps the picture: a move that was executed meanwhile is drawn over
// what is there, so that an update costs the same however large the job is. Only a new view, size,
// theme or choice draws everything again, in slices that leave the page free in between.
import * as THREE from "./three.js";
import { Stage } from "./stage.js";
import { MOST_MOVES, Moves, Shared } from "./moves.js";
import { hues, palette } from "./palette.js";

const ON_TOP = 20000; // moves that are drawn over the picture at once
const RIBBON_COST = 3.5; // of a line's, measured with software WebGL
// Each slice puts the whole picture onto the page once more, so that many small ones take longer.
const SLICE = { least: 250000, begin: 1e6, most: 8e6, ms: 400 };
const TURNING_MS = 60; // what a picture may take while it is turned
const FINE_MS = 800; // and while nobody touches it
const STILL_MS = 200;
const POLL_MS = 4;

class KeptStage extends Stage {
  constructor(element, antialias) {
    super(element, { antialias, preserveDrawingBuffer: true, powerPreference: "low-power" });
    this.renderer.autoClear = false;
    this.repaint = () => {};
  }

  look(name) {
    this.sized = "";
    super.look(name);
  }

  // An observer tells the size that was there from the start, too.
  resize() {
    const sized = `${this.element.clientWidth} ${this.element.clientHeight}`;
    if (sized === this.sized) return;
    if (this.fitted) this.sized = sized;
    super.resize();
  }

  // However many reasons there are to draw again before the next frame, it is done once.
  render() { this.draw(); }

  draw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.repaint();
    });
  }
}

export class GlPainter {
  // Everything that can be made ready before the job is there.
  constructor(element, { software, onView }) {
    // Smooth edges cost software WebGL three times as much.
    this.stage = new KeptStage(element, !software);
    this.onView = onView;
    this.onDone = () => {};
    this.cost = software ? 7e-4 : 2e-5; // ms of a line's move, until it is measured
    this.slice = SLICE.begin;
    this.shared = new Shared();
    this.makeMoves();
    this.tryShaders();
    this.stage.controls.addEventListener("start", () => { this.turning = true; });
    this.stage.controls.addEventListener("end", () => this.settle());
    element.addEventListener("wheel", () => this.settle(), { passive: true });
    this.stage.renderer.domElement.addEventListener("webglcontextrestored", () => this.stage.draw());
    this.stage.repaint = () => this.paint();
  }

  tryShaders() {
    this.draw([this.lines.solid.range(0, 1)]);
  }

  take(scene) {
    if (scene.moves > MOST_MOVES) throw new Error(`it has more than ${MOST_MOVES} moves`);
    this.scene = scene;
    this.shared.take(scene);
    this.addOutlines();
  }

  makeMoves() {
    const tint = () => ({ value: new THREE.Vector4(0, 0, 0, 0) });
    this.tints = { ghost: tint(), solid: tint(), next: tint(), way: tint() };
    const looks = {
      ghost: { least: 1, most: 1.5, solid: false, travels: false },
      solid: { least: 1.2, most: 400, solid: true, travels: false },
      next: { least: 2, most: 3, solid: false, travels: false },
      way: { least: 1, most: 1, solid: false, travels: true },
    };
    this.lines = {};
    this.ribbons = {};
    for (const [name, look] of Object.entries(looks)) {
      const said = { ...look, tint: this.tints[name] };
      this.lines[name] = new Moves(this.shared.uniforms, said, false);
      this.ribbons[name] = new Moves(this.shared.uniforms, said, true);
      this.stage.scene.add(this.lines[name].object, this.ribbons[name].object);
    }
  }

  addOutlines() {
    this.rim = new THREE.LineBasicMaterial();
    this.outlines = this.scene.about.outlines.map((line) => {
      const places = line.map((at) => new THREE.Vector3(...at));
      const found = new THREE.Line(new THREE.BufferGeometry().setFromPoints(places), this.rim);
      this.stage.scene.add(found);
      return found;
    });
  }

  // Fits what is written, and what stands on the bed.
  fit() {
    const { about } = this.scene;
    const box = new THREE.Box3(
      new THREE.Vector3(...about.written_low_mm), new THREE.Vector3(...about.written_high_mm),
    );
    for (const at of about.outlines.flat()) box.expandByPoint(new THREE.Vector3(...at));
    box.expandByScalar(0.2);
    this.stage.box = box;
    this.stage.frame(box, [0, 1, 2, 3, 4, 5, 6, 7].flatMap((i) => this.stage.corner(i).toArray()));
  }

  show(state) {
    this.state = state;
    const named = hues(this.stage.element);
    const chosen = palette(state.by, this.scene.about);
    const { table, column, fold, top, layers } = this.shared.uniforms;
    table.value.image.data.set(chosen.table);
    table.value.needsUpdate = true;
    [column.value, fold.value, top.value] = [chosen.column, chosen.fold, chosen.top];
    this.tints.ghost.value.set(...named.ghost.rgb, 0.9);
    this.tints.next.value.set(...named.next.rgb, 1);
    this.tints.way.value.set(...named.way.rgb, 1);
    this.rim.color.setStyle(named.rim.text);
    layers.value.set(...state.layers);
    this.stage.draw();
  }

  // After a stroke or a key: rough while it goes on, all of it once it rests.
  settle() {
    clearTimeout(this.still);
    this.turning = true;
    this.still = setTimeout(() => {
      this.turning = false;
      this.stage.draw();
    }, STILL_MS);
  }

  // Everything, from an empty picture.
  paint() {
    if (!this.state || !this.scene) return;
    // What was asked for can't be taken back: more on top of it would only make a queue.
    this.again = this.pending;
    if (this.pending) return;
    clearTimeout(this.still);
    this.measure();
    const all = this.cost * this.scene.moves;
    const ribbons = RIBBON_COST * all < (this.turning ? TURNING_MS : 2 * TURNING_MS);
    const every = this.turning && !ribbons ? Math.max(1, Math.ceil(all / TURNING_MS)) : 1;
    this.stage.renderer.clear();
    this.draw(this.outlines);
    this.begin(ribbons, every);
  }

  // Ribbons over the lines that are there, where the machine is quick enough for so many.
  refine() {
    const all = RIBBON_COST * this.cost * this.scene.moves;
    if (!this.turning && !this.pending && all < FINE_MS) this.begin(true, 1);
  }

  begin(ribbons, every) {
    const { written, next, rest, travels } = this.state;
    this.kind = ribbons ? this.ribbons : this.lines;
    this.every = every;
    this.painted = { written, next: Math.max(written, next) };
    this.done = false;
    const { moves } = this.scene;
    const left = [
      ...(rest ? [["ghost", written, moves]] : []), ["solid", 0, written],
      ...(travels ? [["way", 0, moves]] : []),
    ].filter(([, first, last]) => last > first);
    this.paintSlice(left);
  }

  paintSlice(left) {
    const begin = performance.now();
    const most = this.slice * this.every / (this.kind === this.ribbons ? RIBBON_COST : 1);
    let drawn = 0;
    while (left.length && drawn < most) {
      const [name, first, last] = left[0];
      const end = Math.min(last, first + Math.ceil(most - drawn));
      this.drawMoves(this.kind[name], first, end);
      drawn += end - first;
      if (end === last) left.shift();
      else left[0][1] = end;
    }
    this.shared.uniforms.every.value = 1;
    this.onView(this);
    this.after(() => {
      this.pace(performance.now() - begin, drawn / this.every);
      if (left.length) this.paintSlice(left);
      else this.finish();
    });
  }

  drawMoves(moves, first, last) {
    this.shared.uniforms.every.value = moves.ribbons ? 1 : this.every;
    this.draw([moves.range(first, last, this.every)]);
  }

  // Does something when the drawing is done, not merely asked for; or begins again.
  after(action) {
    const gl = this.stage.renderer.getContext();
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    this.pending = true;
    const poll = () => {
      const waits = !gl.isContextLost() && gl.clientWaitSync(fence, 0, 0) === gl.TIMEOUT_EXPIRED;
      if (waits) {
        setTimeout(poll, POLL_MS);
        return;
      }
      gl.deleteSync(fence);
      this.pending = false;
      if (this.again) this.stage.draw();
      else if (!this.gone) requestAnimationFrame(action);
    };
    poll();
  }

  pace(took, drawn) {
    if (drawn < SLICE.least / 2) return; // too few to tell
    this.cost = took / drawn / (this.kind === this.ribbons ? RIBBON_COST : 1);
    this.slice = Math.min(Math.max(SLICE.ms / this.cost, SLICE.least), SLICE.most);
  }

  finish() {
    this.done = true;
    const { written, next } = this.painted;
    if (next > written) this.drawMoves(this.ribbons.next, written, next);
    this.onDone();
    this.advance(this.state);
    if (this.kind === this.lines) this.still = setTimeout(() => this.refine(), STILL_MS);
  }

  draw(objects) {
    for (const one of this.stage.scene.children) one.visible = objects.includes(one);
    this.stage.renderer.render(this.stage.scene, this.stage.camera);
  }

  measure() {
    const { renderer, element, camera } = this.stage;
    const ratio = renderer.getPixelRatio();
    const half = [element.clientWidth, element.clientHeight].map((px) => (px * ratio) / 2);
    this.shared.uniforms.half_px.value.set(...half);
    this.shared.uniforms.px_per_mm.value = this.stage.pixelsPerMm() * ratio;
    camera.updateMatrixWorld();
  }

  // What was executed meanwhile, on top of the picture.
  advance(state) {
    this.state = state;
    if (!this.done) return;
    const { written, next } = this.painted;
    const ahead = Math.max(state.next, state.written);
    if (state.written < written || ahead < next || state.written - written > ON_TOP) {
      this.stage.draw();
      return;
    }
    if (ahead === next && state.written === written) return;
    if (state.written > written) this.drawMoves(this.kind.solid, written, state.written);
    // All of it, since what was just written may lie over a part.
    if (ahead > state.written) this.drawMoves(this.ribbons.next, state.written, ahead);
    this.painted = { written: state.written, next: ahead };
  }

  // Where a place is seen, in CSS pixels of the view.
  project(place) {
    const at = new THREE.Vector3(...place).project(this.stage.camera);
    const { clientWidth, clientHeight } = this.stage.element;
    return [((at.x + 1) / 2) * clientWidth, ((1 - at.y) / 2) * clientHeight];
  }

  look(name) { this.stage.look(name); }
  hold(held) { this.stage.takeHold(held); }
  orbit(across, up) { this.settle(); this.stage.orbit(across, up); }
  pan(across, up) { this.settle(); this.stage.pan(across, up); }
  zoom(factor) { this.settle(); this.stage.zoom(factor); }

  dispose() {
    this.gone = true;
    clearTimeout(this.still);
    this.stage.controls.dispose();
    this.stage.renderer.dispose();
    this.stage.renderer.domElement.remove();
  }
}
