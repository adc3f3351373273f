// Colours from numbers, and the colour bars that explain them.
import * as THREE from "three";

const STEPS = 256;
const NAMES_AT_MOST = 14;

// Of { name, unit, scale, limits, labels, colours }; scale is linear, log, diverging or names.
export class Scale {
  constructor(quantity, colours) {
    this.quantity = quantity;
    [this.low, this.high] = quantity.limits;
    this.kind = quantity.scale;
    this.diverging = this.kind === "diverging";
    this.names = this.kind === "names" ? quantity.colours
      : this.diverging ? colours.diverging : colours.sequential;
    this.stops = this.names.map((name) => new THREE.Color(name));
    this.noneName = colours.none;
    this.none = new THREE.Color(colours.none);
  }

  // Diverging colours have their middle at zero, whatever the limits.
  place(value) {
    if (this.diverging) return 0.5 + value / (2 * Math.max(-this.low, this.high));
    if (this.kind !== "log") return (value - this.low) / (this.high - this.low);
    return Math.log(Math.max(value, this.low) / this.low) / Math.log(this.high / this.low);
  }

  colour(value, into) {
    if (value === null || Number.isNaN(value)) return into.copy(this.none);
    const last = this.stops.length - 1;
    const x = Math.min(Math.max(this.place(value), 0), 1) * last;
    const i = Math.min(Math.floor(x), last - 1);
    return into.copy(this.stops[i]).lerp(this.stops[i + 1], x - i);
  }

  // Where in the texture a value's colour is; negative where there is no value.
  texturePlace(value) {
    if (Number.isNaN(value)) return -1;
    if (this.kind === "names") return (value + 0.5) / this.stops.length;
    const share = Math.min(Math.max(this.place(value), 0), 1);
    return (0.5 + share * (STEPS - 1)) / STEPS;
  }

  texture() {
    const named = this.kind === "names";
    const count = named ? this.stops.length : STEPS;
    const bytes = new Uint8Array(4 * count);
    const [colour, last] = [new THREE.Color(), this.stops.length - 1];
    for (let i = 0; i < count; i++) {
      const x = named ? i : (i / (count - 1)) * last;
      const k = Math.min(Math.floor(x), Math.max(last - 1, 0));
      colour.copy(this.stops[k]);
      if (last > 0) colour.lerp(this.stops[k + 1], x - k);
      const hex = colour.getHex();
      bytes.set([hex >> 16, (hex >> 8) & 255, hex & 255, 255], 4 * i);
    }
    const texture = new THREE.DataTexture(bytes, count, 1);
    texture.colorSpace = THREE.SRGBColorSpace;
    texture.magFilter = named ? THREE.NearestFilter : THREE.LinearFilter;
    texture.minFilter = texture.magFilter;
    texture.needsUpdate = true;
    return texture;
  }

  legend() {
    const { name, unit, labels } = this.quantity;
    if (this.kind === "names") return this.swatches(name, labels);
    const box = titled(unit ? `${name} / ${unit}` : name);
    const ramp = document.createElement("div");
    ramp.className = "ramp";
    const [from, to] = [this.place(this.low), this.place(this.high)];
    const last = this.names.length - 1;
    const stops = this.names.map((hue, i) => `${hue} ${(100 * (i / last - from)) / (to - from)}%`);
    ramp.style.background = `linear-gradient(to right, ${stops.join(", ")})`;
    box.append(ramp, this.ticks(from, to));
    return box;
  }

  ticks(from, to) {
    const box = document.createElement("div");
    box.className = "ticks";
    const share = (value) => (this.place(value) - from) / (to - from);
    for (const value of [this.low, ...this.between(share), this.high]) {
      const tick = document.createElement("span");
      tick.style.left = `${100 * share(value)}%`;
      tick.textContent = shortNumber(value, this.diverging);
      box.append(tick);
    }
    return box;
  }

  // Round numbers between the ends, with room for their text.
  between(share) {
    if (this.diverging) return [0];
    const round = this.kind === "log" ? decades(this.low, this.high)
      : evens(this.low, this.high);
    const found = [];
    let left = 0.06;
    for (const value of round) {
      if (share(value) < left + 0.24 || share(value) > 0.78) continue;
      found.push(value);
      left = share(value);
    }
    return found;
  }

  swatches(title, labels) {
    const box = titled(title);
    const list = document.createElement("div");
    list.className = "swatches";
    labels.slice(0, NAMES_AT_MOST).forEach((label, i) => {
      const [item, patch] = [document.createElement("span"), document.createElement("i")];
      patch.style.background = this.names[i];
      item.append(patch, label);
      list.append(item);
    });
    if (labels.length > NAMES_AT_MOST) list.append(`and ${labels.length - NAMES_AT_MOST} more`);
    box.append(list);
    return box;
  }
}

function evens(low, high) {
  const rough = (high - low) / 4;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [5, 2, 1].find((factor) => factor * power <= rough);
  const found = [];
  for (let k = Math.floor(low / step) + 1; k * step < high; k++) found.push(k * step);
  return found;
}

function decades(low, high) {
  const found = [];
  for (let power = Math.floor(Math.log10(low)); 10 ** power <= high; power++) {
    const factors = high / low > 300 ? [1] : [1, 2, 5];
    found.push(...factors.map((factor) => Number(`${factor}e${power}`)));
  }
  return found.filter((value) => value > low && value < high);
}

export function shortNumber(value, signed = false) {
  const size = Number(Math.abs(value).toPrecision(3));
  const text = size !== 0 && size < 1e-3 ? size.toExponential().replace("e-", "·10⁻")
    .replace(/⁻(\d+)$/, (_, power) => `⁻${[...power].map((d) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[d]).join("")}`)
    : String(size);
  if (value < 0) return `−${text}`;
  return signed && value > 0 ? `+${text}` : text;
}

function titled(title) {
  const box = document.createElement("div");
  const line = document.createElement("p");
  line.className = "legend-title";
  line.textContent = title;
  box.append(line);
  return box;
}
