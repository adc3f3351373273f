// Colours from numbers, and the legends that explain them; for every view.
import { make, roundDown, short } from "viewer/page";

const MAX_NAMES = 14;
const DIGITS = { least: 3, most: 12, shared: 4 };

// Red, green and blue of "#rrggbb", 0 to 255.
export const rgbOf = (hex) => [1, 3, 5].map((at) => Number.parseInt(hex.slice(at, at + 2), 16));

export const cssOf = (rgb) => `rgb(${rgb.map(Math.round).join(" ")})`;

// Of { name, unit, scale, limits, extremes, labels, colours }: `scale` is linear, log, diverging or
// names. Of linear ones the labels are the ticks' texts. Equal limits are those of a constant. Values may
// lie beyond the limits, as far as the `extremes`. `colours` has the house's scales, and that of no value.
export class Scale {
  constructor(quantity, colours) {
    Object.assign(this, quantity);
    [this.low, this.high] = quantity.limits;
    [this.least, this.greatest] = quantity.extremes ?? quantity.limits;
    this.diverging = this.scale === "diverging";
    this.named = this.scale === "names";
    this.stops = this.named ? quantity.colours
      : this.diverging ? colours.diverging : colours.sequential;
    this.parts = this.stops.map(rgbOf);
    this.none = rgbOf(colours.none);
    this.digits = DIGITS.least;
  }

  get title() { return this.unit ? `${this.name} / ${this.unit}` : this.name; }

  // Where a value lies between the scale's ends; diverging colours have their middle at zero.
  place(value) {
    if (this.high === this.low) return 0;
    if (this.diverging) return 0.5 + value / (2 * Math.max(-this.low, this.high));
    if (this.scale !== "log") return (value - this.low) / (this.high - this.low);
    return Math.log(Math.max(value, this.low) / this.low) / Math.log(this.high / this.low);
  }

  // A value's place in a table of `count` colours (of names: one each, in turn); -1 for no value.
  bin(value, count) {
    if (value === null || Number.isNaN(value) || (this.named && value < 0)) return -1;
    if (this.named) return value % this.stops.length;
    return Math.floor(Math.min(Math.max(this.place(value), 0), 1) * (count - 1));
  }

  // The table itself, [r, g, b] each.
  table(count) {
    return this.named ? this.parts : Array.from({ length: count }, (_, i) => this.mix(i / (count - 1)));
  }

  rgb(value) {
    if (value === null || Number.isNaN(value)) return this.none;
    return this.named ? this.parts[value % this.parts.length] : this.mix(this.place(value));
  }

  mix(share) {
    const x = Math.min(Math.max(share, 0), 1) * (this.parts.length - 1);
    const i = Math.min(Math.floor(x), this.parts.length - 2);
    return this.parts[i].map((part, k) => part + (this.parts[i + 1][k] - part) * (x - i));
  }

  // Of named values only those `shown` (a Set), where it is given.
  legend(shown = null) {
    return make("div", {}, make("p", { className: "legend-title" }, this.title),
      ...(this.named ? [this.swatches(shown)] : this.ramp()));
  }

  swatches(shown) {
    if (!this.labels.length) {
      return make("div", { className: "swatches" }, "Neighbours in number differ in colour.");
    }
    const entries = this.labels.map((label, k) => [label, k])
      .filter(([, k]) => !shown || shown.has(k))
      .map(([label, k]) => swatch(this.stops[k], label));
    const more = entries.length - MAX_NAMES;
    return make("div", { className: "swatches" }, ...entries.slice(0, MAX_NAMES),
      ...(more > 0 ? [`and ${more} more`] : []));
  }

  ramp() {
    if (this.high === this.low) {
      return [make("div", { className: "swatches" }, swatch(cssOf(this.rgb(this.low)), short(this.low)))];
    }
    const [from, to] = this.labels.length ? [0, 1] : [this.place(this.low), this.place(this.high)];
    const last = this.stops.length - 1;
    const stops = this.stops.map((hue, i) => `${hue} ${(100 * (i / last - from)) / (to - from)}%`);
    const tick = (share, text) => make("span", { style: `left:${100 * share}%` }, text);
    const ticks = this.labels.length
      ? this.labels.map((text, k) => tick(k / (this.labels.length - 1), text))
      : this.apart([this.low, ...this.between(from, to), this.high]).map((value) =>
        tick((this.place(value) - from) / (to - from), this.endSign(value) + this.text(value)));
    const beyond = this.least < this.low || this.greatest > this.high;
    return [
      make("div", { className: "ramp", style: `background:linear-gradient(to right,${stops})` }),
      make("div", { className: "ticks" }, ...ticks),
      ...(beyond ? [make("p", { className: "small" }, `Values from ${this.text(this.least)} to `
        + `${this.text(this.greatest)}; beyond an end all have its colour.`)] : []),
    ];
  }

  text(value) { return short(value, this.digits, this.diverging); }

  // Ticks in as many digits as tell them apart; where those are many, there is room for the ends alone.
  apart(values) {
    while (new Set(values.map((value) => this.text(value))).size < values.length
      && this.digits < DIGITS.most) this.digits += 1;
    return this.digits > DIGITS.shared ? [this.low, this.high] : values;
  }

  endSign(value) {
    if (value === this.low && this.least < this.low) return "≤ ";
    return value === this.high && this.greatest > this.high ? "≥ " : "";
  }

  // Round numbers between the ends, with room for their text.
  between(from, to) {
    if (this.diverging) return [0];
    let left = 0.06;
    return (this.scale === "log" ? decades : evens)(this.low, this.high).filter((value) => {
      const share = (this.place(value) - from) / (to - from);
      if (share < left + 0.24 || share > 0.74) return false;
      left = share;
      return true;
    });
  }
}

export function swatch(colour, label) {
  return make("span", {}, make("i", { style: `background:${colour}` }), label);
}

function evens(low, high) {
  if (!(high > low)) return [];
  const step = roundDown((high - low) / 4);
  const first = Math.floor(low / step) + 1;
  const count = Math.ceil(high / step) - first;
  return Array.from({ length: count }, (_, k) => Number(((first + k) * step).toPrecision(12)));
}

function decades(low, high) {
  const factors = high / low > 300 ? [1] : [1, 2, 5];
  const [first, last] = [low, high].map((end) => Math.floor(Math.log10(end)));
  return Array.from({ length: last - first + 1 }, (_, k) => first + k)
    .flatMap((power) => factors.map((factor) => Number(`${factor}e${power}`)))
    .filter((value) => value > low && value < high);
}
