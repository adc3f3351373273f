// Undoes registration/report/play/serialise.py: rows in the order of time, as one piece to draw.
import { ACT } from "gcode/moves";
import { unpack, unpackLevels } from "report/unpack";

const NO_WIDTH = 65535;

export async function readPlay(data) {
  const steps = async (text, by = 1) => summed(await unpack(text, Int32Array), by);
  const n = data.rows;
  const places = await unpackLevels(data.places);
  const [x, y, z] = [0, 1, 2].map((k) => Float32Array.from({ length: n }, (_, i) => places[3 * i + k]));
  const [head, planned] = [await unpack(data.head, Uint8Array), await unpack(data.act, Uint8Array)];
  const chunk = {
    n, x, y, z, head, planned,
    time: await steps(data.time_ms, 1e-3),
    laid: await steps(data.laid, data.laid_step_ul),
    line: await steps(data.line),
    layer: await steps(data.layer),
    vessel: await steps(data.vessel),
    width: widths(await unpack(data.width_um, Uint16Array)),
    wanted: widths(await unpack(data.wanted_um, Uint16Array)),
  };
  // A travel that leaves a thread is drawn as what lies there.
  chunk.act = Uint8Array.from(planned, (act, i) =>
    act === ACT.TRAVEL && chunk.width[i] > 0 ? ACT.WRITE : act);
  return chunk;
}

function summed(differences, by) {
  const found = new Float64Array(differences.length);
  let sum = 0;
  differences.forEach((step, i) => { sum += step; found[i] = sum * by; });
  return found;
}

function widths(um) {
  return Float32Array.from(um, (value) => (value === NO_WIDTH ? NaN : value / 1000));
}

// First rows of the layers, and after the last the end.
export function layerStarts(chunk, count) {
  const first = new Int32Array(count + 1).fill(-1);
  for (let i = chunk.n - 1; i >= 0; i--) first[chunk.layer[i]] = i;
  first[count] = chunk.n;
  // A layer that isn't drawn has no rows.
  for (let k = count - 1; k >= 0; k--) if (first[k] < 0) first[k] = first[k + 1];
  return first;
}

// The row under way at a time: the first that ends after it.
export function rowAt(chunk, time) {
  let [low, high] = [1, chunk.n - 1];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (chunk.time[middle] > time) high = middle;
    else low = middle + 1;
  }
  return Math.min(low, chunk.n - 1);
}

// A row as far as it is done, as a piece of its own.
export function cutRow(chunk, i, share) {
  const part = { n: 2 };
  for (const axis of ["x", "y", "z"]) {
    const [a, b] = [chunk[axis][i - 1], chunk[axis][i]];
    part[axis] = [a, a + share * (b - a)];
  }
  for (const name of ["width", "wanted", "vessel", "head", "line", "planned"]) {
    part[name] = [NaN, chunk[name][i]];
  }
  part.act = [ACT.JUMP, chunk.act[i]];
  return part;
}

export function shareAt(chunk, i, time) {
  const [a, b] = [chunk.time[i - 1], chunk.time[i]];
  if (chunk.act[i] === ACT.JUMP) return 0;
  return b > a ? Math.min(Math.max((time - a) / (b - a), 0), 1) : 1;
}
