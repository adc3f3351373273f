// Colours of a predicted line: beside those of the G-code's page what it is off by, and its ink.
import { Colours } from "gcode/colours";
import { ACT } from "gcode/moves";

export class Shades extends Colours {
  constructor(colouring, scales, none) {
    super(colouring, colouring.diverging ? scales.diverging : scales.sequential, none);
  }

  value(chunk, i, first, last) {
    if (this.key === "head") return chunk.head[i];
    // A thread along a travel is off whatever it is.
    if (this.key === "off") return chunk.planned[i] === ACT.WRITE ? offBy(chunk, i) : NaN;
    return super.value(chunk, i, first, last);
  }
}

// Percent that a row is wider than it is to be; NaN where that isn't known.
export function offBy(chunk, i) {
  return chunk.wanted[i] > 0 ? 100 * (chunk.width[i] / chunk.wanted[i] - 1) : NaN;
}
