// The needle, over the picture: moving it draws nothing of the job again.
const SHAFT_MM = 14;
const NS = "http://www.w3.org/2000/svg";

export class Needle {
  constructor(element) {
    this.svg = document.createElementNS(NS, "svg");
    this.svg.setAttribute("class", "live-needle");
    this.svg.setAttribute("aria-hidden", "true");
    this.halo = this.add("line", "live-halo");
    this.shaft = this.add("line", "live-shaft");
    this.tip = this.add("circle", "live-tip");
    this.tip.setAttribute("r", "4.5");
    this.svg.style.display = "none";
    element.append(this.svg);
  }

  add(tag, name) {
    const found = document.createElementNS(NS, tag);
    found.setAttribute("class", name);
    this.svg.append(found);
    return found;
  }

  moveTo(place) {
    this.place = place;
  }

  // The projection is parallel: as long as nobody turns the view, the needle keeps its shape and is
  // only shifted, for which the browser paints nothing again.
  draw(painter) {
    const hidden = this.place ? "" : "none";
    if (this.svg.style.display !== hidden) this.svg.style.display = hidden;
    if (!this.place) return;
    const [x, y] = painter.project(this.place);
    const [a, b] = painter.project([this.place[0], this.place[1], this.place[2] + SHAFT_MM]);
    this.shape(a - x, b - y);
    const at = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
    if (this.svg.style.transform !== at) this.svg.style.transform = at;
  }

  shape(across, down) {
    const key = `${across.toFixed(1)} ${down.toFixed(1)}`;
    if (key === this.shaped) return;
    this.shaped = key;
    for (const line of [this.halo, this.shaft]) {
      line.setAttribute("x2", across.toFixed(1));
      line.setAttribute("y2", down.toFixed(1));
    }
  }
}
