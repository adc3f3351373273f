// The 3D view: surfaces, network, markers, and what listens to them.
import * as THREE from "three";
import { listen } from "report/bus";
import { startClip } from "report/clip";
import { linkView } from "report/linked";
import { makeMarker, makeNetwork, markVessel } from "report/network";
import { startOverlays } from "report/overlays";
import { startPanel } from "report/panel";
import { pickPlaces } from "report/pick";
import { startPointer } from "report/pointer";
import { Stage } from "report/stage";
import { makeSurface } from "report/surfaces";

const OUTLINE_POINTS = 20000;

export async function startViewer(data) {
  const stage = new Stage(document.getElementById("stage"));
  const view = await makeView(data);
  const bounds = new THREE.Box3();
  for (const { object } of view.layers) {
    stage.scene.add(object);
    bounds.expandByObject(object);
  }
  // The stage is laid out beside the panel only once the state says ready.
  document.getElementById("viewer").dataset.state = "ready";
  startPanel(stage, view);
  startOverlays(stage);
  stage.frame(bounds, outline(view, bounds));
  startClip(stage);
  if (data.pick) view.pick = pickPlaces(stage, view);
  startMarkers(stage, view);
  startPointer(stage, view);
  startPrinting(stage);
  linkView(stage);
  return view;
}

// Every vertex of the surfaces and every end of the network's pieces, or of so many that it is quick.
function outline(view, bounds) {
  const arrays = view.surfaces.map(({ mesh }) => mesh.geometry.attributes.position.array);
  if (view.network) arrays.push(view.network.from, view.network.to);
  const found = [...bounds.min.toArray().map((low, k) => (low + bounds.max.toArray()[k]) / 2)];
  for (const array of arrays) {
    const stride = 3 * Math.max(1, Math.floor(array.length / 3 / OUTLINE_POINTS));
    for (let i = 0; i < array.length; i += stride) found.push(array[i], array[i + 1], array[i + 2]);
  }
  return found;
}

async function makeView(data) {
  const surfaces = [];
  for (const surface of data.surfaces) surfaces.push(await makeSurface(surface, data.colours));
  const network = data.network && (await makeNetwork(data.network, data.colours));
  const coloured = surfaces.filter((surface) => surface.values);
  for (const surface of coloured.slice(1)) surface.group.visible = false;
  const layers = surfaces.map(({ data: { name }, group }) => ({ name, object: group }));
  if (network) {
    network.mesh.visible = coloured.length === 0;
    layers.push({ name: "Designed network", object: network.mesh });
  }
  return { surfaces, network, layers, networkLegend: null };
}

function startMarkers(stage, view) {
  for (const [name, opacity] of [["hovered", 0.3], ["selected", 0.65]]) {
    const marker = makeMarker(opacity);
    stage.scene.add(marker);
    listen(name, (vessel) => {
      markVessel(marker, view.network, vessel);
      stage.draw();
    });
  }
}

function startPrinting(stage) {
  const picture = document.getElementById("print-picture");
  window.addEventListener("beforeprint", () => {
    picture.src = stage.picture();
    picture.hidden = false;
  });
}
