// Straight pieces as rounded cones, drawn by instancing: each is the hull of the spheres between
// its ends, so neighbours join without a seam.
import * as THREE from "three";

const PLACING = `
  attribute vec3 from;
  attribute vec3 to;
  attribute vec2 radii;
  attribute vec2 place;
  attribute float end;
  uniform float widen;
  varying float vPlace;

  // Template: position.xy on the unit circle, z the share of this end's cap. The seam between cap
  // and cone lies where the cone touches the sphere: at sin(angle) = (r0 - r1) / length.
  vec3 capsuleWay() {
    vec3 along = to - from;
    float span = length(along);
    vec3 axis = span > 0.0 ? along / span : vec3(0.0, 0.0, 1.0);
    vec3 aside = abs(axis.z) < 0.9 ? vec3(0.0, 0.0, 1.0) : vec3(1.0, 0.0, 0.0);
    vec3 x = normalize(cross(aside, axis));
    vec3 y = cross(axis, x);
    float seam = acos(clamp((radii.x - radii.y) / max(span, 1e-9), -0.99, 0.99));
    float polar = end < 0.5 ? mix(PI, seam, position.z) : mix(seam, 0.0, position.z);
    return sin(polar) * (position.x * x + position.y * y) + cos(polar) * axis;
  }
`;

export function makePieces(network, chosen = null) {
  const geometry = template(chosen ? chosen.length : network.vessel.length);
  const pick = (array, width) => (chosen ? gathered(array, width, chosen) : array);
  const instanced = (array, width) => new THREE.InstancedBufferAttribute(array, width);
  geometry.setAttribute("from", instanced(pick(network.from, 3), 3));
  geometry.setAttribute("to", instanced(pick(network.to, 3), 3));
  geometry.setAttribute("radii", instanced(pick(network.radii, 2), 2));
  geometry.setAttribute("place", instanced(new Float32Array(2 * geometry.instanceCount), 2));
  geometry.boundingBox = network.box;
  geometry.boundingSphere = network.box.getBoundingSphere(new THREE.Sphere());
  return geometry;
}

function gathered(array, width, chosen) {
  const out = new Float32Array(width * chosen.length);
  chosen.forEach((i, k) => out.set(array.subarray(width * i, width * (i + 1)), width * k));
  return out;
}

// Fewer corners where there are many pieces: they are small on the screen.
function template(count) {
  const [sides, rings] = count > 12000 ? [8, 3] : count > 2500 ? [12, 4] : [24, 7];
  const [position, end, index] = [[], [], []];
  for (let ring = 0; ring < 2 * rings; ring++) {
    for (let k = 0; k < sides; k++) {
      const angle = (2 * Math.PI * k) / sides;
      position.push(Math.cos(angle), Math.sin(angle), (ring % rings) / (rings - 1));
      end.push(ring < rings ? 0 : 1);
      if (ring === 0) continue;
      const [a, b] = [(ring - 1) * sides + k, (ring - 1) * sides + ((k + 1) % sides)];
      index.push(a, b, b + sides, a, b + sides, a + sides);
    }
  }
  const geometry = new THREE.InstancedBufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(position, 3));
  geometry.setAttribute("end", new THREE.Float32BufferAttribute(end, 1));
  geometry.setIndex(index);
  geometry.instanceCount = count;
  return geometry;
}

// Teaches a material of three.js to place the template and, with a ramp, to colour it.
export function asCapsules(material, { widen = 1, ramp = null, none = null } = {}) {
  material.onBeforeCompile = (shader) => {
    shader.uniforms.widen = { value: widen };
    shader.uniforms.ramp = ramp ?? { value: null };
    shader.uniforms.none = { value: none ?? new THREE.Color() };
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", `#include <common>\n${PLACING}`)
      .replace("#include <beginnormal_vertex>", "vec3 objectNormal = capsuleWay();")
      .replace("#include <begin_vertex>", `
        vec3 transformed = mix(from, to, end) + widen * mix(radii.x, radii.y, end) * capsuleWay();
        vPlace = mix(place.x, place.y, end);`);
    if (!ramp) return;
    shader.fragmentShader = shader.fragmentShader
      .replace("#include <common>", `#include <common>
        uniform sampler2D ramp; uniform vec3 none; varying float vPlace;`)
      .replace("#include <color_fragment>", `
        diffuseColor.rgb = vPlace < 0.0 ? none : texture2D(ramp, vec2(vPlace, 0.5)).rgb;`);
  };
  return material;
}

// The nearest piece under a ray, as { piece, distance }; kept(point) says what isn't cut away.
// Runs on every stroke of the pointer over all pieces, so it makes no arrays of its own.
export function pieceUnder(network, ray, kept) {
  const { from, to, radii } = network;
  const [o, d] = [ray.origin, ray.direction];
  const point = new THREE.Vector3();
  let best = null;
  for (let i = 0; i < network.vessel.length; i++) {
    const wx = from[3 * i] - o.x;
    const wy = from[3 * i + 1] - o.y;
    const wz = from[3 * i + 2] - o.z;
    const ux = to[3 * i] - from[3 * i];
    const uy = to[3 * i + 1] - from[3 * i + 1];
    const uz = to[3 * i + 2] - from[3 * i + 2];
    const uu = ux * ux + uy * uy + uz * uz;
    const ud = ux * d.x + uy * d.y + uz * d.z;
    const wd = wx * d.x + wy * d.y + wz * d.z;
    const across = uu - ud * ud;
    const wu = wx * ux + wy * uy + wz * uz;
    const t = across > 1e-12 * uu ? Math.min(Math.max((ud * wd - wu) / across, 0), 1) : 0;
    const s = wd + t * ud;
    const x = wx + t * ux - s * d.x;
    const y = wy + t * uy - s * d.y;
    const z = wz + t * uz - s * d.z;
    const r = radii[2 * i] + t * (radii[2 * i + 1] - radii[2 * i]);
    const left = r * r - (x * x + y * y + z * z);
    if (left < 0) continue;
    const distance = s - Math.sqrt(left);
    if (best && distance >= best.distance) continue;
    if (kept(point.copy(o).addScaledVector(d, distance))) best = { piece: i, distance };
  }
  return best;
}
