// Surfaces: coloured where they carry a number, a translucent shell where they don't.
import * as THREE from "three";
import { Scale } from "viewer/scale";
import { flatPlaces, unpackTable } from "viewer/unpack";

const MAX_FACES = { edges: 60000, creases: 150000 };
const CREASE_COS = 0.8;
const SHELL = { colour: 0x8b949c, faceOn: 0.07, grazing: 0.38, edges: 0.45 };

export async function makeSurface(data, colours) {
  const places = flatPlaces(await unpackTable(data.points));
  const corners = new Uint32Array((await unpackTable(data.corners)).vertex.buffer);
  const values = data.scalar && (await unpackTable(data.scalar)).value;
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(places, 3));
  geometry.setIndex(new THREE.BufferAttribute(corners, 1));
  const surface = { data, values, scale: null, group: new THREE.Group() };
  surface.mesh = values ? coloured(geometry, surface, colours) : shell(geometry, surface);
  surface.group.add(surface.mesh);
  return surface;
}

function coloured(geometry, surface, colours) {
  const [low, high] = surface.data.limits;
  const kind = { scale: low < 0 && high > 0 ? "diverging" : "linear", labels: [] };
  surface.scale = new Scale({ ...surface.data, ...kind }, colours);
  const [array, colour] = [new Float32Array(3 * surface.values.length), new THREE.Color()];
  surface.values.forEach((value, i) => {
    const [r, g, b] = surface.scale.rgb(value).map((part) => part / 255);
    colour.setRGB(r, g, b, THREE.SRGBColorSpace).toArray(array, 3 * i);
  });
  geometry.setAttribute("color", new THREE.BufferAttribute(array, 3));
  geometry.computeVertexNormals();
  const material = new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide });
  return new THREE.Mesh(geometry, material);
}

function shell(geometry, surface) {
  const material = new THREE.MeshLambertMaterial({
    color: SHELL.colour, transparent: true, depthWrite: false, side: THREE.DoubleSide,
  });
  // A shell seen edge-on holds back more light than one seen face-on.
  surface.strength = { value: 1 };
  material.onBeforeCompile = (shader) => {
    shader.uniforms.strength = surface.strength;
    shader.fragmentShader = shader.fragmentShader
      .replace("#include <common>", "#include <common>\nuniform float strength;")
      .replace("#include <opaque_fragment>", `
        float slant = 1.0 - abs(normal.z);
        diffuseColor.a = strength * (${SHELL.faceOn} + ${SHELL.grazing} * slant * slant * slant);
        #include <opaque_fragment>`);
  };
  const faceCount = surface.data.face_count;
  if (faceCount <= MAX_FACES.edges) {
    surface.edges = new THREE.LineBasicMaterial(
      { color: SHELL.colour, transparent: true, opacity: SHELL.edges });
    surface.group.add(new THREE.LineSegments(new THREE.EdgesGeometry(geometry, 40), surface.edges));
  }
  if (faceCount > MAX_FACES.creases) geometry.computeVertexNormals();
  const shape = faceCount > MAX_FACES.creases ? geometry : creased(geometry);
  return Object.assign(new THREE.Mesh(shape, material), { renderOrder: 2 });
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
      if (a.dot(b) > CREASE_COS * a.length() * b.length()) c.add(b);
    }
    (c.lengthSq() > 0 ? c : c.copy(a)).normalize().toArray(normals, 3 * i);
  }
  flat.setAttribute("normal", new THREE.BufferAttribute(normals, 3));
  return flat;
}

export function setOpacity({ values, strength, edges, mesh: { material } }, opacity) {
  if (!values) {
    strength.value = opacity;
    if (edges) edges.opacity = SHELL.edges * opacity;
    return;
  }
  Object.assign(material, {
    transparent: opacity < 1, opacity, depthWrite: opacity === 1, needsUpdate: true,
  });
}

// The scalar under a ray's hit, interpolated in its triangle.
export function valueAt({ mesh, values }, { face: { a, b, c }, point }) {
  const place = mesh.geometry.attributes.position;
  const corners = [a, b, c].map((i) => new THREE.Vector3().fromBufferAttribute(place, i));
  const weight = THREE.Triangle.getBarycoord(point, ...corners, new THREE.Vector3());
  return weight ? values[a] * weight.x + values[b] * weight.y + values[c] * weight.z : NaN;
}
