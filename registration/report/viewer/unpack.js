// Undoes registration/report/packing.py: base64, deflate, differences, levels, columns.
const NO_DATA = 65535;
const KINDS = { u1: Uint8Array, u2: Uint16Array, i2: Int16Array, i4: Int32Array, f4: Float32Array };

export async function unpack(text, Type = Uint8Array) {
  const bytes = Uint8Array.from(atob(text), (sign) => sign.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Type(await new Response(stream).arrayBuffer());
}

// Columns of n numbers by name: byte by byte (all lowest bytes first) of `kind`, as differences if
// `summed`, in units of `step`; `none` stands for no value.
export async function unpackColumns(text, n, columns) {
  const bytes = await unpack(text);
  const rows = { n };
  let at = 0;
  for (const { name, kind, step, summed, none } of columns) {
    const size = KINDS[kind].BYTES_PER_ELEMENT;
    const woven = new Uint8Array(size * n);
    for (let k = 0; k < size; k++) {
      for (let i = 0; i < n; i++) woven[size * i + k] = bytes[at + k * n + i];
    }
    at += size * n;
    const values = new KINDS[kind](woven.buffer);
    if (summed) for (let i = 1; i < n; i++) values[i] += values[i - 1];
    rows[name] = step === 1 && none === null ? values
      : Float64Array.from(values, (value) => (value === none ? NaN : value * step));
  }
  return rows;
}

// Positions: differences from point to point of levels, wrapped to 16 bits.
export async function unpackLevels({ positions: packed, low, step }) {
  const levels = await unpack(packed, Uint16Array);
  for (let i = 3; i < levels.length; i++) levels[i] += levels[i - 3];
  return Float32Array.from(levels, (level, i) => low[i % 3] + step[i % 3] * level);
}

export async function unpackSurface(surface) {
  const positions = await unpackLevels(surface);
  const faces = new Uint32Array((await unpack(surface.faces, Int32Array)).buffer);
  for (let i = 1; i < faces.length; i++) faces[i] += faces[i - 1];
  return { positions, faces, values: await unpackScalar(surface.scalar) };
}

async function unpackScalar(scalar) {
  if (!scalar) return null;
  const levels = await unpack(scalar.levels, Uint16Array);
  return Float32Array.from(levels, (level) =>
    level === NO_DATA ? NaN : scalar.low + scalar.step * level);
}
