// Slider, numbers, switches and the warnings' places.
import { short } from "gcode/colours";
import { tellScale } from "gcode/scalebar";
import { soon } from "gcode/soon";
import { fit, startStrokes, zoom } from "gcode/strokes";
import { list } from "gcode/words";
import { offBy } from "play/shades";

const STEP = 0.005;
const ZOOM = 1.25;
const at = (name) => document.getElementById(`play-${name}`);

export function startPanel(view) {
  for (const { key, name } of view.data.colourings) at("colouring").add(new Option(name, key));
  at("colouring").addEventListener("change", () => view.colour(at("colouring").value));
  for (const what of Object.keys(view.shown)) {
    const box = at(`show-${what}`);
    box.checked = view.shown[what];
    box.addEventListener("change", () => { view.shown[what] = box.checked; view.draw(); });
  }
  for (const button of at("turn")?.querySelectorAll("button") ?? []) {
    button.addEventListener("click", () => {
      view.camera.look(...button.dataset.turn.split(",").map(Number));
      fit(view);
    });
  }
  at("time").max = view.duration;
  at("time").addEventListener("input", () => view.to(Number(at("time").value)));
  at("back").addEventListener("click", () => view.step(-1));
  at("on").addEventListener("click", () => view.step(1));
  startWarnings(view);
  view.listeners.push(() => tell(view));
}

// A warning's mark and its row go to the moment; the list lies below, so the view comes back.
function startWarnings(view) {
  for (const button of document.querySelectorAll("button[data-time]")) {
    button.addEventListener("click", () => {
      view.to(Number(button.dataset.time));
      if (button.classList.contains("go")) at("viewer").scrollIntoView({ block: "nearest" });
    });
  }
}

export function startPlaying(view) {
  let before = null;
  const toggle = () => {
    before = before === null ? performance.now() : null;
    at("play").textContent = before === null ? "▶" : "❚❚";
    at("play").setAttribute("aria-label", before === null ? "Play" : "Pause");
    if (before === null) return;
    if (view.whole) view.to(0);
    soon(step);
  };
  const step = () => {
    if (before === null) return;
    const now = performance.now();
    const pace = at("pace").value === "real" ? 1 : view.duration / Number(at("pace").value);
    view.to(view.time + (Math.max(now - before, 0) / 1000) * pace);
    before = now;
    if (view.whole) toggle();
    else soon(step);
  };
  at("play").addEventListener("click", toggle);
  return toggle;
}

export function startKeys(view, toggle) {
  // In a page of its own keys mean the slider wherever they are struck.
  const own = document.body.classList.contains("play-page");
  (own ? document : at("viewer")).addEventListener("keydown", (event) => {
    if (event.target.matches?.("select") || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === " " && event.target.matches?.("button, input[type=checkbox]")) return;
    const way = (sign) => () => (event.shiftKey ? view.stretch(sign)
      : view.to(view.time + sign * STEP * view.duration));
    const act = {
      ArrowRight: way(1), ArrowLeft: way(-1),
      ArrowUp: () => view.step(1), ArrowDown: () => view.step(-1),
      PageUp: () => view.step(1), PageDown: () => view.step(-1),
      Home: () => view.to(0), End: () => view.to(view.duration), " ": toggle,
      0: () => fit(view), "+": () => zoom(view, ZOOM), "=": () => zoom(view, ZOOM),
      "-": () => zoom(view, 1 / ZOOM),
    }[event.key];
    if (!act) return;
    event.preventDefault();
    act();
  });
}

// Wheel and fingers scroll the page until the view is clicked; then they are the view's.
export function startTouch(view) {
  const stage = view.holder;
  stage.addEventListener("focus", () => { stage.style.touchAction = "none"; });
  stage.addEventListener("blur", () => { stage.style.touchAction = ""; });
  startStrokes(view, { taken: () => document.activeElement === stage });
}

function tell(view) {
  const noun = view.passes ? "Pass" : "Layer";
  at("time").value = view.time;
  at("clock").textContent = `${clock(view.time)} of ${clock(view.duration)}`;
  at("tag").textContent = `${noun} ${view.layer + 1} of ${short(view.count)}`;
  at("numbers").replaceChildren(...list(numbers(view, noun)));
  at("legend").replaceChildren(view.colours.legend(new Set(view.data.inks.keys())));
  if (view.colours.key !== "width") {
    const other = document.createElement("p");
    const patch = document.createElement("i");
    other.className = "swatches small";
    patch.style.background = view.data.none;
    const said = document.createElement("span");
    said.append(patch, view.colours.key === "off" ? "nothing to hold it against" : "threads along travels");
    other.append(said);
    at("legend").firstElementChild.append(other);
  }
  tellScale(view.camera.scale, at("scalebar"));
}

function numbers(view, noun) {
  const { chunk, row, data } = view;
  const [width, off] = [chunk.width[row], offBy(chunk, row)];
  const percent = Number.isNaN(off) ? "" : `, ${off > 0 ? "+" : ""}${off.toFixed(1).replace("-", "\u2212")}\u202f%`;
  return [
    ["Time", clock(view.time)],
    [noun, `${view.layer + 1}, z ${view.passes ? "≤ " : ""}${short(data.layer_z[view.layer], 4)} mm`],
    ["Ink laid", `${short(view.laid, 4)} of ${short(chunk.laid[chunk.n - 1], 4)} µL`],
    ["Needle x, y", view.place.slice(0, 2).map((value) => value.toFixed(3)).join(", ")],
    ["Needle z", `${view.place[2].toFixed(3)} mm`],
    ["The needle", view.doing()],
    ["Line", chunk.line[row] ? String(chunk.line[row]) : "–"],
    ["Width", width > 0 ? `${width.toFixed(3)} mm${percent}` : "–"],
    ...(view.passes ? [["Vessel", chunk.vessel[row] < 0 ? "–" : String(chunk.vessel[row])]] : []),
    ...(data.inks.length > 1 ? [["Ink", data.inks[chunk.head[row]]]] : []),
  ];
}

// 1:02:03, or 2:03.4 below an hour.
export function clock(seconds) {
  const tenths = Math.round(10 * seconds);
  const [minutes, rest] = [Math.floor(tenths / 600), tenths % 600];
  const two = (value) => String(value).padStart(2, "0");
  if (minutes >= 60) return `${Math.floor(minutes / 60)}:${two(minutes % 60)}:${two(Math.floor(rest / 10))}`;
  return `${minutes}:${two(Math.floor(rest / 10))}.${rest % 10}`;
}
