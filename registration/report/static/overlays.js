// Scale bar and axes, drawn over the view each time it is drawn.
import * as THREE from "three";

const ROUGH_PIXELS = 110;

export function startOverlays(stage) {
  const [bar, triad] = ["scalebar", "triad"].map((id) => document.getElementById(id));
  bar.hidden = false;
  triad.removeAttribute("hidden");
  stage.onDraw(() => {
    drawBar(stage, bar);
    drawTriad(stage, triad);
  });
}

function drawBar(stage, bar) {
  const scale = stage.pixelsPerMm();
  const length = roundDown(ROUGH_PIXELS / scale);
  bar.firstElementChild.style.width = `${length * scale}px`;
  bar.lastElementChild.textContent = length >= 1 ? `${length} mm` : `${Math.round(length * 1000)} µm`;
}

// The largest of 1, 2 or 5 times a power of ten that isn't above the length.
function roundDown(length) {
  const power = 10 ** Math.floor(Math.log10(length));
  const factor = [5, 2, 1].find((f) => f * power <= length * (1 + 1e-9)) ?? 1;
  return Number((factor * power).toPrecision(1));
}

function drawTriad(stage, triad) {
  const turned = stage.camera.quaternion.clone().invert();
  const parts = [["x", 1, 0, 0], ["y", 0, 1, 0], ["z", 0, 0, 1]].map(([name, ...way]) => {
    const tip = new THREE.Vector3(...way).applyQuaternion(turned);
    return { name, tip };
  });
  parts.sort((a, b) => a.tip.z - b.tip.z);
  triad.replaceChildren(...parts.flatMap(({ name, tip }) => arm(name, tip)));
}

function arm(name, tip) {
  const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
  line.setAttribute("x2", 24 * tip.x);
  line.setAttribute("y2", -24 * tip.y);
  const text = document.createElementNS("http://www.w3.org/2000/svg", "text");
  text.setAttribute("x", 32 * tip.x);
  text.setAttribute("y", -32 * tip.y);
  text.textContent = Math.hypot(tip.x, tip.y) > 0.15 ? name : "";
  return [line, text];
}
