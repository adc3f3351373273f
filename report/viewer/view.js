// The 3D viewer with its panel: surfaces, a network, what the pointer is over. README.md says how.
import * as THREE from "three";
import { drawPlainly } from "viewer/drawn";
import { byId, make, marked, short, startViewKeys } from "viewer/page";
import { DIRECTIONS, Stage, linkView, startOverlays } from "viewer/stage";
import { makeSurface, setOpacity, valueAt } from "viewer/surfaces";
import {
  colourNetwork, makeMarker, makeNetwork, markVessel, pieceUnder, vesselFacts, vesselName,
} from "viewer/tubes";

const OUTLINE_POINTS = 20000;
// Testing every triangle on each stroke is too slow above this; a still pointer is still tested.
const QUICK_FACES = 120000;
const STILL_MS = 120;
const CLICK_PX = 5;
const PICK = { colour: 0xc8102e, share: 0.012 }; // of the radius of all

// Draws `data` of page_frame.scene into the viewer of view.html. `onPick` gets the place (mm) on a
// surface that was clicked, which is then marked. Returns { stage, surfaces, network }.
export async function view(element, data, { onPick = null } = {}) {
  const canvas = make("canvas"); // three.js takes over the context that is got here
  if (!canvas.getContext("webgl2")) return drawPlainly(element, data, DIRECTIONS);
  const stage = new Stage(byId("stage"), { canvas });
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
  const shown = { stage, surfaces, network, layers, onPick };
  const bounds = new THREE.Box3();
  for (const { object } of layers) {
    stage.scene.add(object);
    bounds.expandByObject(object);
  }
  // The stage is laid out beside the panel only once the state says ready.
  element.dataset.state = "ready";
  startPanel(shown);
  startOverlays(stage, byId("scalebar"), byId("triad"));
  stage.frame(bounds, outline(shown, bounds));
  startClip(stage);
  startMarkers(shown);
  startPointer(shown);
  window.addEventListener("beforeprint", () => {
    const picture = byId("print-picture");
    picture.hidden = !stage.lost.hidden; // a lost view is said instead
    if (!picture.hidden) picture.src = stage.picture();
  });
  linkView(stage);
  return shown;
}

// Every vertex of the surfaces and every end of the network's pieces, or of so many that it is quick.
function outline({ surfaces, network }, bounds) {
  const arrays = surfaces.map(({ mesh }) => mesh.geometry.attributes.position.array);
  if (network) arrays.push(network.from, network.to);
  const found = bounds.getCenter(new THREE.Vector3()).toArray();
  for (const array of arrays) {
    const stride = 3 * Math.max(1, Math.floor(array.length / 3 / OUTLINE_POINTS));
    for (let i = 0; i < array.length; i += stride) found.push(array[i], array[i + 1], array[i + 2]);
  }
  return found;
}

function startPanel({ stage, surfaces, network, layers }) {
  byId("panel").hidden = false;
  let networkLegend = null;
  const update = () => {
    const legends = surfaces.filter(({ scale, group }) => scale && group.visible)
      .map(({ scale }) => scale.legend());
    if (network?.mesh.visible) legends.push(networkLegend);
    byId("legends").replaceChildren(...legends);
    stage.draw();
  };
  for (const { name, object } of layers) {
    const input = make("input", { type: "checkbox", checked: object.visible });
    input.addEventListener("change", () => {
      object.visible = input.checked;
      update();
    });
    byId("layers").append(make("label", { className: "layer" }, input, name));
  }
  byId("opacity").closest("fieldset").hidden = surfaces.length === 0;
  byId("opacity").addEventListener("input", () => {
    for (const surface of surfaces) setOpacity(surface, Number(byId("opacity").value) / 100);
    stage.draw();
  });
  const select = byId("colouring");
  select.closest("fieldset").hidden = !network;
  network?.colourings.forEach(({ key, colours }, i) => {
    const first = key === network.data.first;
    select.add(new Option(colours.title, String(i), first, first));
  });
  const recolour = () => {
    if (network) networkLegend = colourNetwork(network, Number(select.value));
    update();
  };
  select.addEventListener("change", recolour);
  recolour();
  for (const name of Object.keys(DIRECTIONS)) {
    const button = make("button", { type: "button" }, name);
    button.addEventListener("click", () => stage.look(name));
    byId("directions").append(button);
  }
  startViewKeys(stage.element, stage, {
    0: () => stage.look("Oblique"),
    Escape: () => {
      marked.set("selected", null);
      stage.element.blur();
    },
  });
}

