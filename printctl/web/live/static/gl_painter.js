// Draws a job by WebGL and keeps the picture: a move that was executed meanwhile is drawn over
// what is there, so that an update costs the same however large the job is. Only a new view, size,
// theme or choice draws everything again, in slices that leave the page free in between.
import * as THREE from "three";
import { ACT } from "viewer/lines";
import { hues } from "viewer/page";
import { rgbOf } from "viewer/scale";
import { Stage } from "viewer/stage";
import { COLUMN, HUES, TEXELS, USUAL_UM, WIDE, painted, partsOf, placesOf } from "live/scene";

const ROW = 4096; // texels of the points' texture; two hold a point
const MAX_MOVES = (ROW * 8192) / 2 - 1;
const MAX_ON_TOP = 20000; // moves that are drawn over the picture at once
const RIBBON_COST = 3.5; // of a line's, measured with software WebGL
// Each slice puts the whole picture onto the page once more, so that many small ones take longer.
const SLICE = { least: 250000, begin: 1e6, most: 8e6, ms: 400 };
const TURNING_MS = 60; // what a picture may take while it is turned
const FINE_MS = 800; // and while nobody touches it
const STILL_MS = 200;
const POLL_MS = 4;
// Least and most width in pixels, whether the nearer hides the farther, whether of travels.
const LOOKS = {
  ghost: { width: [1, 1.5] }, solid: { width: [1.2, 400], solid: true },
  next: { width: [2, 3] }, way: { width: [1, 1], travels: true },
};

// All numbers of a job lie in one texture, and a vertex knows by its own number which move it belongs
// to: nothing is stored twice, a range of moves is a draw range, and no instances are needed, of which
// software WebGL draws only 50 000 a second. A move is a line (2 corners) or a ribbon (6).
const VERTEX = `
  precision highp float;
  precision highp int;
  precision highp usampler2D;
  uniform usampler2D points;
  uniform mat4 modelViewMatrix;
  uniform mat4 projectionMatrix;
  uniform vec3 low;
  uniform vec3 size;        // mm of a step
  uniform vec2 layers;
  uniform bool travels;
  uniform int column;
  uniform float fold;       // how many colours take turns; 0: they follow the ramp up to top
  uniform float top;
  uniform vec4 tint;
  uniform sampler2D table;
  uniform int every;        // of so many lines one is drawn
  uniform vec2 half_px;     // half the picture
  uniform float px_per_mm;
  uniform vec2 width_px;    // least and most
  uniform float usual_um;
  flat out vec3 colour;
  #if RIBBONS == 1
  out float across;
  flat out float round_off;
  #endif

  uvec4 number(int point, int half_of) {
    int at = 2 * point + half_of;
    return texelFetch(points, ivec2(at & ${ROW - 1}, at >> ${Math.log2(ROW)}), 0);
  }
  vec4 seen_at(uvec4 place) {
    return projectionMatrix * (modelViewMatrix * vec4(low + size * vec3(place.xyz), 1.0));
  }
  void main() {
    int move = RIBBONS == 1 ? gl_VertexID / 6 : (gl_VertexID >> 1) * every;
    uvec4 end = number(move + 1, 0);
    uvec4 info = number(move + 1, 1);
    float layer = float(end.w);
    bool shown = (info.w == ${ACT.WRITE}u) != travels && info.w != ${ACT.JUMP}u
      && layer >= layers.x && layer <= layers.y;
    if (!shown) {
      gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
      return;
    }
    float value = column == ${COLUMN.layer} ? layer : float(column == ${COLUMN.vessel} ? info.x : info.y);
    float texel = fold > 0.0 ? mod(value, fold) : floor(value / top * ${TEXELS - 1}.0 + 0.5);
    colour = mix(texelFetch(table, ivec2(int(texel), 0), 0).rgb, tint.rgb, tint.a);
    #if RIBBONS == 0
    gl_Position = seen_at((gl_VertexID & 1) == 0 ? number(move, 0) : end);
    #else
    int corner = gl_VertexID - 6 * move; // two triangles: 0 1 2, 2 1 3
    corner = corner < 3 ? corner : corner == 3 ? 2 : corner == 4 ? 1 : 3;
    vec4 a = seen_at(number(move, 0));
    vec4 b = seen_at(end);
    vec2 way = (b.xy - a.xy) * half_px;
    float far = length(way);
    vec2 ahead = far > 1e-4 ? way / far : vec2(1.0, 0.0);
    float um = info.z > 0u ? float(info.z) : usual_um;
    float wide = 0.5 * clamp(um * 1e-3 * px_per_mm, width_px.x, width_px.y);
    vec2 side = vec2(float(corner >> 1), 2.0 * float(corner & 1) - 1.0);
    gl_Position = mix(a, b, side.x);
    gl_Position.xy += (vec2(-ahead.y, ahead.x) * side.y + ahead * (2.0 * side.x - 1.0)) * wide / half_px;
    across = side.y;
    round_off = wide > 1.2 ? 0.45 : 0.0;
    #endif
  }
`;

