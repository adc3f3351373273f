// What an observer had written again, over the picture: lines of their own, however the job is
// coloured. Drawn through where they lie; dashed until they are executed.
const NS = "http://www.w3.org/2000/svg";

export class Mends {
  constructor(element) {
    this.svg = document.createElementNS(NS, "svg");
    this.svg.setAttribute("class", "live-mends");
    this.svg.setAttribute("aria-hidden", "true");
    this.shown = [];
    this.said = "";
    element.append(this.svg);
  }

  // A list of { look, written, strokes: [[[x, y, z], ...], ...] }.
  take(mends) {
    this.svg.replaceChildren();
    this.shown = mends.flatMap(({ written, strokes }) => strokes.map((places) => {
      const halo = this.add("live-mend-halo");
      const line = this.add(written ? "live-mend" : "live-mend live-mend-ahead");
      return { places, lines: [halo, line] };
    }));
    const written = mends.filter((one) => one.written).length;
    const count = written === 1 ? "1 mend" : `${written} mends`;
    this.said = mends.length ? ` ${count} written (violet).` : "";
  }

  add(name) {
    const found = document.createElementNS(NS, "polyline");
    found.setAttribute("class", name);
    this.svg.append(found);
    return found;
  }

  draw(painter) {
    for (const { places, lines } of this.shown) {
      const at = places.map((place) => painter.project(place)
        .map((px) => px.toFixed(1)).join(",")).join(" ");
      for (const line of lines) {
        if (line.getAttribute("points") !== at) line.setAttribute("points", at);
      }
    }
  }
}
