// What the pointer is over: a vessel, a value of a surface, or nothing.
import * as THREE from "three";
import { set, state } from "report/bus";
import { pieceUnder } from "report/capsules";
import { isKept } from "report/clip";
import { facts, vesselName } from "report/network";
import { shortNumber } from "report/scale";
import { valueAt } from "report/surfaces";

// Testing every triangle on each stroke is too slow above this; a still pointer is still tested.
const QUICK_FACES = 120000;
const STILL_MS = 120;

export function startPointer(stage, view) {
  const canvas = stage.renderer.domElement;
  const faces = view.surfaces.reduce((sum, { data }) => sum + data.face_count, 0);
  let timer = 0;
  let press = null;
  canvas.addEventListener("pointermove", (event) => {
    clearTimeout(timer);
    if (event.buttons) return;
    timer = setTimeout(() => point(stage, view, event), faces > QUICK_FACES ? STILL_MS : 10);
  });
  canvas.addEventListener("pointerleave", () => {
    clearTimeout(timer);
    set("hovered", null);
    showProbe("");
  });
  canvas.addEventListener("pointerdown", (event) => { press = [event.clientX, event.clientY]; });
  canvas.addEventListener("pointerup", (event) => {
    // A press that moved was an orbit.
    if (!press || Math.hypot(event.clientX - press[0], event.clientY - press[1]) > 5) return;
    const { vessel, ray } = point(stage, view, event);
    view.pick?.(ray);
    set("selected", vessel === state.selected ? null : vessel);
  });
}

function point(stage, view, event) {
  const frame = stage.element.getBoundingClientRect();
  const place = new THREE.Vector2(
    (2 * (event.clientX - frame.left)) / frame.width - 1,
    1 - (2 * (event.clientY - frame.top)) / frame.height,
  );
  const ray = new THREE.Raycaster();
  ray.setFromCamera(place, stage.camera);
  const vessel = vesselUnder(stage, ray.ray, view);
  set("hovered", vessel);
  showProbe([...described(view, vessel), reading(stage, ray, view)].filter(Boolean).join(" · "));
  return { vessel, ray };
}

// The network answers even while it is hidden inside a surface.
function vesselUnder(stage, ray, view) {
  if (!view.network) return null;
  const hit = pieceUnder(view.network, ray, (at) => isKept(stage, at));
  return hit ? view.network.number[view.network.vessel[hit.piece]] : null;
}

function described(view, vessel) {
  if (vessel === null) return [];
  const brief = facts(view.network, vessel, true).map(([name, text]) => `${name} ${text}`);
  return [`vessel ${vesselName(view.network, vessel)}`, ...brief];
}

function reading(stage, ray, view) {
  const hits = view.surfaces
    .filter((surface) => surface.values && surface.group.visible)
    .map((surface) => ({ surface, hit: firstKept(stage, ray, surface.mesh) }))
    .filter(({ hit }) => hit)
    .sort((a, b) => a.hit.distance - b.hit.distance);
  if (!hits.length) return "";
  const { surface, hit } = hits[0];
  const value = valueAt(surface, hit);
  if (Number.isNaN(value)) return "no data here";
  return `${shortNumber(value, surface.scale.diverging)} ${surface.data.unit}`;
}

export function firstKept(stage, ray, mesh) {
  return ray.intersectObject(mesh, false).find(({ point: at }) => isKept(stage, at));
}

function showProbe(text) {
  const probe = document.getElementById("probe");
  probe.hidden = text === "";
  probe.textContent = text;
}