const FRAGMENT = `
  precision mediump float;
  flat in vec3 colour;
  out vec4 seen;
  #if RIBBONS == 1
  in float across;
  flat in float round_off;
  #endif
  void main() {
    seen = vec4(colour, 1.0);
    #if RIBBONS == 1
    seen.rgb *= 1.0 - round_off * (1.0 - sqrt(max(1.0 - across * across, 0.0)));
    #endif
  }
`;

function pointTexture(points) {
  const height = Math.ceil(points.length / (4 * ROW));
  const data = new Uint16Array(4 * ROW * height);
  data.set(points);
  const texture = new THREE.DataTexture(data, ROW, height, THREE.RGBAIntegerFormat, THREE.UnsignedShortType);
  return Object.assign(texture, { internalFormat: "RGBA16UI", needsUpdate: true });
}

// Median width of some moves that say one.
function usualWidth({ points, moves }) {
  const found = [];
  for (let i = 1; i <= moves; i += Math.ceil(moves / 500)) {
    if (points[WIDE * i + COLUMN.width]) found.push(points[WIDE * i + COLUMN.width]);
  }
  return found.sort((a, b) => a - b)[found.length >> 1] ?? USUAL_UM;
}

export class GlPainter extends Stage {
  // Everything that can be made ready before the job is there.
  constructor(element, { software, onView }) {
    // Smooth edges cost software WebGL three times as much.
    super(element, { antialias: !software, preserveDrawingBuffer: true, powerPreference: "low-power" });
    this.renderer.autoClear = false;
    this.onView = onView;
    this.cost = software ? 7e-4 : 2e-5; // ms of a line's move, until it is measured
    this.slice = SLICE.begin;
    this.makeMoves();
    this.drawMoves("solid", false, 0, 1); // compiles the shaders
    this.controls.addEventListener("start", () => { this.turning = true; });
    this.controls.addEventListener("end", () => this.settle());
    element.addEventListener("wheel", () => this.settle(), { passive: true });
  }

  makeMoves() {
    // Until `take` there is one move of no length.
    this.uniforms = {
      points: pointTexture(new Uint16Array(2 * WIDE)), low: new THREE.Vector3(),
      size: new THREE.Vector3(1, 1, 1), half_px: new THREE.Vector2(1, 1), px_per_mm: 1,
      layers: new THREE.Vector2(0, 1), usual_um: USUAL_UM, column: COLUMN.layer, fold: 0, top: 1,
      every: 1, table: new THREE.DataTexture(new Uint8Array(4 * TEXELS), TEXELS, 1),
    };
    for (const [name, value] of Object.entries(this.uniforms)) this.uniforms[name] = { value };
    this.moves = {};
    for (const [name, { width, solid = false, travels = false }] of Object.entries(LOOKS)) {
      const own = { tint: { value: new THREE.Vector4(0, 0, 0, 0) }, travels: { value: travels },
        width_px: { value: new THREE.Vector2(...width) } };
      this.moves[name] = [false, true].map((ribbons) => {
        const material = new THREE.RawShaderMaterial({
          glslVersion: THREE.GLSL3, vertexShader: VERTEX, fragmentShader: FRAGMENT,
          side: THREE.DoubleSide, depthWrite: solid, defines: { RIBBONS: Number(ribbons) },
          uniforms: { ...this.uniforms, ...own },
        });
        const geometry = new THREE.BufferGeometry();
        geometry.boundingSphere = new THREE.Sphere();
        const object = new (ribbons ? THREE.Mesh : THREE.LineSegments)(geometry, material);
        object.frustumCulled = false;
        this.scene.add(object);
        return object;
      });
    }
  }

