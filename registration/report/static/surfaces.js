// Surfaces: coloured where they carry a number, a translucent shell where they don't.
import * as THREE from "three";
import { Scale } from "report/scale";
import { unpackSurface } from "report/unpack";

const MOST_FACES_WITH_EDGES = 60000;
const MOST_FACES_WITH_CREASES = 150000;
const CREASE = 0.8;
const FACE_ON = 0.07;
const GRAZING = 0.38;

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
  const [low, high] = surface.data.limits;
  const scale = low < 0 && high > 0 ? "diverging" : "linear";
  surface.scale = new Scale({ ...surface.data, scale }, colours);
  geometry.setAttribute("color", vertexColours(surface.values, surface.scale));
  geometry.computeVertexNormals();
  const material = new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide });
  return new THREE.Mesh(geometry, material);
}

function setting(geometry, surface) {
  const material = new THREE.MeshLambertMaterial({
    color: 0x8b949c, transparent: true, depthWrite: false, side: THREE.DoubleSide,
  });
  // A shell seen edge-on holds back more light than one seen face-on.
  surface.strength = { value: 1 };
  material.onBeforeCompile = (shader) => {
    shader.uniforms.strength = surface.strength;
    shader.fragmentShader = shader.fragmentShader
      .replace("#include <common>", "#include <common>\nuniform float strength;")
      .replace("#include <opaque_fragment>", `
        float slant = 1.0 - abs(normal.z);
        diffuseColor.a = strength * (${FACE_ON} + ${GRAZING} * slant * slant * slant);
        #include <opaque_fragment>`);
  };
  if (surface.data.face_count <= MOST_FACES_WITH_EDGES) {
    const line = new THREE.LineBasicMaterial({ color: 0x8b949c, transparent: true, opacity: 0.45 });
    surface.edges = line;
    surface.group.add(new THREE.LineSegments(new THREE.EdgesGeometry(geometry, 40), line));
  }
  const mesh = new THREE.Mesh(withNormals(geometry, surface.data.face_count), material);
  mesh.renderOrder = 2;
  return mesh;
}

function withNormals(geometry, faceCount) {
  if (faceCount <= MOST_FACES_WITH_CREASES) return creased(geometry);
  geometry.computeVertexNormals();
  return geometry;
}

// A copy whose corners have normals of their own: smooth, but across creases. The sum over the
// faces around the vertex that are turned little from the corner's own, by area.
function creased(geometry) {
  const flat = geometry.toNonIndexed();
  const [place, index] = [flat.attributes.position.array, geometry.index.array];
  const across = new Float32Array(place.length / 3);
  const around = Array.from({ length: geometry.attributes.position.count }, () => []);
  const [a, b, c] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3()];
  for (let f = 0; f < index.length / 3; f++) {
    [a, b, c].forEach((corner, k) => corner.fromArray(place, 9 * f + 3 * k));
    b.sub(a).cross(c.sub(a)).toArray(across, 3 * f);
    for (let k = 0; k < 3; k++) around[index[3 * f + k]].push(f);
  }
  const normals = new Float32Array(place.length);
  for (let i = 0; i < index.length; i++) {
    a.fromArray(across, 3 * Math.floor(i / 3));
    c.set(0, 0, 0);
    for (const f of around[index[i]]) {
      b.fromArray(across, 3 * f);
      if (a.dot(b) > CREASE * a.length() * b.length()) c.add(b);
    }
    (c.lengthSq() > 0 ? c : c.copy(a)).normalize().toArray(normals, 3 * i);
  }
  flat.setAttribute("normal", new THREE.BufferAttribute(normals, 3));
  return flat;
}

function vertexColours(values, scale) {
  const array = new Float32Array(3 * values.length);
  const colour = new THREE.Color();
  for (let i = 0; i < values.length; i++) scale.colour(values[i], colour).toArray(array, 3 * i);
  return new THREE.BufferAttribute(array, 3);
}

export function setOpacity(surface, opacity) {
  if (!surface.values) {
    surface.strength.value = opacity;
    if (surface.edges) surface.edges.opacity = 0.45 * opacity;
    return;
  }
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
