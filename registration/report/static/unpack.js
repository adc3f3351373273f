// Undoes registration/report/packing.py: base64, deflate, differences, levels.
const NO_DATA = 65535;

export async function unpack(text, Type) {
  const bytes = Uint8Array.from(atob(text), (sign) => sign.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Type(await new Response(stream).arrayBuffer());
}

// Positions: differences from point to point of levels, wrapped to 16 bits.
export async function unpackLevels({ positions: packed, low, step }) {
  const levels = await unpack(packed, Uint16Array);
  for (let i = 3; i < levels.length; i++) levels[i] += levels[i - 3];
  const positions = new Float32Array(levels.length);
  for (let i = 0; i < levels.length; i++) {
    positions[i] = low[i % 3] + step[i % 3] * levels[i];
  }
  return positions;
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
