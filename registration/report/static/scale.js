// Colours from numbers, and the colour bars that explain them.
import { Color } from "three";

export class Scale {
  constructor(limits, colours) {
    [this.low, this.high] = limits;
    this.diverging = this.low < 0 && this.high > 0;
    this.names = this.diverging ? colours.diverging : colours.sequential;
    this.stops = this.names.map((name) => new Color(name));
    this.none = new Color(colours.none);
  }

  // Diverging colours have their middle at zero, whatever the limits.
  place(value) {
    if (!this.diverging) return (value - this.low) / (this.high - this.low);
    const reach = Math.max(-this.low, this.high);
    return 0.5 + value / (2 * reach);
  }

  colour(value, into) {
    if (value === null || Number.isNaN(value)) return into.copy(this.none);
    const last = this.stops.length - 1;
    const x = Math.min(Math.max(this.place(value), 0), 1) * last;
    const i = Math.min(Math.floor(x), last - 1);
    return into.copy(this.stops[i]).lerp(this.stops[i + 1], x - i);
  }

  legend(title) {
    const box = titled(title);
    const ramp = document.createElement("div");
    ramp.className = "ramp";
    const [from, to] = [this.place(this.low), this.place(this.high)];
    const last = this.names.length - 1;
    const stops = this.names.map((name, i) => `${name} ${(100 * (i / last - from)) / (to - from)}%`);
    ramp.style.background = `linear-gradient(to right, ${stops.join(", ")})`;
    box.append(ramp, this.ticks());
    return box;
  }

  ticks() {
    const box = document.createElement("div");
    box.className = "ticks";
    const middle = this.diverging ? 0 : (this.low + this.high) / 2;
    for (const value of [this.low, middle, this.high]) {
      const tick = document.createElement("span");
      tick.style.left = `${(100 * (value - this.low)) / (this.high - this.low)}%`;
      tick.textContent = shortNumber(value, this.diverging);
      box.append(tick);
    }
    return box;
  }
}

export function swatches(title, entries) {
  const box = titled(title);
  const list = document.createElement("div");
  list.className = "swatches";
  for (const [name, colour] of entries) {
    const item = document.createElement("span");
    const patch = document.createElement("i");
    patch.style.background = colour;
    item.append(patch, name);
    list.append(item);
  }
  box.append(list);
  return box;
}

export function shortNumber(value, signed = false) {
  const text = String(Number(Math.abs(value).toPrecision(3)));
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
