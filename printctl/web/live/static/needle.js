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

  draw(painter) {
    this.svg.style.display = this.place ? "" : "none";
    if (!this.place) return;
    const [x, y] = painter.project(this.place);
    const [a, b] = painter.project([this.place[0], this.place[1], this.place[2] + SHAFT_MM]);
    const key = [x, y, a, b].map((value) => value.toFixed(1)).join(" ");
    if (key === this.drawn) return;
    this.drawn = key;
    // Only as large as it is, so that only so much of the page is painted again.
    const [left, up] = [Math.min(x, a) - 8, Math.min(y, b) - 8];
    this.svg.style.transform = `translate(${left.toFixed(1)}px, ${up.toFixed(1)}px)`;
    this.svg.style.width = `${Math.abs(a - x) + 16}px`;
    this.svg.style.height = `${Math.abs(b - y) + 16}px`;
    for (const line of [this.halo, this.shaft]) {
      line.setAttribute("x1", x - left);
      line.setAttribute("y1", y - up);
      line.setAttribute("x2", a - left);
      line.setAttribute("y2", b - up);
    }
    this.tip.setAttribute("cx", x - left);
    this.tip.setAttribute("cy", y - up);
  }
}
