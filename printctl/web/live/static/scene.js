// A job's moves as the server packs them (printctl/web/live/pack.py says how), and their colours.
import { bisect } from "viewer/page";
import { Scale } from "viewer/scale";

const MAGIC = "PRINTVIW";
const VERSION = 1;
export const WIDE = 8; // numbers of a point
export const COLUMN = { x: 0, y: 1, z: 2, layer: 3, vessel: 4, ink: 5, width: 6, act: 7 };
export const USUAL_UM = 200; // width of a line that says none
export const TEXELS = 256;
export const HUES = ["stage", "ghost", "next", "way", "rim"];
const RAMP = ["#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d"];
const IN_TURN = [
  "#2f6fb5", "#c8701a", "#2e8b57", "#b8415d", "#7a5fb8", "#4f9fa8", "#a0772d", "#5f7d2a",
  "#a64fa0", "#3d8fd1", "#cf5f45", "#6f7f8c",
];

export class SceneProblem extends Error {}

export async function loadScene(url) {
  const answer = await fetch(url, { credentials: "same-origin" }).catch(() => null);
  if (!answer) throw new SceneProblem("The server doesn't answer; is it running?");
  if (answer.ok) return readScene(await answer.arrayBuffer());
  const { detail } = await answer.json().catch(() => ({}));
  throw new SceneProblem(typeof detail === "string" ? detail
    : `The server answers ${answer.status} instead of the moves.`);
}

function readScene(buffer) {
  const head = new DataView(buffer, 0, Math.min(16, buffer.byteLength));
  const magic = buffer.byteLength < 16 ? "" : String.fromCharCode(...new Uint8Array(buffer, 0, 8));
  if (magic !== MAGIC || head.getUint32(8, true) !== VERSION) {
    throw new SceneProblem("These moves come in a form that this page doesn't read; reload it.");
  }
  let at = 16 + head.getUint32(12, true);
  const about = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 16, at - 16)));
  const { moves } = about;
  const points = new Uint16Array(buffer, at, WIDE * (moves + 1));
  at += points.byteLength;
  const command = new Uint32Array(buffer, at, moves);
  return { about, moves, points, command, time: new Float32Array(buffer, at + 4 * moves, moves) };
}

// Place of point i, mm.
export function placeOf({ about, points }, i) {
  return [0, 1, 2].map((axis) => about.low_mm[axis] + about.step_mm[axis] * points[WIDE * i + axis]);
}

// How many entries of an ascending array lie below a value.
const below = (array, value) => bisect(0, array.length, (i) => array[i] >= value);

// Moves that so many executed commands have done.
export const movesDone = (scene, commands) => below(scene.command, commands);

// Moves that are done so many seconds after the first `done` ones, by the feeds alone.
export function movesAhead(scene, done, seconds) {
  const now = done > 0 ? scene.time[done - 1] : 0;
  return Math.max(done, below(scene.time, now + seconds));
}

// What the colours can show of a job, as [key, name] each.
export function colourings(about) {
  return [["layer", about.passes ? "pass" : "layer"],
    ...(about.vessels > 1 ? [["vessel", "vessel"]] : []), ...(about.heads > 1 ? [["ink", "ink"]] : [])];
}

// Layers follow a ramp; of anything else neighbours in number differ.
export function scaleOf(by, about) {
  const ramp = by === "layer" && !about.passes;
  return new Scale({
    name: by, unit: "", labels: [], colours: IN_TURN, scale: ramp ? "linear" : "names",
    limits: [0, Math.max(about.layers.length - 1, 1)],
  }, { sequential: RAMP, none: IN_TURN[0] });
}

// Those colours as a band, for a legend.
export function bandOf(by, about) {
  const colours = by === "layer" && !about.passes ? RAMP : IN_TURN.slice(0, 4);
  const share = 100 / colours.length;
  return `linear-gradient(90deg, ${colours.map((one, k) => `${one} ${k * share}% ${(k + 1) * share}%`).join(", ")})`;
}

// Places that are to be seen: all that is written, and what stands on the bed.
export const placesOf = (about) =>
  [about.written_low_mm, about.written_high_mm, ...about.outlines.flat()];

// What a whole picture is made of, as [look, first, last] of moves each.
export function partsOf({ written, rest, travels }, moves) {
  return [...(rest ? [["ghost", written, moves]] : []), ["solid", 0, written],
    ...(travels ? [["way", 0, moves]] : [])].filter(([, first, last]) => last > first);
}

// What is to be drawn over a painter's picture, [first, last] of moves; null where nothing is, and then
// all is drawn anew if it has to. What comes next is drawn whole, since what was just written may lie
// over a part.
export function painted(painter, mostOnTop) {
  const { state, painted: { written, next } } = painter;
  const ahead = Math.max(state.next, state.written);
  if (state.written < written || ahead < next || state.written - written > mostOnTop) {
    painter.draw();
    return null;
  }
  if (ahead === next && state.written === written) return null;
  painter.painted = { written: state.written, next: ahead };
  return { solid: [written, state.written], next: [state.written, ahead] };
}
