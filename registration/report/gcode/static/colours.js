// What lines are coloured by, and the legend that explains it.
const BINS = 48;

export function short(value, digits = 3) {
  if (value === null || !Number.isFinite(value)) return "–";
  if (Number.isInteger(value)) return value.toLocaleString("en").replaceAll(",", "\u202f");
  return String(Number(value.toPrecision(digits))).replace("-", "\u2212");
}

export function mix(stops, share) {
  const x = Math.min(Math.max(share, 0), 1) * (stops.length - 1);
  const i = Math.min(Math.floor(x), stops.length - 2);
  const part = (stop, k) => Number.parseInt(stop.slice(1 + 2 * k, 3 + 2 * k), 16);
  const both = [0, 1, 2].map((k) => {
    const [a, b] = [part(stops[i], k), part(stops[i + 1], k)];
    return Math.round(a + (b - a) * (x - i));
  });
  return `rgb(${both.join(" ")})`;
}

export class Colours {
  constructor(colouring, scale, none) {
    Object.assign(this, colouring);
    this.named = colouring.colours.length > 0;
    this.count = this.named ? colouring.colours.length : BINS;
    this.table = this.named ? [...colouring.colours]
      : Array.from({ length: BINS }, (_, i) => mix(scale, i / (BINS - 1)));
    this.table.push(none);
    this.scale = scale;
  }

  // Place in the table of a row's colour; first and last row say where the order begins and ends.
  bin(chunk, i, first, last) {
    const value = this.value(chunk, i, first, last);
    if (this.named) return value < 0 ? this.count : value % this.count;
    if (Number.isNaN(value)) return BINS;
    const [low, high] = this.limits;
    const share = Math.min(Math.max((value - low) / Math.max(high - low, 1e-12), 0), 1);
    return Math.floor(share * (BINS - 1));
  }

  value(chunk, i, first, last) {
    switch (this.key) {
      case "line": return 0;
      case "width": return chunk.width[i];
      case "speed": return chunk.speed[i];
      case "kind": return chunk.kind[i];
      case "vessel": return chunk.vessel[i];
      case "height": return (chunk.z[i] + chunk.z[i - 1]) / 2;
      default: return (i - first) / Math.max(last - first - 1, 1);
    }
  }

  legend(there) {
    const box = document.createElement("div");
    const title = document.createElement("p");
    title.className = "legend-title";
    title.textContent = this.unit ? `${this.name} / ${this.unit}` : this.name;
    box.append(title, ...(this.named ? this.swatches(there) : this.ramp()));
    return box;
  }

  swatches(there) {
    const box = document.createElement("div");
    box.className = "swatches";
    this.labels.forEach((label, k) => {
      if (this.key === "kind" && !there.has(k)) return;
      const entry = document.createElement("span");
      const colour = document.createElement("i");
      colour.style.background = this.table[k];
      entry.append(colour, label);
      box.append(entry);
    });
    if (!this.labels.length) box.textContent = "Neighbours in number differ in colour.";
    return [box];
  }

  ramp() {
    const ramp = document.createElement("div");
    ramp.className = "ramp";
    ramp.style.background = `linear-gradient(to right, ${this.scale.join(", ")})`;
    const ticks = document.createElement("div");
    ticks.className = "ticks";
    const [low, high] = this.limits;
    const texts = this.key === "order" ? ["first", "last"]
      : [low, (low + high) / 2, high].map((x) => short(x));
    texts.forEach((text, k) => {
      const tick = document.createElement("span");
      tick.textContent = text;
      tick.style.left = `${(100 * k) / (texts.length - 1)}%`;
      ticks.append(tick);
    });
    return [ramp, ticks];
  }
}
