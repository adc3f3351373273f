// The report and the pages of networks: the 3D view, rows of vessels linked with it, any section.
import { byId, facts, fixed, make, marked, roundDown, startPage, startView } from "viewer/page";
import { unpackTable } from "viewer/unpack";
import { vesselFacts, vesselName } from "viewer/tubes";
import { view } from "viewer/view";

const SIDE_PX = 320;
const SECTION = { design: "#36b3ec", measured: "#ff9a1f" };

const dataOf = (id) => byId(id) && JSON.parse(byId(id).textContent);

// --- rows of vessels ------------------------------------------------------------------------------

// Pointing at a row marks its vessel in 3D, and the other way round.
function startSelection(network) {
  const rows = new Map();
  for (const row of document.querySelectorAll("tr[data-vessel]")) {
    const vessel = Number(row.dataset.vessel);
    rows.set(vessel, [...(rows.get(vessel) ?? []), row]);
    prepare(row, vessel);
  }
  for (const name of ["hovered", "selected"]) {
    marked.on(name, (vessel) => {
      for (const row of document.querySelectorAll(`tr.${name}`)) row.classList.remove(name);
      for (const row of rows.get(vessel) ?? []) row.classList.add(name);
    });
  }
  marked.on("selected", (vessel) => describe(network, vessel, rows.get(vessel) ?? []));
}

function prepare(row, vessel) {
  const name = row.cells[0];
  name.append(make("button", { type: "button", title: "Mark in the 3D view" }, ...name.childNodes));
  row.classList.add("linked");
  row.addEventListener("pointerenter", () => marked.set("hovered", vessel));
  row.addEventListener("pointerleave", () => marked.set("hovered", null));
  row.addEventListener("click", () => {
    const again = marked.selected === vessel;
    marked.set("selected", again ? null : vessel);
    if (!again) byId("map").scrollIntoView({ block: "start" });
  });
}

// The panel beside the view repeats the chosen vessel's rows, or else what the view knows of it.
function describe(network, vessel, rows) {
  const panel = byId("selection");
  panel.replaceChildren();
  if (vessel === null) return;
  const known = new Map();
  for (const [name, text] of rows.length ? rows.flatMap(cellsOf) : vesselFacts(network, vessel)) {
    if (!known.has(name)) known.set(name, text);
  }
  panel.append(make("h3", {}, `Vessel ${vesselName(network, vessel)}`),
    make("dl", {}, ...facts([...known])));
  if (!rows.length) return;
  const link = make("a", { href: `#${rows[0].closest("table").id}` }, "To its row");
  link.addEventListener("click", (event) => {
    event.preventDefault();
    rows[0].scrollIntoView({ block: "center" });
  });
  panel.append(link);
}

function cellsOf(row) {
  const headings = row.closest("table").tHead.rows[0].cells;
  return [...row.cells].slice(1)
    .map((cell) => [headings[cell.cellIndex].querySelector("button")?.textContent, cell.textContent])
    .filter(([heading]) => heading);
}

// --- any measured section -------------------------------------------------------------------------

// Its raw picture with both contours, by a click on the plot of its vessel.
async function startSections(data) {
  const box = byId("sections");
  const { level: grey } = await unpackTable(data.grey);
  const wall = await unpackTable(data.wall_um);
  const pictures = new Map(data.vessel.map((v, k) => [`${v}/${data.index[k]}`, k]));
  const [canvas, select, slider, list, none] =
    ["canvas", "select", "input", "dl", ".none"].map((what) => box.querySelector(what));
  const shown = { vessel: null, index: 0 };
  const plots = plotsOf(data);

  function show(vessel, index) {
    const row = data.vessels[vessel];
    if (!row) return;
    const last = row.along_mm.length - 1;
    Object.assign(shown, { vessel, index: Math.min(Math.max(index, 0), last) });
    select.value = vessel;
    [slider.max, slider.value] = [last, shown.index];
    const picture = pictures.get(`${vessel}/${shown.index}`);
    none.hidden = picture !== undefined;
    const designedUm = row.designed_along_um[shown.index];
    drawSection(canvas, { ...data, grey, wall }, picture, designedUm);
    list.replaceChildren(...sectionFacts(vessel, row, shown.index)
      .map((pair) => make("div", {}, ...facts([pair]))));
    for (const plot of plots) plot.mark(shown);
  }

  for (const vessel of Object.keys(data.vessels)) select.add(new Option(`vessel ${vessel}`, vessel));
  select.addEventListener("change", () => {
    show(select.value, Math.floor(data.vessels[select.value].along_mm.length / 2));
    marked.set("selected", Number(select.value));
  });
  slider.addEventListener("input", () => show(shown.vessel, Number(slider.value)));
  for (const { svg, vessel, nearest } of plots) {
    svg.addEventListener("click", (event) => {
      const index = nearest(event);
      if (index === null) return;
      show(vessel, index);
      box.scrollIntoView({ block: "nearest" });
    });
  }
  marked.on("selected", (vessel) => {
    if (vessel !== null && String(vessel) !== shown.vessel) {
      show(String(vessel), firstSection(data, vessel));
    }
  });
  box.hidden = false;
  const [vessel, index] = worstSection(data);
  show(marked.selected === null ? vessel : String(marked.selected), index);
}

// The first of the vessel's sections that isn't a pass, else its middle.
function firstSection(data, vessel) {
  const row = data.vessels[vessel];
  if (!row) return 0;
  const off = row.decision_along.findIndex((decision) => decision !== "pass");
  return off < 0 ? Math.floor(row.along_mm.length / 2) : off;
}

