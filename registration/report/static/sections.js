// Any measured section: its raw picture with both contours, by a click on the plot of its vessel.
import { listen, set, state } from "report/bus";
import { unpack } from "report/unpack";

const NONE = -32768;
const SIDE = 320;
const DESIGN = "#36b3ec";
const MEASURED = "#ff9a1f";

export async function startSections(data) {
  const box = document.getElementById("sections");
  const grey = await unpack(data.grey, Uint8Array);
  const wall = await unpack(data.wall_um, Int16Array);
  const pictures = new Map(data.vessel.map((v, k) => [`${v}/${data.index[k]}`, k]));
  const parts = {
    canvas: box.querySelector("canvas"),
    vessel: box.querySelector("select"),
    section: box.querySelector("input"),
    facts: box.querySelector("dl"),
    none: box.querySelector(".none"),
  };
  const shown = { vessel: null, index: 0 };
  const marks = panels(data);

  function show(vessel, index) {
    const row = data.vessels[vessel];
    if (!row) return;
    shown.vessel = vessel;
    shown.index = Math.min(Math.max(index, 0), row.along_mm.length - 1);
    parts.vessel.value = vessel;
    parts.section.max = row.along_mm.length - 1;
    parts.section.value = shown.index;
    const picture = pictures.get(`${vessel}/${shown.index}`);
    parts.none.hidden = picture !== undefined;
    draw(parts.canvas, data, grey, wall, picture, row, shown.index);
    tell(parts.facts, vessel, row, shown.index);
    for (const mark of marks) mark.point(shown);
  }

  for (const vessel of Object.keys(data.vessels)) {
    parts.vessel.add(new Option(`vessel ${vessel}`, vessel));
  }
  parts.vessel.addEventListener("change", () => {
    const row = data.vessels[parts.vessel.value];
    show(parts.vessel.value, Math.floor(row.along_mm.length / 2));
    set("selected", Number(parts.vessel.value));
  });
  parts.section.addEventListener("input", () => show(shown.vessel, Number(parts.section.value)));
  for (const mark of marks) {
    mark.svg.addEventListener("click", (event) => {
      const index = mark.nearest(event);
      if (index === null) return;
      show(mark.vessel, index);
      box.scrollIntoView({ block: "nearest" });
    });
  }
  listen("selected", (vessel) => {
    if (vessel !== null && String(vessel) !== shown.vessel) show(String(vessel), first(data, vessel));
  });
  box.hidden = false;
  const [vessel, index] = worst(data);
  show(state.selected === null ? vessel : String(state.selected), index);
}

// Where the vessel's sections aren't a pass, else its middle.
function first(data, vessel) {
  const row = data.vessels[vessel];
  if (!row) return 0;
  const off = row.decision_along.findIndex((decision) => decision !== "pass");
  return off < 0 ? Math.floor(row.along_mm.length / 2) : off;
}

function worst(data) {
  for (const decision of ["fail", "undecided"]) {
    for (const [vessel, row] of Object.entries(data.vessels)) {
      const index = row.decision_along.indexOf(decision);
      if (index >= 0) return [vessel, index];
    }
  }
  const vessel = Object.keys(data.vessels)[0];
  return [vessel, first(data, vessel)];
}

// The plots along the vessels: each panel's frame has its vessel's number and its length.
function panels(data) {
  const found = [];
  for (const frame of document.querySelectorAll("svg g[id*='along-']")) {
    const [, vessel, length] = frame.id.match(/along-(\d+)-([\d.]+)$/) ?? [];
    const row = data.vessels[vessel];
    if (!row) continue;
    const svg = frame.ownerSVGElement;
    const box = frame.getBBox();
    const line = document.createElementNS(svg.namespaceURI, "line");
    line.setAttribute("class", "section-mark");
    line.setAttribute("y1", box.y);
    line.setAttribute("y2", box.y + box.height);
    frame.after(line);
    svg.classList.add("clickable");
    const place = (k) => box.x + (row.along_mm[k] / Number(length)) * box.width;
    found.push({
      svg,
      vessel,
      nearest: (event) => {
        const seen = frame.getBoundingClientRect();
        const [x, y] = [event.clientX, event.clientY];
        if (x < seen.left || x > seen.right || y < seen.top || y > seen.bottom) return null;
        const along = ((x - seen.left) / seen.width) * Number(length);
        const away = row.along_mm.map((one) => Math.abs(one - along));
        return away.indexOf(Math.min(...away));
      },
      point: (shown) => {
        line.style.display = shown.vessel === vessel ? "" : "none";
        if (shown.vessel !== vessel) return;
        line.setAttribute("x1", place(shown.index));
        line.setAttribute("x2", place(shown.index));
      },
    });
  }
  return found;
}

