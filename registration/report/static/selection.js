// Rows of vessels: pointing at one marks it in 3D, and the other way round.
import { listen, set, state } from "report/bus";
import { facts, vesselName } from "report/network";

export function startSelection(network) {
  const rows = new Map();
  for (const row of document.querySelectorAll("tr[data-vessel]")) {
    const vessel = Number(row.dataset.vessel);
    rows.set(vessel, [...(rows.get(vessel) ?? []), row]);
    prepare(row, vessel);
  }
  for (const [name, mark] of [["hovered", "hovered"], ["selected", "selected"]]) {
    listen(name, (vessel) => {
      for (const row of document.querySelectorAll(`tr.${mark}`)) row.classList.remove(mark);
      for (const row of rows.get(vessel) ?? []) row.classList.add(mark);
    });
  }
  listen("selected", (vessel) => describe(network, vessel, rows.get(vessel) ?? []));
}

function prepare(row, vessel) {
  const name = row.cells[0];
  const button = document.createElement("button");
  button.type = "button";
  button.title = "Mark in the 3D view";
  button.append(...name.childNodes);
  name.append(button);
  row.classList.add("linked");
  row.addEventListener("pointerenter", () => set("hovered", vessel));
  row.addEventListener("pointerleave", () => set("hovered", null));
  row.addEventListener("click", () => {
    const again = state.selected === vessel;
    set("selected", again ? null : vessel);
    if (!again) document.getElementById("map").scrollIntoView({ block: "start" });
  });
}

// The panel beside the view repeats the chosen vessel's rows, and what else is known of it.
function describe(network, vessel, rows) {
  const panel = document.getElementById("selection");
  panel.replaceChildren();
  if (vessel === null) return;
  const title = document.createElement("h3");
  title.textContent = `Vessel ${vesselName(network, vessel)}`;
  const list = document.createElement("dl");
  const shown = new Set();
  for (const row of rows) appendCells(list, row, shown);
  for (const [name, text] of rows.length ? [] : facts(network, vessel)) append(list, name, text);
  panel.append(title, list);
  if (rows.length) panel.append(backLink(rows[0]));
}

function appendCells(list, row, shown) {
  const headings = row.closest("table").tHead.rows[0].cells;
  for (const cell of [...row.cells].slice(1)) {
    const heading = headings[cell.cellIndex].querySelector("button")?.textContent;
    if (!heading || shown.has(heading)) continue;
    shown.add(heading);
    append(list, heading, cell.textContent);
  }
}

function append(list, name, text) {
  const [term, value] = [document.createElement("dt"), document.createElement("dd")];
  [term.textContent, value.textContent] = [name, text];
  list.append(term, value);
}

function backLink(row) {
  const link = document.createElement("a");
  link.href = `#${row.closest("table").id}`;
  link.textContent = "To its row";
  link.addEventListener("click", (event) => {
    event.preventDefault();
    row.scrollIntoView({ block: "center" });
  });
  return link;
}