  take(scene) {
    if (scene.moves > MAX_MOVES) throw new Error(`it has more than ${MAX_MOVES} moves`);
    this.job = scene;
    const { points, low, size, usual_um } = this.uniforms;
    points.value.dispose();
    points.value = pointTexture(scene.points);
    low.value.set(...scene.about.low_mm);
    size.value.set(...scene.about.step_mm);
    usual_um.value = usualWidth(scene);
    this.rim = new THREE.LineBasicMaterial();
    this.outlines = scene.about.outlines.map((line) => {
      const places = line.map((at) => new THREE.Vector3(...at));
      return new THREE.Line(new THREE.BufferGeometry().setFromPoints(places), this.rim);
    });
    this.scene.add(...this.outlines);
  }

  // Fits what is written, and what stands on the bed.
  fit() {
    const places = placesOf(this.job.about).map((at) => new THREE.Vector3(...at));
    this.box.setFromPoints(places).expandByScalar(0.2);
    this.frame(this.box, this.corners());
  }

  look(name) {
    this.sized = "";
    super.look(name);
  }

  // An observer reports the size that was there from the start, too.
  resize() {
    const sized = `${this.element.clientWidth} ${this.element.clientHeight}`;
    if (sized === this.sized) return;
    if (this.fitted) this.sized = sized;
    super.resize();
  }

  show(state) {
    this.state = state;
    const rgb = hues(HUES, this.element, "--live-");
    for (const [name, strength] of [["ghost", 0.9], ["next", 1], ["way", 1]]) {
      const parts = rgbOf(rgb[name]).map((part) => part / 255);
      for (const { material } of this.moves[name]) material.uniforms.tint.value.set(...parts, strength);
    }
    this.rim.color.setStyle(rgb.rim);
    const { table, column, fold, top, layers } = this.uniforms;
    const colours = state.scale.table(TEXELS);
    table.value.image.data.set(colours.flatMap((parts) => [...parts.map(Math.round), 255]));
    table.value.needsUpdate = true;
    column.value = COLUMN[state.by];
    [fold.value, top.value] = [state.scale.named ? colours.length : 0, state.scale.high];
    layers.value.set(...state.layers);
    this.draw();
  }

  // However many reasons there are to draw again before the next frame, it is done once.
  render() { this.draw(); }

