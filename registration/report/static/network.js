// The designed network at true radius, coloured by a quantity of each vessel or along it.
import * as THREE from "three";
import { asCapsules, makePieces } from "report/capsules";
import { Scale, shortNumber } from "report/scale";
import { unpack, unpackLevels } from "report/unpack";

export async function makeNetwork(data, colours) {
  const points = await unpackLevels(data.points);
  const radius = await unpack(data.radius, Float32Array);
  const offset = await unpack(data.offset, Int32Array);
  const number = await unpack(data.number, Int32Array);
  const network = { data, colours, number, ...pieces(points, radius, offset, number) };
  network.box = boxOf(points, radius);
  network.ramp = { value: null };
  network.colourings = [];
  for (const colouring of data.colourings) {
    const values = await unpack(colouring.values, Float32Array);
    network.colourings.push({ ...colouring, values, scale: new Scale(colouring, colours) });
  }
  const material = new THREE.MeshPhongMaterial({ shininess: 40, specular: 0x2a2a2a });
  material.side = THREE.DoubleSide;
  asCapsules(material, { ramp: network.ramp, none: new THREE.Color(colours.none) });
  network.mesh = new THREE.Mesh(makePieces(network), material);
  network.mesh.frustumCulled = false;
  return network;
}

// Pieces between neighbouring points of one vessel; vessel and point are places in the page's
// arrays, number tells the vessel's own number.
function pieces(points, radius, offset, number) {
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

function boxOf(points, radius) {
  const box = new THREE.Box3().setFromArray(points);
  return box.expandByScalar(radius.reduce((a, b) => Math.max(a, b), 0));
}

// Colours the network and returns the legend that explains it.
export function colourNetwork(network, which) {
  const { values, at, scale } = network.colourings[which];
  const place = network.mesh.geometry.attributes.place;
  for (let i = 0; i < network.vessel.length; i++) {
    const first = at === "point" ? network.point[i] : network.vessel[i];
    const [a, b] = [values[first], values[at === "point" ? first + 1 : first]].map(
      (value) => scale.texturePlace(value));
    place.setXY(i, a < 0 || b < 0 ? -1 : a, a < 0 || b < 0 ? -1 : b);
  }
  place.needsUpdate = true;
  network.ramp.value?.dispose();
  network.ramp.value = scale.texture();
  return scale.legend();
}

export function vesselName(network, number) {
  return network.data.names[number] ?? String(number);
}

// What is known of a vessel, as [name, text] each; along a vessel first and last value are told.
export function facts(network, number, brief = false) {
  const v = network.number.indexOf(number);
  if (v < 0) return [];
  const [first, last] = [network.offset[v], network.offset[v + 1] - 1];
  const found = [["Length", `${shortNumber(network.data.lengths[v])} mm`]];
  for (const { key, name, unit, at, values, labels, scale } of network.colourings) {
    if (brief && !["radius", "flow", "pressure"].includes(key)) continue;
    const ends = at === "point" ? [values[first], values[last]] : [values[v]];
    if (ends.some(Number.isNaN)) continue;
    const factor = key === "radius" ? 2 : 1;
    const text = labels.length ? [labels[ends[0]]]
      : [...new Set(ends.map((x) => shortNumber(factor * x, scale.diverging)))];
    found.push([key === "radius" ? "Diameter" : name, `${text.join(" to ")} ${unit}`.trim()]);
  }
  return found;
}

// A bright cover over one vessel, seen through everything else.
export function makeMarker(opacity) {
  const material = new THREE.MeshBasicMaterial({
    color: 0xd6137f, transparent: true, opacity, depthTest: false, depthWrite: false,
  });
  const marker = new THREE.Mesh(new THREE.BufferGeometry(), asCapsules(material, { widen: 1.15 }));
  marker.renderOrder = 10;
  marker.frustumCulled = false;
  marker.visible = false;
  return marker;
}

export function markVessel(marker, network, number) {
  const chosen = [];
  if (network && number !== null) {
    const v = network.number.indexOf(number);
    network.vessel.forEach((vessel, i) => { if (vessel === v) chosen.push(i); });
  }
  marker.visible = chosen.length > 0;
  if (!marker.visible) return;
  marker.geometry.dispose();
  marker.geometry = makePieces(network, chosen);
}