function worstSection(data) {
  for (const decision of ["fail", "undecided"]) {
    for (const [vessel, row] of Object.entries(data.vessels)) {
      const index = row.decision_along.indexOf(decision);
      if (index >= 0) return [vessel, index];
    }
  }
  const vessel = Object.keys(data.vessels)[0];
  return [vessel, firstSection(data, vessel)];
}

// The plots along the vessels: each panel's frame has its vessel's number and its length.
function plotsOf(data) {
  const found = [];
  for (const frame of document.querySelectorAll("svg g[id*='along-']")) {
    const [, vessel, length] = frame.id.match(/along-(\d+)-([\d.]+)$/) ?? [];
    const row = data.vessels[vessel];
    if (!row) continue;
    const svg = frame.ownerSVGElement;
    const { x, y, width, height } = frame.getBBox();
    const line = make("svg:line", { class: "section-mark", y1: y, y2: y + height });
    frame.after(line);
    svg.classList.add("clickable");
    const nearest = ({ clientX, clientY }) => {
      const seen = frame.getBoundingClientRect();
      if (clientX < seen.left || clientX > seen.right) return null;
      if (clientY < seen.top || clientY > seen.bottom) return null;
      const along = ((clientX - seen.left) / seen.width) * Number(length);
      const away = row.along_mm.map((one) => Math.abs(one - along));
      return away.indexOf(Math.min(...away));
    };
    const mark = (shown) => {
      line.style.display = shown.vessel === vessel ? "" : "none";
      if (shown.vessel !== vessel) return;
      const at = x + (row.along_mm[shown.index] / Number(length)) * width;
      for (const end of ["x1", "x2"]) line.setAttribute(end, at);
    };
    found.push({ svg, vessel, nearest, mark });
  }
  return found;
}

function drawSection(canvas, data, picture, designedUm) {
  canvas.width = canvas.height = SIDE_PX;
  const pen = canvas.getContext("2d");
  if (picture === undefined) return;
  const n = data.pixels;
  const image = new ImageData(n, n);
  for (let k = 0; k < n * n; k++) {
    const value = (255 * data.grey[picture * n * n + k]) / (data.levels - 1);
    image.data.set([value, value, value, 255], 4 * k);
  }
  const small = new OffscreenCanvas(n, n);
  small.getContext("2d").putImageData(image, 0, 0);
  pen.imageSmoothingEnabled = false;
  pen.drawImage(small, 0, 0, SIDE_PX, SIDE_PX);
  const scale = SIDE_PX / (2 * data.half_um[picture]);
  pen.translate(SIDE_PX / 2, SIDE_PX / 2);
  pen.lineWidth = 1.8;
  drawWall(pen, data, picture, scale);
  pen.strokeStyle = SECTION.design;
  pen.setLineDash([7, 5]);
  pen.beginPath();
  pen.arc(0, 0, (designedUm / 2) * scale, 0, 2 * Math.PI);
  pen.stroke();
  drawBar(pen, scale);
}

// Gaps stay gaps: no wall was met there.
function drawWall(pen, { wall, rays }, picture, scale) {
  pen.strokeStyle = SECTION.measured;
  pen.beginPath();
  let open = true;
  for (let k = 0; k <= rays; k++) {
    const at = picture * rays + (k % rays);
    const [x, y] = [wall.x[at] * scale, wall.y[at] * scale];
    if (!Number.isNaN(x)) pen[open ? "moveTo" : "lineTo"](x, y);
    open = Number.isNaN(x);
  }
  pen.stroke();
}

function drawBar(pen, scale) {
  const um = roundDown(SIDE_PX / 3 / scale);
  const [left, bottom] = [-SIDE_PX / 2 + 10, SIDE_PX / 2 - 12];
  pen.setLineDash([]);
  pen.strokeStyle = pen.fillStyle = "#fff";
  pen.lineWidth = 3;
  pen.beginPath();
  pen.moveTo(left, bottom);
  pen.lineTo(left + um * scale, bottom);
  pen.stroke();
  pen.font = "12px sans-serif";
  pen.fillText(`${um} µm`, left, bottom - 6);
}

function sectionFacts(vessel, row, index) {
  const value = (key, digits) => fixed(row[key]?.[index], digits);
  const [diameter, interval] = [row.diameter_um[index], row.interval_95_um[index]];
  const sure = diameter && interval !== null ? ` ± ${fixed(interval, 1)} µm (95 %)` : "";
  return [
    ["Vessel, section", `${vessel}, ${index + 1} of ${row.along_mm.length}`],
    ["Along", `${value("along_mm", 2)} mm`],
    ["Designed", `${value("designed_along_um", 1)} µm`],
    ["Measured", diameter === 0 ? "closed" : `${value("diameter_um", 1)} µm${sure}`],
    ["Limits", `${value("lower_um", 1)} to ${value("upper_um", 1)} µm`],
    ["Decision", row.decision_along[index]],
    ["Off the axis", `${value("offset_along_um", 1)} µm`],
    ["Ovality", value("ovality_along", 3)],
  ];
}

startPage(async () => {
  const data = dataOf("view-data");
  if (data) {
    await startView(byId("viewer"), async () => {
      // A page around this one gets the places that are clicked.
      const onPick = (at) => window.parent.postMessage({ printctl: "pick", at }, "*");
      const { network } = await view(byId("viewer"), data, { onPick: data.pick ? onPick : null });
      if (network) startSelection(network);
    });
  }
  const sections = dataOf("sections-data");
  if (sections) await startSections(sections);
});
