// What every page has besides its drawing: elements, numbers in words, theme, tables, keys, playing.
const SVG = "http://www.w3.org/2000/svg";
const NEXT_THEME = { system: "light", light: "dark", dark: "system" };
const LATEST_FRAME_MS = 100;
// Of the picture in which all is seen.
export const ZOOM = { least: 0.2, most: 500 };
const KEY = { turn: Math.PI / 24, panPx: 40, zoom: 1.2 };

export const byId = (id) => document.getElementById(id);

// An element with properties or attributes, and what it holds; "svg:line" is one of SVG.
export function make(tag, given = {}, ...inside) {
  const [space, name] = tag.startsWith("svg:") ? [SVG, tag.slice(4)] : [null, tag];
  const element = space ? document.createElementNS(space, name) : document.createElement(name);
  for (const [key, value] of Object.entries(given)) {
    if (!space && key in element) element[key] = value;
    else element.setAttribute(key, value);
  }
  element.append(...inside);
  return element;
}

// Names and texts as the children of a description list.
export function facts(pairs) {
  return pairs.flatMap(([name, text]) => [make("dt", {}, name), make("dd", {}, text)]);
}

// A number in few digits; `signed` writes the plus, too.
export function short(value, digits = 3, signed = false) {
  if (value === null || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  const rounded = Number(size.toPrecision(digits));
  let text = String(rounded);
  if (Number.isInteger(size)) text = size.toLocaleString("en").replaceAll(",", "\u202f");
  else if (rounded < 1e-3) {
    text = rounded.toExponential().replace(/e-(\d+)/,
      (_, power) => `·10⁻${[...power].map((digit) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[digit]).join("")}`);
  }
  return `${value < 0 ? "−" : signed && value > 0 ? "+" : ""}${text}`;
}

export function fixed(value, digits) {
  return typeof value === "number" ? value.toFixed(digits).replace("-", "−") : "–";
}

// 1:02:03, or 2:03.4 below an hour.
export function clock(seconds) {
  const tenths = Math.round(10 * seconds);
  const [minutes, rest] = [Math.floor(tenths / 600), tenths % 600];
  const two = (value) => String(value).padStart(2, "0");
  const whole = two(Math.floor(rest / 10));
  return minutes < 60 ? `${minutes}:${whole}.${rest % 10}`
    : `${Math.floor(minutes / 60)}:${two(minutes % 60)}:${whole}`;
}

// The largest of 1, 2 or 5 times a power of ten that isn't above a number.
export function roundDown(most) {
  const ten = 10 ** Math.floor(Math.log10(most));
  return ([5, 2, 1].find((factor) => factor * ten <= most * (1 + 1e-9)) ?? 1) * ten;
}

// The first of low to high - 1 that is `past`, else high.
export function bisect(low, high, past) {
  let [from, to] = [low, high];
  while (from < to) {
    const middle = (from + to) >> 1;
    if (past(middle)) to = middle;
    else from = middle + 1;
  }
  return from;
}

// Draws a round length that fits into <div><i></i><span></span></div>.
export function showScaleBar(element, pixelsPerMm, roomPx = 120) {
  const length = roundDown(roomPx / pixelsPerMm);
  element.firstElementChild.style.width = `${length * pixelsPerMm}px`;
  element.lastElementChild.textContent =
    length < 1 ? `${short(1000 * length)} µm` : `${short(length)} mm`;
}

// The vessel that is pointed at and the one that is chosen; every part of a page sets and hears them.
export const marked = Object.assign(new EventTarget(), {
  hovered: null,
  selected: null,
  set(name, vessel) {
    if (this[name] === vessel) return;
    this[name] = vessel;
    this.dispatchEvent(new Event(name));
  },
  on(name, action) { this.addEventListener(name, () => action(this[name])); },
});

// Starts a page: theme and tables, then what else there is.
export async function startPage(work = null) {
  startTheme();
  for (const button of document.querySelectorAll("th button[data-sort]")) {
    button.addEventListener("click", () => sortBy(button));
  }
  await work?.();
  document.documentElement.dataset.state = "ready";
}

// Starts a viewer by `work`; its state says whether that went well. Without it the rest still works.
export async function startView(viewer, work) {
  const message = viewer.querySelector(".message");
  const needs = message?.textContent;
  if (message) message.textContent = "The view is being drawn; a page printed now is without it.";
  try {
    await work();
    viewer.dataset.state = "ready";
  } catch (problem) {
    viewer.dataset.state = "failed";
    if (message) message.textContent = needs;
    console.warn(`View: ${problem.message}`);
  }
}

// Light, dark, or the system's. In the operator's page Esc twice stops the print, so a frame hands it on.
function startTheme() {
  const button = byId("theme");
  let theme = "system";
  button.hidden = false;
  button.addEventListener("click", () => {
    theme = NEXT_THEME[theme];
    if (theme === "system") delete document.documentElement.dataset.theme;
    else document.documentElement.dataset.theme = theme;
    button.textContent = `Theme: ${theme}`;
  });
  if (window.parent === window) return;
  window.addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || event.repeat) return;
    window.parent.postMessage({ printctl: "escape" }, "*");
  }, true);
}

