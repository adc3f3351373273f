// The designed network at true radius, coloured by its kind or by a number per vessel.
import * as THREE from "three";
import { Scale, swatches } from "report/scale";
import { tubes } from "report/tubes";
import { unpack } from "report/unpack";

export async function makeNetwork(data, colours) {
  const network = {
    data, colours,
    points: await unpack(data.points, Float32Array),
    radius: await unpack(data.radius, Float32Array),
    offset: await unpack(data.offset, Int32Array),
  };
  const geometry = tubes(network, data.names.map((_, vessel) => vessel));
  const count = geometry.attributes.position.count;
  geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(3 * count), 3));
  const material = new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide });
  network.mesh = new THREE.Mesh(geometry, material);
  return network;
}

// Colours the network and returns the legend that explains it; -1 colours by kind.
export function colourNetwork(network, which) {
  const { data, colours } = network;
  const colouring = data.colourings[which];
  const scale = colouring && new Scale(colouring.limits, colours);
  const ofVessel = data.kinds.map((kind, vessel) => {
    const colour = new THREE.Color(data.kind_colours[kind]);
    return scale ? scale.colour(colouring.values[vessel], colour) : colour;
  });
  const { attributes, userData } = network.mesh.geometry;
  userData.vessel.forEach((vessel, i) => ofVessel[vessel].toArray(attributes.color.array, 3 * i));
  attributes.color.needsUpdate = true;
  if (scale) return scale.legend(`${colouring.name} / ${colouring.unit}`);
  const kinds = [...new Set(data.kinds)];
  return swatches("Kind of vessel", kinds.map((kind) => [kind, data.kind_colours[kind]]));
}

// A bright cover over one vessel, seen through everything else.
export function makeMarker(opacity) {
  const material = new THREE.MeshBasicMaterial({
    color: 0xd6137f, transparent: true, opacity, depthTest: false, depthWrite: false,
  });
  const marker = new THREE.Mesh(new THREE.BufferGeometry(), material);
  marker.renderOrder = 10;
  marker.visible = false;
  return marker;
}

export function markVessel(marker, network, vessel) {
  marker.visible = network !== null && vessel !== null && vessel < network.data.names.length;
  if (!marker.visible) return;
  marker.geometry.dispose();
  marker.geometry = tubes(network, [vessel], 1.15);
}
