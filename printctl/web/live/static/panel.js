// Buttons, choices, the slider over layers, the keys, and the line of words below the picture.
import { choices } from "./palette.js";

const VIEWS = [["Fit", "Oblique"], ["Top", "Top"], ["Front", "Front"], ["Side", "Side"]];
const TURN = 0.12; // rad a key
const STEP = 40; // pixels a key

export function element(tag, name, text = "") {
  const found = document.createElement(tag);
  if (name) found.className = name;
  if (text) found.textContent = text;
  return found;
}

function button(text, label, action) {
  const found = element("button", "live-button", text);
  found.type = "button";
  found.setAttribute("aria-label", label);
  found.title = label;
  found.addEventListener("click", action);
  return found;
}

function tick(text, on, action) {
  const label = element("label", "live-tick");
  const box = element("input");
  box.type = "checkbox";
  box.checked = on;
  box.addEventListener("change", () => action(box.checked));
  label.append(box, text);
  return label;
}

export class Panel {
  constructor(view, flat) {
    this.view = view;
    const { about } = view.scene;
    this.bar = element("div", "live-bar");
    this.bar.setAttribute("role", "group");
    this.bar.setAttribute("aria-label", "View");
    for (const [text, look] of flat ? VIEWS.slice(0, 1) : VIEWS) {
      this.bar.append(button(text, look === "Oblique" ? "Fit the job" : `From the ${text.toLowerCase()}`,
        () => view.painter.look(look)));
    }
    this.bar.append(button("+", "Nearer", () => view.painter.zoom(1.3)));
    this.bar.append(button("\u2212", "Farther", () => view.painter.zoom(1 / 1.3)));
    this.addColours(choices(about));
    const { state } = view;
    this.rest = tick("still to come", state.rest, (on) => view.choose({ rest: on }));
    this.bar.append(this.rest, tick("travels", state.travels, (on) => view.choose({ travels: on })));
    this.foot = element("div", "live-foot");
    this.words = element("p", "live-words");
    this.addSlider(about);
    this.foot.append(this.words);
  }

  addColours(known) {
    if (known.length < 2) return;
    const label = element("label", "live-tick", "colour by ");
    const select = element("select");
    for (const [key, name] of known) {
      const option = element("option", "", name);
      option.value = key;
      select.append(option);
    }
    select.addEventListener("change", () => this.view.choose({ by: select.value }));
    label.append(select);
    this.bar.append(label);
  }

  addSlider({ layers, passes }) {
    if (layers.length < 2) return;
    const noun = passes ? "pass" : "layer";
    const row = element("div", "live-layers");
    row.setAttribute("role", "group");
    row.setAttribute("aria-label", passes ? "Passes shown" : "Layers shown");
    this.ends = ["First", "Last"].map((which, k) => {
      const range = element("input");
      Object.assign(range, { type: "range", min: 1, max: layers.length, step: 1 });
      range.value = k ? layers.length : 1;
      range.setAttribute("aria-label", `${which} ${noun} shown`);
      range.addEventListener("input", () => this.slide(k));
      return range;
    });
    this.range = element("span", "live-range");
    row.append(this.ends[0], this.ends[1], this.range);
    this.foot.append(row);
    this.nameRange();
  }

  slide(moved) {
    const [first, last] = this.ends.map((end) => Number(end.value));
    if (first > last) this.ends[1 - moved].value = this.ends[moved].value;
    this.view.choose({ layers: this.ends.map((end) => Number(end.value) - 1) });
    this.nameRange();
  }

  nameRange() {
    const [first, last] = this.ends.map((end) => Number(end.value));
    const { layers, passes } = this.view.scene.about;
    const noun = passes ? "passes" : "layers";
    const height = passes ? "" : `, z ${layers[first - 1]} to ${layers[last - 1]} mm`;
    this.range.textContent = `${noun} ${first} to ${last} of ${layers.length}${height}`;
  }

  say(text) {
    if (this.words.textContent !== text) this.words.textContent = text;
  }
}

export function listenToKeys(target, view) {
  const { painter } = view;
  const turn = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const looks = { f: "Oblique", Home: "Oblique", 1: "Top", 2: "Front", 3: "Side" };
  target.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const way = turn[event.key];
    if (way && event.shiftKey) painter.pan(way[0] * STEP, -way[1] * STEP);
    else if (way) painter.orbit(-way[0] * TURN, way[1] * TURN);
    else if (event.key === "+" || event.key === "=") painter.zoom(1.2);
    else if (event.key === "-") painter.zoom(1 / 1.2);
    else if (looks[event.key]) painter.look(looks[event.key]);
    else return;
    event.preventDefault();
    event.stopPropagation();
  });
}
