// A network at true radius, coloured by a quantity of each vessel or along it. Straight pieces are
// rounded cones, drawn by instancing: each is the hull of the spheres between its ends, so neighbours
// join without a seam.
import * as THREE from "three";
import { short } from "viewer/page";
import { Scale } from "viewer/scale";
import { flatPlaces, unpackTable } from "viewer/unpack";

const TEXELS = 256;
const BRIEF = ["radius", "flow", "pressure"];
const MARK = { colour: 0xd6137f, widen: 1.15 };
const CAPSULE = `
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

export async function makeNetwork(data, colours) {
  const table = await unpackTable(data.points);
  const [points, { radius }] = [flatPlaces(table), table];
  const { number, end } = await unpackTable(data.vessels);
  const offset = new Int32Array([0, ...end]);
  const network = { data, number, ...piecesOf(points, radius, offset, number) };
  network.box = new THREE.Box3().setFromArray(points)
    .expandByScalar(radius.reduce((a, b) => Math.max(a, b), 0));
  network.colourings = [];
  for (const quantity of data.colourings) {
    const { value: values } = await unpackTable(quantity.values);
    network.colourings.push({ ...quantity, values, colours: new Scale(quantity, colours) });
  }
  network.ramp = { value: null };
  const material = new THREE.MeshPhongMaterial(
    { shininess: 40, specular: 0x2a2a2a, side: THREE.DoubleSide });
  asCapsules(material, { ramp: network.ramp, none: new THREE.Color(colours.none) });
  network.mesh = new THREE.Mesh(shapeOf(network), material);
  network.mesh.frustumCulled = false;
  return network;
}

// Pieces between neighbouring points of one vessel; vessel and point are places in the page's
// arrays, number is the vessel's own.
function piecesOf(points, radius, offset, number) {
  const count = radius.length - number.length;
  const [from, to] = [new Float32Array(3 * count), new Float32Array(3 * count)];
  const radii = new Float32Array(2 * count);
  const [vessel, point] = [new Uint32Array(count), new Uint32Array(count)];
  let k = 0;
  for (let v = 0; v < number.length; v++) {
    for (let p = offset[v]; p + 1 < offset[v + 1]; p++, k++) {
      from.set(points.subarray(3 * p, 3 * p + 3), 3 * k);
      to.set(points.subarray(3 * p + 3, 3 * p + 6), 3 * k);
      radii.set([radius[p], radius[p + 1]], 2 * k);
      [vessel[k], point[k]] = [v, p];
    }
  }
  return { from, to, radii, vessel, point, offset };
}

// The instances of all pieces, or of those `chosen`. Fewer corners where there are many pieces: they
// are small on the screen.
function shapeOf(network, chosen = network.vessel.map((_, i) => i)) {
  const count = chosen.length;
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
  for (const [name, width] of [["from", 3], ["to", 3], ["radii", 2], ["place", 2]]) {
    const array = new Float32Array(width * count);
    const all = network[name];
    if (all) chosen.forEach((i, k) => array.set(all.subarray(width * i, width * (i + 1)), width * k));
    geometry.setAttribute(name, new THREE.InstancedBufferAttribute(array, width));
  }
  geometry.boundingBox = network.box;
  geometry.boundingSphere = network.box.getBoundingSphere(new THREE.Sphere());
  return geometry;
}

// Lets a material of three.js place the template and, with a ramp, colour it.
function asCapsules(material, { widen = 1, ramp = null, none = new THREE.Color() }) {
  material.onBeforeCompile = (shader) => {
    shader.uniforms.widen = { value: widen };
    shader.uniforms.ramp = ramp ?? { value: null };
    shader.uniforms.none = { value: none };
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", `#include <common>\n${CAPSULE}`)
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

