// Surfaces: coloured where they carry a number, translucent with drawn edges where they don't.
import * as THREE from "three";
import { Scale } from "report/scale";
import { unpackSurface } from "report/unpack";

const MOST_FACES_WITH_EDGES = 60000;

export async function makeSurface(data, colours) {
  const { positions, faces, values } = await unpackSurface(data);
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
  geometry.setIndex(new THREE.BufferAttribute(faces, 1));
  const surface = { data, values, scale: null, group: new THREE.Group() };
  surface.mesh = values ? coloured(geometry, surface, colours) : setting(geometry, surface);
  surface.group.add(surface.mesh);
  return surface;
}

function coloured(geometry, surface, colours) {
  surface.scale = new Scale(surface.data.limits, colours);
  geometry.setAttribute("color", vertexColours(surface.values, surface.scale));
  geometry.computeVertexNormals();
  const material = new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide });
  return new THREE.Mesh(geometry, material);
}

function setting(geometry, surface) {
  const material = new THREE.MeshLambertMaterial({
    color: 0x8b949c, transparent: true, opacity: 0.1, depthWrite: false,
    side: THREE.DoubleSide, flatShading: true,
  });
  if (surface.data.face_count <= MOST_FACES_WITH_EDGES) {
    const line = new THREE.LineBasicMaterial({ color: 0x8b949c, transparent: true, opacity: 0.55 });
    surface.group.add(new THREE.LineSegments(new THREE.EdgesGeometry(geometry, 35), line));
  }
  const mesh = new THREE.Mesh(geometry, material);
  mesh.renderOrder = 2;
  return mesh;
}

function vertexColours(values, scale) {
  const array = new Float32Array(3 * values.length);
  const colour = new THREE.Color();
  for (let i = 0; i < values.length; i++) scale.colour(values[i], colour).toArray(array, 3 * i);
  return new THREE.BufferAttribute(array, 3);
}

export function setOpacity(surface, opacity) {
  if (!surface.values) return;
  surface.mesh.material.transparent = opacity < 1;
  surface.mesh.material.opacity = opacity;
  surface.mesh.material.depthWrite = opacity === 1;
  surface.mesh.material.needsUpdate = true;
}

// The scalar under a ray's hit, interpolated in its triangle.
export function valueAt(surface, hit) {
  const { a, b, c } = hit.face;
  const place = surface.mesh.geometry.attributes.position;
  const corners = [a, b, c].map((i) => new THREE.Vector3().fromBufferAttribute(place, i));
  const weight = THREE.Triangle.getBarycoord(hit.point, ...corners, new THREE.Vector3());
  if (!weight) return NaN;
  const [x, y, z] = [a, b, c].map((i) => surface.values[i]);
  return x * weight.x + y * weight.y + z * weight.z;
}
