// Polylines with a radius as closed tubes; every vertex knows its vessel.
import * as THREE from "three";

export function tubes(network, vessels, widen = 1) {
  const sides = network.radius.length > 20000 ? 6 : 16;
  const out = { positions: [], normals: [], vessel: [], index: [] };
  for (const vessel of vessels) addTube(network, vessel, widen, sides, out);
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(out.positions, 3));
  geometry.setAttribute("normal", new THREE.Float32BufferAttribute(out.normals, 3));
  geometry.setIndex(out.index);
  geometry.userData.vessel = Uint32Array.from(out.vessel);
  return geometry;
}

function addTube(network, vessel, widen, sides, out) {
  const begin = network.offset[vessel];
  const points = pointsOf(network, vessel);
  const first = out.vessel.length;
  const normal = new THREE.Vector3();
  points.forEach((point, i) => {
    const tangent = tangentAt(points, i);
    turn(normal, tangent, i === 0);
    addRing(point, normal, tangent, network.radius[begin + i] * widen, sides, vessel, out);
    if (i > 0) joinRings(first + (i - 1) * sides, sides, out);
  });
  const last = points.length - 1;
  addCap(points[0], tangentAt(points, 0).negate(), first, sides, vessel, out);
  addCap(points[last], tangentAt(points, last), first + last * sides, sides, vessel, out);
}

function pointsOf(network, vessel) {
  const points = [];
  for (let i = network.offset[vessel]; i < network.offset[vessel + 1]; i++) {
    points.push(new THREE.Vector3().fromArray(network.points, 3 * i));
  }
  return points;
}

function tangentAt(points, i) {
  const before = points[Math.max(i - 1, 0)];
  const after = points[Math.min(i + 1, points.length - 1)];
  const along = after.clone().sub(before);
  return along.lengthSq() > 0 ? along.normalize() : along.set(0, 0, 1);
}

// The ring's first direction, turned as little as may be from one ring to the next.
function turn(normal, tangent, fresh) {
  if (fresh) {
    const [x, y, z] = tangent.toArray().map(Math.abs);
    normal.set(x <= y && x <= z ? 1 : 0, y < x && y <= z ? 1 : 0, z < x && z < y ? 1 : 0);
  }
  normal.addScaledVector(tangent, -normal.dot(tangent)).normalize();
}

function addRing(centre, normal, tangent, radius, sides, vessel, out) {
  const side = new THREE.Vector3().crossVectors(tangent, normal);
  for (let k = 0; k < sides; k++) {
    const angle = (2 * Math.PI * k) / sides;
    const way = normal.clone().multiplyScalar(Math.cos(angle)).addScaledVector(side, Math.sin(angle));
    addVertex(centre.clone().addScaledVector(way, radius), way, vessel, out);
  }
}

function addVertex(point, normal, vessel, out) {
  out.positions.push(point.x, point.y, point.z);
  out.normals.push(normal.x, normal.y, normal.z);
  out.vessel.push(vessel);
}

function joinRings(first, sides, out) {
  for (let k = 0; k < sides; k++) {
    const [a, b] = [first + k, first + ((k + 1) % sides)];
    out.index.push(a, b, b + sides, a, b + sides, a + sides);
  }
}

function addCap(centre, normal, ring, sides, vessel, out) {
  const hub = out.vessel.length;
  addVertex(centre, normal, vessel, out);
  for (let k = 0; k < sides; k++) {
    const at = new THREE.Vector3().fromArray(out.positions, 3 * (ring + k));
    addVertex(at, normal, vessel, out);
    out.index.push(hub, hub + 1 + k, hub + 1 + ((k + 1) % sides));
  }
}