  draw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.paint();
    });
  }

  // After a stroke or a key: rough while it goes on, all of it once it rests.
  settle() {
    clearTimeout(this.still);
    this.turning = true;
    this.still = setTimeout(() => {
      this.turning = false;
      this.draw();
    }, STILL_MS);
  }

  orbit(across, up) { this.settle(); super.orbit(across, up); }
  pan(across, up) { this.settle(); super.pan(across, up); }
  zoom(factor) { this.settle(); super.zoom(factor); }

  // Everything, from an empty picture.
  paint() {
    if (!this.state || !this.job) return;
    // What the browser was given can't be taken back: more on top of it would only make a queue.
    this.again = this.pending;
    if (this.pending) return;
    clearTimeout(this.still);
    this.measure();
    const all = this.cost * this.job.moves;
    const ribbons = RIBBON_COST * all < (this.turning ? TURNING_MS : 2 * TURNING_MS);
    const every = this.turning && !ribbons ? Math.max(1, Math.ceil(all / TURNING_MS)) : 1;
    this.renderer.clear();
    this.drawOnly(this.outlines);
    this.begin(ribbons, every);
  }

  measure() {
    const ratio = this.renderer.getPixelRatio();
    const half = [this.element.clientWidth, this.element.clientHeight].map((px) => (px * ratio) / 2);
    this.uniforms.half_px.value.set(...half);
    this.uniforms.px_per_mm.value = this.pixelsPerMm() * ratio;
    this.camera.updateMatrixWorld();
  }

  begin(ribbons, every) {
    const { written, next } = this.state;
    Object.assign(this, { ribbons, every, done: false, painted: { written, next: Math.max(written, next) } });
    this.paintSlice(partsOf(this.state, this.job.moves));
  }

  paintSlice(left) {
    const begin = performance.now();
    const most = this.slice * this.every / (this.ribbons ? RIBBON_COST : 1);
    let drawn = 0;
    while (left.length && drawn < most) {
      const [name, first, last] = left[0];
      const end = Math.min(last, first + Math.ceil(most - drawn));
      this.drawMoves(name, this.ribbons, first, end, this.every);
      drawn += end - first;
      if (end === last) left.shift();
      else left[0][1] = end;
    }
    this.onView(this);
    this.after(() => {
      this.pace(performance.now() - begin, drawn / this.every);
      if (left.length) this.paintSlice(left);
      else this.finish();
    });
  }

  drawMoves(name, ribbons, first, last, every = 1) {
    const object = this.moves[name][Number(ribbons)];
    const step = ribbons ? 1 : every;
    const [corners, begin, end] = [ribbons ? 6 : 2, Math.ceil(first / step), Math.ceil(last / step)];
    object.geometry.setDrawRange(corners * begin, corners * (end - begin));
    this.uniforms.every.value = step;
    this.drawOnly([object]);
  }

  drawOnly(objects) {
    for (const one of this.scene.children) one.visible = objects.includes(one);
    this.renderer.render(this.scene, this.camera);
  }

  // Does something when the drawing is done, not merely begun; or begins again.
  after(action) {
    const gl = this.renderer.getContext();
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    this.pending = true;
    const poll = () => {
      if (!gl.isContextLost() && gl.clientWaitSync(fence, 0, 0) === gl.TIMEOUT_EXPIRED) {
        setTimeout(poll, POLL_MS);
        return;
      }
      gl.deleteSync(fence);
      this.pending = false;
      if (this.again) this.draw();
      else if (!this.gone) requestAnimationFrame(action);
    };
    poll();
  }

  // Measures what a move costs.
  pace(took, drawn) {
    if (drawn < SLICE.least / 2) return; // too few to tell
    this.cost = took / drawn / (this.ribbons ? RIBBON_COST : 1);
    this.slice = Math.min(Math.max(SLICE.ms / this.cost, SLICE.least), SLICE.most);
  }

  finish() {
    this.done = true;
    const { written, next } = this.painted;
    if (next > written) this.drawMoves("next", true, written, next);
    this.onDone?.();
    this.advance(this.state);
    if (!this.ribbons) this.still = setTimeout(() => this.refine(), STILL_MS);
  }

  // Ribbons over the lines that are there, where the machine is quick enough for so many.
  refine() {
    const all = RIBBON_COST * this.cost * this.job.moves;
    if (!this.turning && !this.pending && all < FINE_MS) this.begin(true, 1);
  }

  // What was executed meanwhile, on top of the picture.
  advance(state) {
    this.state = state;
    const step = this.done && painted(this, MAX_ON_TOP);
    if (!step) return;
    if (step.solid[1] > step.solid[0]) this.drawMoves("solid", this.ribbons, ...step.solid);
    if (step.next[1] > step.next[0]) this.drawMoves("next", true, ...step.next);
  }

  dispose() {
    this.gone = true;
    clearTimeout(this.still);
    this.observer.disconnect();
    this.controls.dispose();
    this.renderer.dispose();
    this.canvas.remove();
  }
}
