// Sliders, switches, numbers and the legend beside the stage.
import { short } from "gcode/colours";
import { soon } from "gcode/soon";
import { tellScale } from "gcode/scalebar";
import { fit } from "gcode/strokes";
import { beyondNumbers, layerNumbers, list, moveNumbers } from "gcode/words";

const PLAY_FRAMES = 600;
const at = (id) => document.getElementById(id);

export function startPanel(view) {
  const { data } = view;
  const noun = data.passes ? "pass" : "layer";
  for (const id of ["panel", "moves", "scalebar"]) at(id).hidden = false;
  for (const id of ["layer", "layer-tag"]) at(id).hidden = view.count < 2;
  at("turn").hidden = !data.passes;
  for (const what of ["outline", "seams"]) {
    at(`show-${what}`).parentElement.hidden = what === "outline" ? !view.outlines : data.passes;
  }
  at("below-name").textContent = data.passes ? "Passes before it" : "The layer below, faint";
  at("of").textContent = `of ${short(view.count)}`;
  [at("layer").max, at("number").max] = [view.count, view.count];
  for (const { key, name } of data.colourings) at("colouring").add(new Option(name, key));
  at("colouring").value = view.colours.key;
  at("colouring").addEventListener("change", () => view.colour(at("colouring").value));
  for (const id of ["layer", "number"]) {
    at(id).addEventListener("input", () => at(id).value && view.show(at(id).value - 1));
  }
  at("up").addEventListener("click", () => view.show(view.layer + 1));
  at("down").addEventListener("click", () => view.show(view.layer - 1));
  at("move").addEventListener("input", () => view.to(Number(at("move").value)));
  for (const what of Object.keys(view.shown)) {
    const box = at(`show-${what}`);
    box.checked = view.shown[what];
    box.addEventListener("change", () => { view.shown[what] = box.checked; view.draw(); });
  }
  for (const button of at("turn").querySelectorAll("button")) {
    button.addEventListener("click", () => {
      view.camera.look(...button.dataset.turn.split(",").map(Number));
      fit(view);
    });
  }
  startPlaying(view);
  view.listeners.push(() => tell(view, noun));
}

function startPlaying(view) {
  let playing = false;
  const step = () => {
    if (!playing) return;
    view.to(view.move + Math.max(1, Math.round(view.rows / PLAY_FRAMES)));
    if (view.whole) toggle();
    else soon(step);
  };
  const toggle = () => {
    playing = !playing;
    at("play").textContent = playing ? "❚❚" : "▶";
    if (!playing) return;
    if (view.whole) view.to(1);
    soon(step);
  };
  at("play").addEventListener("click", toggle);
}

function tell(view, noun) {
  if (!view.part) return;
  const k = view.layer;
  if (document.activeElement !== at("number")) at("number").value = k + 1;
  at("layer").value = k + 1;
  at("layer-tag").textContent = `${noun} ${k + 1}`;
  [at("move").max, at("move").value] = [view.rows, view.move];
  at("move-tag").textContent = `${short(view.move)} of ${short(view.rows)} moves`;
  at("numbers").replaceChildren(
    ...list([...layerNumbers(view.layers, k, view.passes), ...beyondNumbers(view.data.outline, k)]));
  at("legend").replaceChildren(
    ...(view.outlines && view.shown.outline ? [view.outlines.legend()] : []),
    view.colours.legend(kindsThere(view)));
  tellScale(view.camera.scale, at("scalebar"));
  tellMove(view);
}

function kindsThere({ part }) {
  const found = new Set();
  for (let i = part.first; i < part.last; i++) found.add(part.chunk.kind[i]);
  return found;
}

// The move under the pointer, else the needle's while it is on its way.
function tellMove(view) {
  const { part, move, data } = view;
  const here = view.hovered
    ?? (!view.whole && move > 1 ? { chunk: part.chunk, i: part.first + move - 1 } : null);
  at("probe").hidden = !here;
  if (!here) { at("line").replaceChildren(); return; }
  const said = moveNumbers(here.chunk, here.i, data.kinds, data.vessels);
  const [code, title, facts] = ["code", "h3", "dl"].map((tag) => document.createElement(tag));
  code.textContent = said.text ?? "";
  at("probe").replaceChildren(`${said.line}\u2003`, code);
  title.textContent = `${said.title}, line ${said.line}`;
  facts.append(...list(said.facts));
  at("line").replaceChildren(title, facts);
}
