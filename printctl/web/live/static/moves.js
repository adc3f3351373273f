// Moves as lines and as ribbons. All numbers of a job lie in one texture, and a vertex knows by its
// own number which move it belongs to: nothing is stored twice, a range of moves is a draw range,
// and no instances are needed, of which software WebGL draws only 50 000 a second.
import * as THREE from "./three.js";
import { ACT, WIDE } from "./scene.js";

const ROW = 4096; // texels; two hold a point
export const MOST_MOVES = (ROW * 8192) / 2 - 1;

const COMMON = `
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
  uniform float fold;
  uniform float top;
  uniform vec4 tint;
  uniform sampler2D table;

  uvec4 number(int point, int half_of) {
    int at = 2 * point + half_of;
    return texelFetch(points, ivec2(at & ${ROW - 1}, at >> ${Math.log2(ROW)}), 0);
  }
  vec4 seen_at(uvec4 place) {
    return projectionMatrix * (modelViewMatrix * vec4(low + size * vec3(place.xyz), 1.0));
  }
  bool shown(float layer, uint act) {
    return (act == ${ACT.WRITE}u) != travels && act != ${ACT.JUMP}u
      && layer >= layers.x && layer <= layers.y;
  }
  vec3 colour_of(float layer, uvec4 info) {
    float value = column == 3 ? layer : column == 4 ? float(info.x) : float(info.y);
    float texel = fold > 0.0 ? mod(value, fold) : floor(value / top * 255.0 + 0.5);
    return mix(texelFetch(table, ivec2(int(texel), 0), 0).rgb, tint.rgb, tint.a);
  }
`;

const LINE = `
  uniform int every;        // of so many moves one is drawn
  flat out vec3 colour;
  void main() {
    int move = (gl_VertexID >> 1) * every;
    uvec4 end = number(move + 1, 0);
    uvec4 info = number(move + 1, 1);
    float layer = float(end.w);
    colour = colour_of(layer, info);
    uvec4 place = (gl_VertexID & 1) == 0 ? number(move, 0) : end;
    gl_Position = shown(layer, info.w) ? seen_at(place) : vec4(2.0, 2.0, 2.0, 1.0);
  }
`;

const RIBBON = `
  uniform vec2 half_px;     // half the picture
  uniform float px_per_mm;
  uniform vec2 width_px;    // least and most
  uniform float usual_um;
  flat out vec3 colour;
  out float across;
  flat out float round_off;
  void main() {
    int move = gl_VertexID / 6;
    int corner = gl_VertexID - 6 * move; // two triangles: 0 1 2, 2 1 3
    corner = corner < 3 ? corner : corner == 3 ? 2 : corner == 4 ? 1 : 3;
    uvec4 end = number(move + 1, 0);
    uvec4 info = number(move + 1, 1);
    float layer = float(end.w);
    if (!shown(layer, info.w)) {
      gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
      return;
    }
    vec4 a = seen_at(number(move, 0));
    vec4 b = seen_at(end);
    vec2 way = (b.xy - a.xy) * half_px;
    float far = length(way);
    vec2 ahead = far > 1e-4 ? way / far : vec2(1.0, 0.0);
    float um = info.z > 0u ? float(info.z) : usual_um;
    float wide = 0.5 * clamp(um * 1e-3 * px_per_mm, width_px.x, width_px.y);
    vec2 side = vec2(float(corner >> 1), 2.0 * float(corner & 1) - 1.0);
    gl_Position = mix(a, b, side.x);
    gl_Position.xy += (vec2(-ahead.y, ahead.x) * side.y + ahead * (2.0 * side.x - 1.0))
      * wide / half_px;
    colour = colour_of(layer, info);
    across = side.y;
    round_off = wide > 1.2 ? 0.45 : 0.0;
  }
`;

const FLAT = `
  precision mediump float;
  flat in vec3 colour;
  out vec4 seen;
  void main() { seen = vec4(colour, 1.0); }
`;

const ROUND = `
  precision mediump float;
  flat in vec3 colour;
  in float across;
  flat in float round_off;
  out vec4 seen;
  void main() {
    float rim = 1.0 - sqrt(max(1.0 - across * across, 0.0));
    seen = vec4(colour * (1.0 - round_off * rim), 1.0);
  }
`;

function pointTexture(points) {
  const height = Math.ceil(points.length / (4 * ROW));
  const data = new Uint16Array(4 * ROW * height);
  data.set(points);
  const texture = new THREE.DataTexture(data, ROW, height, THREE.RGBAIntegerFormat,
    THREE.UnsignedShortType);
  texture.internalFormat = "RGBA16UI";
  texture.needsUpdate = true;
  return texture;
}

// What all looks of a view share; each has its own tint, widths and kind of move besides. Until
// `take` it is one move of no length, by which the shaders can be tried before the job is there.
export class Shared {
  constructor() {
    this.uniforms = {
      points: { value: pointTexture(new Uint16Array(2 * WIDE)) },
      low: { value: new THREE.Vector3() },
      size: { value: new THREE.Vector3(1, 1, 1) },
      half_px: { value: new THREE.Vector2(1, 1) },
      px_per_mm: { value: 1 },
      layers: { value: new THREE.Vector2(0, 1) },
      usual_um: { value: 200 },
      column: { value: 3 },
      fold: { value: 0 },
      top: { value: 1 },
      every: { value: 1 },
      table: { value: new THREE.DataTexture(new Uint8Array(4 * 256), 256, 1) },
    };
  }

  take(scene) {
    const { points, low, size, usual_um } = this.uniforms;
    points.value.dispose();
    points.value = pointTexture(scene.points);
    low.value.set(...scene.about.low_mm);
    size.value.set(...scene.about.step_mm);
    const widths = sampleWidths(scene);
    if (widths.length) usual_um.value = widths[widths.length >> 1];
  }
}

function sampleWidths({ points, moves }) {
  const found = [];
  for (let i = 1; i <= moves; i += Math.ceil(moves / 500)) {
    if (points[WIDE * i + 6]) found.push(points[WIDE * i + 6]);
  }
  return found.sort((a, b) => a - b);
}

// Moves in one look: `draw(first, last)` says which, `every` is for lines alone.
export class Moves {
  constructor(shared, look, ribbons) {
    this.ribbons = ribbons;
    this.corners = ribbons ? 6 : 2;
    const geometry = new THREE.BufferGeometry();
    geometry.boundingSphere = new THREE.Sphere();
    this.material = new THREE.RawShaderMaterial({
      glslVersion: THREE.GLSL3,
      vertexShader: COMMON + (ribbons ? RIBBON : LINE),
      fragmentShader: ribbons ? ROUND : FLAT,
      side: THREE.DoubleSide,
      depthWrite: look.solid,
      uniforms: {
        ...shared,
        tint: look.tint,
        width_px: { value: new THREE.Vector2(look.least, look.most) },
        travels: { value: look.travels },
      },
    });
    const Kind = ribbons ? THREE.Mesh : THREE.LineSegments;
    this.object = new Kind(geometry, this.material);
    this.object.frustumCulled = false;
  }

  range(first, last, every = 1) {
    const [begin, end] = this.ribbons ? [first, last]
      : [Math.ceil(first / every), Math.ceil(last / every)];
    this.object.geometry.setDrawRange(this.corners * begin, this.corners * (end - begin));
    return this.object;
  }
}