// A scale's colours as a texture.
export function textureOf(scale) {
  const table = scale.table(TEXELS);
  const bytes = Uint8Array.from(table.flatMap((rgb) => [...rgb.map(Math.round), 255]));
  const texture = new THREE.DataTexture(bytes, table.length, 1);
  texture.colorSpace = THREE.SRGBColorSpace;
  texture.magFilter = texture.minFilter = scale.named ? THREE.NearestFilter : THREE.LinearFilter;
  texture.needsUpdate = true;
  return texture;
}

// Colours the network and returns the legend that explains it.
export function colourNetwork(network, which) {
  const { values, at, colours: scale } = network.colourings[which];
  const place = network.mesh.geometry.attributes.place;
  // Where in the texture a value's colour is; negative where there is no value.
  const inTexture = (value) => {
    if (Number.isNaN(value)) return -1;
    if (scale.named) return (value + 0.5) / scale.stops.length;
    return (0.5 + Math.min(Math.max(scale.place(value), 0), 1) * (TEXELS - 1)) / TEXELS;
  };
  for (let i = 0; i < network.vessel.length; i++) {
    const first = at === "point" ? network.point[i] : network.vessel[i];
    const a = inTexture(values[first]);
    const b = inTexture(values[at === "point" ? first + 1 : first]);
    place.setXY(i, a < 0 || b < 0 ? -1 : a, a < 0 || b < 0 ? -1 : b);
  }
  place.needsUpdate = true;
  network.ramp.value?.dispose();
  network.ramp.value = textureOf(scale);
  return scale.legend();
}

export function vesselName(network, number) {
  return network.data.names[number] ?? String(number);
}

// What is known of a vessel, as [name, text] each; of what varies along it the first and last value.
export function vesselFacts(network, number, brief = false) {
  const v = network.number.indexOf(number);
  if (v < 0) return [];
  const [first, last] = [network.offset[v], network.offset[v + 1] - 1];
  const found = [["Length", `${short(network.data.lengths[v])} mm`]];
  for (const { key, name, unit, at, values, labels, colours } of network.colourings) {
    if (brief && !BRIEF.includes(key)) continue;
    const ends = at === "point" ? [values[first], values[last]] : [values[v]];
    if (ends.some(Number.isNaN)) continue;
    const factor = key === "radius" ? 2 : 1;
    const texts = labels.length ? [labels[ends[0]]]
      : [...new Set(ends.map((x) => short(factor * x, 3, colours.diverging)))];
    found.push([key === "radius" ? "Diameter" : name, `${texts.join(" to ")} ${unit}`.trim()]);
  }
  return found;
}

// A bright cover over one vessel, seen through everything else.
export function makeMarker(opacity) {
  const material = new THREE.MeshBasicMaterial({
    color: MARK.colour, transparent: true, opacity, depthTest: false, depthWrite: false,
  });
  const marker = new THREE.Mesh(new THREE.BufferGeometry(), asCapsules(material, MARK));
  return Object.assign(marker, { frustumCulled: false, renderOrder: 10, visible: false });
}

export function markVessel(marker, network, number) {
  const v = network && number !== null ? network.number.indexOf(number) : -1;
  const chosen = v < 0 ? [] : [...network.vessel.keys()].filter((i) => network.vessel[i] === v);
  marker.visible = chosen.length > 0;
  if (!marker.visible) return;
  marker.geometry.dispose();
  marker.geometry = shapeOf(network, chosen);
}

// The nearest piece under a ray, or -1; kept(point) says what isn't cut away. Runs on every stroke of
// the pointer over all pieces, so it makes no arrays of its own.
export function pieceUnder({ from, to, radii, vessel }, { origin: o, direction: d }, kept) {
  const point = new THREE.Vector3();
  let [piece, least] = [-1, Infinity];
  for (let i = 0; i < vessel.length; i++) {
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
    if (distance < least && kept(point.copy(o).addScaledVector(d, distance))) {
      [piece, least] = [i, distance];
    }
  }
  return piece;
}
