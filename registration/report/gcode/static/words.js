// Numbers of a layer and of a move in words.
import { short } from "gcode/colours";
import { ACT, textOf } from "gcode/moves";

const SAID = {
  [ACT.TRAVEL]: "Travel", [ACT.LIFTED]: "Lifted travel", [ACT.WRITE]: "Written",
  [ACT.PRIME]: "Prime", [ACT.RETRACT]: "Retraction", [ACT.WIPE]: "Retraction on the way",
};

export function duration(seconds) {
  if (seconds < 90) return `${short(seconds)} s`;
  return seconds < 5400 ? `${short(seconds / 60)} min` : `${short(seconds / 3600)} h`;
}

export function layerNumbers(layers, k, passes) {
  const of = (key) => layers[key][k];
  const lines = of("last_line") ? `${of("first_line")}–${of("last_line")}` : "–";
  return [
    [passes ? "Highest tip z" : "Tip at z", `${short(of("z"), 6)} mm`],
    ...(of("height") === null ? [] : [["Line height", `${short(of("height"), 4)} mm`]]),
    ...(passes ? [] : [["Unbroken lines", short(of("lines"))]]),
    ["Moves that write", short(of("written"))],
    ["Written", of("ul") === null ? "not known" : `${short(of("ul"), 4)} µL`],
    ["Way written", `${short(of("way_mm"), 4)} mm`],
    ["Way between", `${short(of("travel_mm"), 4)} mm`],
    ["Time as fed", duration(of("time_s"))],
    ["Lines of the file", lines],
  ];
}

// How far ink lies beyond the design's outline: 5, 50 and 95 % of the outline stay below.
export function beyondNumbers(outline, k) {
  const found = outline?.beyond[k] ?? [];
  if (!found.length) return [];
  return [["Past outline, 5/50/95 %", `${found.map((um) => short(um)).join(" / ")} µm`]];
}

export function moveNumbers(chunk, i, kinds, vessels) {
  const act = chunk.act[i];
  const way = Math.hypot(
    ...["x", "y", "z"].map((axis) => chunk[axis][i] - chunk[axis][i - 1]));
  const width = chunk.width[i];
  const still = act === ACT.PRIME || act === ACT.RETRACT;
  return {
    title: kinds[chunk.kind[i]] && act === ACT.WRITE ? kinds[chunk.kind[i]] : SAID[act],
    line: chunk.line[i],
    text: textOf(chunk, i),
    facts: [
      ...(act === ACT.WRITE && !Number.isNaN(width) ? [["Width", `${short(width, 4)} mm`]] : []),
      ...(still || act === ACT.WIPE ? [["Pushed", `${short(chunk.dose[i])} µL`]] : []),
      ...(still ? [] : [["Length", `${short(way, 4)} mm`]]),
      ["Speed, as fed", `${short(chunk.speed[i], 4)} mm/s`],
      ["To", ["x", "y", "z"].map((axis) => short(chunk[axis][i], 6)).join(", ")],
      ...(vessels && chunk.vessel[i] >= 0 ? [["Vessel", String(chunk.vessel[i])]] : []),
    ],
  };
}

export function list(pairs) {
  return pairs.flatMap(([name, text]) => {
    const [dt, dd] = ["dt", "dd"].map((tag) => document.createElement(tag));
    [dt.textContent, dd.textContent] = [name, text];
    return [dt, dd];
  });
}
