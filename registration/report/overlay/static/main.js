// One layer at a time: slider, buttons, keys, and rows of the table.
import { startTables } from "report/tables";
import { startTheme } from "report/theme";

const figures = [...document.querySelectorAll("#layers figure")];
const slider = document.getElementById("layer");
const tag = document.getElementById("layer-tag");
const rows = new Map();

function show(place) {
  const at = Math.min(Math.max(place, 0), figures.length - 1);
  figures.forEach((figure, k) => { figure.hidden = k !== at; });
  slider.value = String(at);
  const { layer, status } = figures[at].dataset;
  tag.textContent = `Layer ${layer}: ${status}`;
  for (const [number, row] of rows) row.classList.toggle("selected", number === layer);
}

startTheme();
startTables();
document.getElementById("stepper").hidden = figures.length < 2;
slider.addEventListener("input", () => show(Number(slider.value)));
document.getElementById("down").addEventListener("click", () => show(Number(slider.value) - 1));
document.getElementById("up").addEventListener("click", () => show(Number(slider.value) + 1));
for (const row of document.querySelectorAll("tr[data-layer]")) {
  rows.set(row.dataset.layer, row);
  const place = figures.findIndex((figure) => figure.dataset.layer === row.dataset.layer);
  if (place < 0) continue;
  row.classList.add("linked");
  row.addEventListener("click", () => {
    show(place);
    document.getElementById("layers").scrollIntoView({ block: "start" });
  });
}
if (figures.length) show(Number(slider.value));
document.documentElement.dataset.state = "ready";
