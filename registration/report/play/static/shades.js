// Colours of a predicted line: beside those of the G-code's page what it is off by, and its ink.
import { Colours } from "gcode/colours";
import { ACT } from "gcode/moves";

export class Shades extends Colours {
  constructor(colouring, scales, none) {
    super(colouring, colouring.diverging ? scales.diverging : scales.sequential, none);
  }

  // A thread along a travel belongs to nothing, whatever it is coloured by.
  bin(chunk, i, first, last) {
    if (chunk.planned[i] !== ACT.WRITE && this.key !== "width") return this.count;
    return super.bin(chunk, i, first, last);
  }

  value(chunk, i, first, last) {
    if (this.key === "head") return chunk.head[i];
    if (this.key === "off") return offBy(chunk, i);
    return super.value(chunk, i, first, last);
  }
}

// Percent that a row is wider than it is to be; NaN where that isn't known.
export function offBy(chunk, i) {
  return chunk.wanted[i] > 0 ? 100 * (chunk.width[i] / chunk.wanted[i] - 1) : NaN;
}
