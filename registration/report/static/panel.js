// The controls beside the view, and its keys.
import { set } from "report/bus";
import { colourNetwork } from "report/network";
import { setOpacity } from "report/surfaces";
import { directions } from "report/stage";

const STEP = Math.PI / 24;
const PAN = 40;

export function startPanel(stage, view) {
  document.getElementById("panel").hidden = false;
  const update = () => {
    showLegends(view);
    stage.draw();
  };
  startLayers(view, update);
  startColouring(view, update);
  document.getElementById("opacity").addEventListener("input", (event) => {
    for (const surface of view.surfaces) setOpacity(surface, Number(event.target.value) / 100);
    stage.draw();
  });
  for (const name of directions) addDirection(stage, name);
  startKeys(stage);
  update();
}

function startLayers(view, update) {
  const box = document.getElementById("layers");
  for (const layer of view.layers) {
    const [label, input] = [document.createElement("label"), document.createElement("input")];
    label.className = "layer";
    input.type = "checkbox";
    input.checked = layer.object.visible;
    input.addEventListener("change", () => {
      layer.object.visible = input.checked;
      update();
    });
    label.append(input, layer.name);
    box.append(label);
  }
  document.getElementById("opacity").closest("fieldset").hidden = view.surfaces.length === 0;
}

function startColouring(view, update) {
  const select = document.getElementById("colouring");
  select.closest("fieldset").hidden = !view.network;
  if (!view.network) return;
  view.network.colourings.forEach(({ key, name, unit }, i) => {
    const first = key === view.network.data.first;
    select.append(new Option(unit ? `${name} / ${unit}` : name, String(i), first, first));
  });
  const recolour = () => {
    view.networkLegend = colourNetwork(view.network, Number(select.value));
    update();
  };
  select.addEventListener("change", recolour);
  recolour();
}

function showLegends(view) {
  const shown = view.surfaces
    .filter((surface) => surface.scale && surface.group.visible)
    .map(({ scale }) => scale.legend());
  if (view.network?.mesh.visible && view.networkLegend) shown.push(view.networkLegend);
  document.getElementById("legends").replaceChildren(...shown);
}

function addDirection(stage, name) {
  const button = document.createElement("button");
  button.type = "button";
  button.textContent = name;
  button.addEventListener("click", () => stage.look(name));
  document.getElementById("directions").append(button);
}

function startKeys(stage) {
  const { element } = stage;
  element.addEventListener("pointerdown", () => element.focus({ preventScroll: true }));
  element.addEventListener("focus", () => stage.takeHold(true));
  element.addEventListener("blur", () => stage.takeHold(false));
  element.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const action = keyAction(stage, event);
    if (!action) return;
    event.preventDefault();
    action();
  });
}

function keyAction(stage, { key, shiftKey }) {
  const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[key];
  if (way) {
    return () => (shiftKey ? stage.pan(way[0] * PAN, way[1] * PAN)
      : stage.orbit(way[0] * STEP, -way[1] * STEP));
  }
  return {
    "+": () => stage.zoom(1.2),
    "=": () => stage.zoom(1.2),
    "-": () => stage.zoom(1 / 1.2),
    0: () => stage.look(directions[0]),
    Escape: () => {
      set("selected", null);
      stage.element.blur();
    },
  }[key];
}
