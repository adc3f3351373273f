// Colours of what is written, and the page's own that the view is drawn in.
const RAMP = ["#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d"];
const APART = [
  "#2f6fb5", "#c8701a", "#2e8b57", "#b8415d", "#7a5fb8", "#4f9fa8", "#a0772d", "#5f7d2a",
  "#a64fa0", "#3d8fd1", "#cf5f45", "#6f7f8c",
];
const TEXELS = 256;

function parts(hex) {
  return [1, 3, 5].map((at) => Number.parseInt(hex.slice(at, at + 2), 16));
}

function along(share) {
  const x = Math.min(Math.max(share, 0), 1) * (RAMP.length - 1);
  const i = Math.min(Math.floor(x), RAMP.length - 2);
  const [a, b] = [parts(RAMP[i]), parts(RAMP[i + 1])];
  return a.map((value, k) => Math.round(value + (b[k] - value) * (x - i)));
}

// `column` is the number of a point that says the colour; `fold` how many colours take turns
// (0: they follow the ramp up to `top`); `table` is RGBA of TEXELS colours.
export function palette(by, about) {
  const table = new Uint8Array(4 * TEXELS).fill(255);
  const ramp = by === "layer" && !about.passes;
  for (let i = 0; i < TEXELS; i++) {
    table.set(ramp ? along(i / (TEXELS - 1)) : parts(APART[i % APART.length]), 4 * i);
  }
  const column = { layer: 3, vessel: 4, ink: 5 }[by];
  return { column, fold: ramp ? 0 : APART.length, top: Math.max(about.layers.length - 1, 1), table };
}

export function texelOf({ fold, top }, value) {
  return fold ? value % fold : Math.round((value / top) * (TEXELS - 1));
}

export function cssOf({ table }, texel) {
  return `rgb(${table[4 * texel]} ${table[4 * texel + 1]} ${table[4 * texel + 2]})`;
}

// What the colours can tell about this job.
export function choices(about) {
  const found = [["layer", about.passes ? "pass" : "layer"]];
  if (about.vessels > 1) found.push(["vessel", "vessel"]);
  if (about.heads > 1) found.push(["ink", "ink"]);
  return found;
}

// Colours that the style sheet names, as [r, g, b] from 0 to 1 and as text.
export function hues(element) {
  const style = getComputedStyle(element);
  const named = {};
  for (const name of ["stage", "ghost", "next", "way", "rim"]) {
    const text = style.getPropertyValue(`--live-${name}`).trim();
    named[name] = { text, rgb: parts(text).map((value) => value / 255) };
  }
  return named;
}
