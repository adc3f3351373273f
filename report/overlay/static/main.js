// A scan over the G-code, one layer at a time: slider, buttons, and rows of the table.
import { byId, startPage } from "viewer/page";

const figures = [...document.querySelectorAll("#layers figure")];
const slider = byId("layer");
const rows = new Map();

function show(place) {
  const at = Math.min(Math.max(place, 0), figures.length - 1);
  figures.forEach((figure, k) => { figure.hidden = k !== at; });
  slider.value = String(at);
  const { layer, status } = figures[at].dataset;
  byId("layer-tag").textContent = `Layer ${layer}: ${status}`;
  for (const [number, row] of rows) row.classList.toggle("selected", number === layer);
}

startPage(() => {
  byId("stepper").hidden = figures.length < 2;
  slider.addEventListener("input", () => show(Number(slider.value)));
  byId("down").addEventListener("click", () => show(Number(slider.value) - 1));
  byId("up").addEventListener("click", () => show(Number(slider.value) + 1));
  for (const row of document.querySelectorAll("tr[data-layer]")) {
    rows.set(row.dataset.layer, row);
    const place = figures.findIndex((figure) => figure.dataset.layer === row.dataset.layer);
    if (place < 0) continue;
    row.classList.add("linked");
    row.addEventListener("click", () => {
      show(place);
      byId("layers").scrollIntoView({ block: "start" });
    });
  }
  if (figures.length) show(Number(slider.value));
});