function draw(canvas, data, grey, wall, picture, row, index) {
  canvas.width = canvas.height = SIDE;
  const pen = canvas.getContext("2d");
  pen.clearRect(0, 0, SIDE, SIDE);
  if (picture === undefined) return;
  const n = data.pixels;
  const image = new ImageData(n, n);
  for (let k = 0; k < n * n; k++) {
    const value = (255 * grey[picture * n * n + k]) / (data.levels - 1);
    image.data.set([value, value, value, 255], 4 * k);
  }
  const small = new OffscreenCanvas(n, n);
  small.getContext("2d").putImageData(image, 0, 0);
  pen.imageSmoothingEnabled = false;
  pen.drawImage(small, 0, 0, SIDE, SIDE);
  const scale = SIDE / (2 * data.half_um[picture]);
  pen.translate(SIDE / 2, SIDE / 2);
  pen.lineWidth = 1.8;
  outline(pen, data, wall, picture, scale);
  pen.strokeStyle = DESIGN;
  pen.setLineDash([7, 5]);
  pen.beginPath();
  pen.arc(0, 0, (row.designed_along_um[index] / 2) * scale, 0, 2 * Math.PI);
  pen.stroke();
  bar(pen, scale);
}

// Gaps stay gaps: no wall was met there.
function outline(pen, data, wall, picture, scale) {
  pen.strokeStyle = MEASURED;
  pen.beginPath();
  let open = true;
  for (let k = 0; k <= data.rays; k++) {
    const at = 2 * (picture * data.rays + (k % data.rays));
    const [x, y] = [wall[at], wall[at + 1]];
    if (x === NONE) open = true;
    else if (open) pen.moveTo(x * scale, y * scale);
    else pen.lineTo(x * scale, y * scale);
    if (x !== NONE) open = false;
  }
  pen.stroke();
}

function bar(pen, scale) {
  const um = [1000, 500, 200, 100, 50].find((one) => one * scale < SIDE / 3) ?? 20;
  pen.setLineDash([]);
  pen.strokeStyle = pen.fillStyle = "#fff";
  pen.lineWidth = 3;
  pen.beginPath();
  pen.moveTo(-SIDE / 2 + 10, SIDE / 2 - 12);
  pen.lineTo(-SIDE / 2 + 10 + um * scale, SIDE / 2 - 12);
  pen.stroke();
  pen.font = "12px sans-serif";
  pen.fillText(`${um} µm`, -SIDE / 2 + 10, SIDE / 2 - 18);
}

function tell(list, vessel, row, index) {
  const value = (key, digits) => fixed(row[key]?.[index], digits);
  const diameter = row.diameter_um[index];
  const sure = row.interval_95_um[index];
  const measured = diameter === 0 ? "closed" : `${value("diameter_um", 1)} µm`;
  const facts = [
    ["Vessel, section", `${vessel}, ${index + 1} of ${row.along_mm.length}`],
    ["Along", `${value("along_mm", 2)} mm`],
    ["Designed", `${value("designed_along_um", 1)} µm`],
    ["Measured", `${measured}${diameter && sure !== null ? ` ± ${fixed(sure, 1)} µm (95 %)` : ""}`],
    ["Limits", `${value("lower_um", 1)} to ${value("upper_um", 1)} µm`],
    ["Decision", row.decision_along[index]],
    ["Off the axis", `${value("offset_along_um", 1)} µm`],
    ["Ovality", value("ovality_along", 3)],
  ];
  list.replaceChildren(...facts.map(([label, text]) => {
    const line = document.createElement("div");
    const [name, told] = [document.createElement("dt"), document.createElement("dd")];
    name.textContent = label;
    told.textContent = text;
    line.append(name, told);
    return line;
  }));
}

function fixed(value, digits) {
  return typeof value === "number" ? value.toFixed(digits).replace("-", "−") : "–";
}