function startClip(stage) {
  const [axis, slider] = [byId("clip-axis"), byId("clip")];
  const update = () => {
    slider.disabled = axis.value === "none";
    stage.clip(axis.value, Number(slider.value) / 1000);
  };
  axis.addEventListener("change", () => {
    if (Number(slider.value) === 1000) slider.value = 500;
    update();
  });
  slider.addEventListener("input", update);
  stage.controls.addEventListener("change", () => { if (axis.value === "view") update(); });
  update();
}

function startMarkers({ stage, network }) {
  for (const [name, opacity] of [["hovered", 0.3], ["selected", 0.65]]) {
    const marker = makeMarker(opacity);
    stage.scene.add(marker);
    marked.on(name, (vessel) => {
      markVessel(marker, network, vessel);
      stage.draw();
    });
  }
}

function startPointer(shown) {
  const { stage: { canvas } } = shown;
  const faces = shown.surfaces.reduce((sum, { data }) => sum + data.face_count, 0);
  let timer = 0;
  let press = null;
  canvas.addEventListener("pointermove", (event) => {
    clearTimeout(timer);
    if (event.buttons) return;
    timer = setTimeout(() => point(shown, event), faces > QUICK_FACES ? STILL_MS : 10);
  });
  canvas.addEventListener("pointerleave", () => {
    clearTimeout(timer);
    marked.set("hovered", null);
    showProbe("");
  });
  canvas.addEventListener("pointerdown", ({ clientX, clientY }) => { press = [clientX, clientY]; });
  canvas.addEventListener("pointerup", (event) => {
    // A press that moved was an orbit.
    const { clientX: x, clientY: y } = event;
    if (!press || Math.hypot(x - press[0], y - press[1]) > CLICK_PX) return;
    const vessel = point(shown, event);
    if (shown.onPick) pick(shown, event);
    marked.set("selected", vessel === marked.selected ? null : vessel);
  });
}

// Marks and describes what is under the pointer; returns the vessel. The network answers even while
// it is hidden inside a surface.
function point(shown, event) {
  const { stage, network } = shown;
  const ray = stage.ray(event);
  const piece = network ? pieceUnder(network, ray.ray, (at) => stage.isKept(at)) : -1;
  const vessel = piece < 0 ? null : network.number[network.vessel[piece]];
  marked.set("hovered", vessel);
  const known = vessel === null ? [] : [`vessel ${vesselName(network, vessel)}`,
    ...vesselFacts(network, vessel, true).map(([name, text]) => `${name} ${text}`)];
  const [nearest] = hits(shown, ray, (surface) => surface.values);
  if (nearest) {
    const { surface: { scale, data } } = nearest;
    const value = valueAt(nearest.surface, nearest.hit);
    known.push(Number.isNaN(value) ? "no data here"
      : `${short(value, 3, scale.diverging)} ${data.unit}`.trim());
  }
  showProbe(known.join(" · "));
  return vessel;
}

// Where a ray meets the surfaces that are shown and not cut away, the nearest first.
function hits({ stage, surfaces }, ray, chosen) {
  return surfaces.filter((surface) => surface.group.visible && chosen(surface))
    .map((surface) => ({
      surface,
      hit: ray.intersectObject(surface.mesh, false).find(({ point: at }) => stage.isKept(at)),
    }))
    .filter(({ hit }) => hit)
    .sort((a, b) => a.hit.distance - b.hit.distance);
}

function pick(shown, event) {
  const { stage, onPick } = shown;
  const [nearest] = hits(shown, stage.ray(event), () => true);
  if (!nearest) return;
  const mark = new THREE.Mesh(new THREE.SphereGeometry(PICK.share * stage.radius, 24, 16),
    new THREE.MeshLambertMaterial({ color: PICK.colour }));
  mark.position.copy(nearest.hit.point);
  stage.scene.add(mark);
  stage.draw();
  onPick(nearest.hit.point.toArray());
}

function showProbe(text) {
  byId("probe").hidden = text === "";
  byId("probe").textContent = text;
}