// Sorts a table by a heading; missing values stay at the end either way.
function sortBy(button) {
  const heading = button.closest("th");
  const sign = heading.getAttribute("aria-sort") === "ascending" ? -1 : 1;
  for (const other of heading.parentElement.children) other.removeAttribute("aria-sort");
  heading.setAttribute("aria-sort", sign < 0 ? "descending" : "ascending");
  const order = (row) => row.cells[heading.cellIndex].dataset.order;
  const body = heading.closest("table").tBodies[0];
  body.append(...[...body.rows].sort((a, b) => {
    const [x, y] = [order(a), order(b)];
    if (x === "" || y === "") return (x === "") - (y === "");
    if (button.dataset.sort === "number") return sign * (Number(x) - Number(y));
    return sign * x.localeCompare(y, "en", { numeric: true });
  }));
}

// Colours that the style sheet names, as texts.
export function hues(names, element = document.documentElement, prefix = "--") {
  const style = getComputedStyle(element);
  return Object.fromEntries(
    names.map((name) => [name, style.getPropertyValue(prefix + name).trim()]));
}

// Acts when the theme changes; returns what ends that.
export function onTheme(action) {
  const system = matchMedia("(prefers-color-scheme: dark)");
  system.addEventListener("change", action);
  const observer = new MutationObserver(action);
  for (const one of [document.documentElement, document.body]) {
    observer.observe(one, { attributeFilter: ["data-theme", "class"] });
  }
  return () => {
    system.removeEventListener("change", action);
    observer.disconnect();
  };
}

// Keys by name, each with what it does; fields that match `typing` keep theirs.
export function onKeys(target, acts, typing = "select") {
  target.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches?.(typing)) return;
    if (event.key === " " && event.target.matches?.("button, input[type=checkbox]")) return;
    if (!acts[event.key]) return;
    event.preventDefault();
    event.stopPropagation();
    acts[event.key](event);
  });
}

// Until it is clicked, a view leaves wheel and one-finger strokes to the page.
export function holdWhileFocused(element, hold) {
  element.addEventListener("pointerdown", () => element.focus({ preventScroll: true }));
  element.addEventListener("focus", () => hold(true));
  element.addEventListener("blur", () => hold(false));
}

export const zoomKeys = (view) => ({
  "+": () => view.zoom(KEY.zoom), "=": () => view.zoom(KEY.zoom), "-": () => view.zoom(1 / KEY.zoom),
});

// The keys of a view that is turned: arrows, with Shift, plus, minus, and more.
export function startViewKeys(element, view, more = {}) {
  holdWhileFocused(element, (held) => view.hold(held));
  const way = (across, up) => (event) => (event.shiftKey ? view.pan(across * KEY.panPx, up * KEY.panPx)
    : view.orbit(across * KEY.turn, -up * KEY.turn));
  onKeys(element, {
    ArrowLeft: way(-1, 0), ArrowRight: way(1, 0), ArrowUp: way(0, 1), ArrowDown: way(0, -1),
    ...zoomKeys(view), ...more,
  });
}

// Acts with the next frame; without frames (a tab in the background, a print) soon all the same.
export function soon(action) {
  let done = false;
  const once = () => {
    if (!done) action();
    done = true;
  };
  requestAnimationFrame(once);
  setTimeout(once, LATEST_FRAME_MS);
}

// A button that plays a view until it is `whole`: `advance` gets the seconds since the frame before.
// Returns what the button does.
export function startPlaying(button, view, advance) {
  let before = null;
  const step = () => {
    if (before === null) return;
    const now = performance.now();
    advance(Math.max(now - before, 0) / 1000);
    before = now;
    if (view.whole) toggle();
    else soon(step);
  };
  const toggle = () => {
    before = before === null ? performance.now() : null;
    button.textContent = before === null ? "▶" : "❚❚";
    button.setAttribute("aria-label", before === null ? "Play" : "Pause");
    if (before === null) return;
    if (view.whole) view.restart();
    soon(step);
  };
  button.addEventListener("click", toggle);
  return toggle;
}
