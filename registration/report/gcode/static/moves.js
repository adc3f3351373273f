// Undoes registration/report/gcode/chunks.py: one piece of the job at a time.
import { unpack } from "report/unpack";

export const ACT = { TRAVEL: 0, LIFTED: 1, WRITE: 2, PRIME: 3, RETRACT: 4, WIPE: 5, JUMP: 6 };
const NO_WIDTH = 65535;
const KEPT = 6;

// Pieces of the page, unpacked when they are asked for; the latest few, or all of them, are kept.
export class Chunks {
  constructor(rows, keepAll) {
    this.rows = rows;
    this.kept = new Map();
    this.most = keepAll ? rows.length : KEPT;
    this.data = document.querySelectorAll("script.chunk");
    this.text = document.querySelectorAll("script.lines");
  }

  get(k) {
    const found = this.kept.get(k) ?? this.read(k);
    this.kept.delete(k);
    this.kept.set(k, found);
    if (this.kept.size > this.most) this.kept.delete(this.kept.keys().next().value);
    return found;
  }

  async read(k) {
    const bytes = await unpack(this.data[k].textContent, Uint8Array);
    const chunk = split(bytes, this.rows[k]);
    const text = this.text[k].textContent;
    chunk.text = text ? new TextDecoder().decode(await unpack(text, Uint8Array)).split("\n") : null;
    return chunk;
  }
}

function split(bytes, n) {
  let at = 0;
  const take = (count) => bytes.subarray(at, (at += count));
  const whole = () => integers(take(4 * n), n);
  const [x, y, z] = [0, 1, 2].map(() => Float32Array.from(summed(whole()), (um) => um / 1000));
  const speed = Float32Array.from(whole(), (um) => um / 1000);
  const line = summed(whole());
  const vessel = whole();
  const plane = take(2 * n);
  const width = new Float32Array(n);
  for (let i = 0; i < n; i++) {
    const um = plane[i] | (plane[n + i] << 8);
    width[i] = um === NO_WIDTH ? NaN : um / 1000;
  }
  const [act, named] = [take(n), take(n)];
  const kind = Int16Array.from(named, (value) => value - 1);
  return { n, x, y, z, speed, line, vessel, width, act, kind, dose: doses(bytes.slice(at), act) };
}

export function integers(planes, n) {
  const found = new Int32Array(n);
  for (let i = 0; i < n; i++) {
    found[i] = planes[i] | (planes[n + i] << 8) | (planes[2 * n + i] << 16)
      | (planes[3 * n + i] << 24);
  }
  return found;
}

export function summed(values) {
  for (let i = 1; i < values.length; i++) values[i] += values[i - 1];
  return values;
}

// Only primes, retractions and wipes carry a dose.
function doses(bytes, act) {
  const given = new Float32Array(bytes.buffer);
  const found = new Float32Array(act.length);
  let k = 0;
  act.forEach((a, i) => {
    if (a === ACT.PRIME || a === ACT.RETRACT || a === ACT.WIPE) found[i] = given[k++];
  });
  return found;
}

// The file's text of a row: a row of the same line as the one before has none of its own.
export function textOf(chunk, row) {
  if (!chunk.text) return null;
  let i = row;
  while (i > 0 && chunk.line[i - 1] === chunk.line[row]) i--;
  return chunk.text[i];
}
