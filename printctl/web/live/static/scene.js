// A job's moves as the server packs them (printctl/web/live/pack.py says how).
const MAGIC = "PRINTVIW";
const VERSION = 1;
export const WIDE = 8; // numbers of a point
export const NONE = 65535;
export const ACT = { TRAVEL: 0, LIFTED: 1, WRITE: 2, WIPE: 5, JUMP: 6 };

export class SceneProblem extends Error {}

export async function loadScene(url) {
  let answer;
  try {
    answer = await fetch(url, { credentials: "same-origin" });
  } catch {
    throw new SceneProblem("The server doesn't answer; is it running?");
  }
  if (!answer.ok) throw new SceneProblem(await said(answer));
  return readScene(await answer.arrayBuffer());
}

async function said(answer) {
  try {
    const { detail } = await answer.json();
    if (typeof detail === "string") return detail;
  } catch { /* not JSON: the number has to do */ }
  return `The server answers ${answer.status} instead of the moves.`;
}

export function readScene(buffer) {
  const head = new DataView(buffer, 0, Math.min(16, buffer.byteLength));
  const magic = buffer.byteLength < 16 ? "" : String.fromCharCode(...new Uint8Array(buffer, 0, 8));
  if (magic !== MAGIC || head.getUint32(8, true) !== VERSION) {
    throw new SceneProblem("These moves come in a form that this page doesn't read; reload it.");
  }
  let at = 16 + head.getUint32(12, true);
  const about = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 16, at - 16)));
  const moves = about.moves;
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
export function below(array, value) {
  let [low, high] = [0, array.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (array[middle] < value) low = middle + 1;
    else high = middle;
  }
  return low;
}

// Moves that so many executed commands have done.
export function movesDone(scene, commands) {
  return below(scene.command, commands);
}

// Moves that are done so many seconds after the first `done` ones, by the feeds alone.
export function movesAhead(scene, done, seconds) {
  const now = done > 0 ? scene.time[done - 1] : 0;
  return Math.max(done, below(scene.time, now + seconds));
}
