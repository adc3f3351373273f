// Undoes report/packing.py: base64, deflate, columns.
const KINDS = { u1: Uint8Array, u2: Uint16Array, i2: Int16Array, i4: Int32Array, f4: Float32Array };

export async function unpack(text) {
  const bytes = Uint8Array.from(atob(text), (sign) => sign.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Columns of n numbers by name: byte by byte (all lowest bytes first) of `kind`, as differences if
// `summed`; a value is `low` + `step` times its number, and `none` stands for no value.
export async function unpackColumns(text, n, columns) {
  const bytes = await unpack(text);
  const rows = { n };
  let at = 0;
  for (const { name, kind, step, low, summed, none } of columns) {
    const size = KINDS[kind].BYTES_PER_ELEMENT;
    const woven = new Uint8Array(size * n);
    for (let k = 0; k < size; k++) {
      for (let i = 0; i < n; i++) woven[size * i + k] = bytes[at + k * n + i];
    }
    at += size * n;
    const values = new KINDS[kind](woven.buffer);
    if (summed) for (let i = 1; i < n; i++) values[i] += values[i - 1];
    const plain = step === 1 && low === 0 && none === null;
    rows[name] = plain ? values
      : Float64Array.from(values, (value) => (value === none ? NaN : low + step * value));
  }
  return rows;
}

export const unpackTable = ({ rows, columns, data }) => unpackColumns(data, rows, columns);

// Flat x, y, z of points.
export function flatPlaces({ n, x, y, z }) {
  const places = new Float32Array(3 * n);
  for (let i = 0; i < n; i++) places.set([x[i], y[i], z[i]], 3 * i);
  return places;
}
