// Vessels in their tissue, drawn by hand on a canvas: thousands of strokes take a few milliseconds on
// any machine, and no WebGL is needed. Dragging turns the picture, the wheel zooms, arrow keys turn it.
import { html, useEffect, useLayoutEffect, useRef } from "./ui.js";

const COLOURS = ["--vessel-artery", "--vessel-vein", "--vessel-lymph", "--vessel-link", "--vessel-artery"];
const STEP = Math.PI / 24;

export function SketchView({ sketch, outline, label }) {
  const canvas = useRef(null);
  const view = useRef({ turn: -0.6, tilt: 0.5, zoom: 1 });
  const shown = useRef({});
  shown.current = { sketch, outline };

  const draw = () => {
    if (canvas.current) paint(canvas.current, view.current, shown.current.sketch, shown.current.outline);
  };
  const frame = useRef(0);
  const soon = () => {
    cancelAnimationFrame(frame.current);
    frame.current = requestAnimationFrame(draw);
  };
  useLayoutEffect(draw, [sketch, outline]); // at once: a frame later is seen while one drags
  useEffect(() => {
    const box = canvas.current;
    const sized = new ResizeObserver(soon);
    sized.observe(box);
    const themed = new MutationObserver(soon);
    themed.observe(document.documentElement, { attributeFilter: ["data-theme"] });
    const wheel = (event) => {
      if (document.activeElement !== box && !event.ctrlKey) return; // the page scrolls as usual
      event.preventDefault();
      view.current.zoom = Math.min(Math.max(view.current.zoom * Math.exp(-event.deltaY / 500), 0.3), 12);
      soon();
    };
    box.addEventListener("wheel", wheel, { passive: false });
    return () => { sized.disconnect(); themed.disconnect(); box.removeEventListener("wheel", wheel); };
  }, []);

  const drag = (event) => {
    if (!event.buttons) return;
    view.current.turn += event.movementX / 150;
    view.current.tilt = Math.min(Math.max(view.current.tilt + event.movementY / 150, -1.57), 1.57);
    soon();
  };
  const press = (event) => {
    const at = view.current;
    const moves = {
      ArrowLeft: () => { at.turn -= STEP; }, ArrowRight: () => { at.turn += STEP; },
      ArrowUp: () => { at.tilt = Math.min(at.tilt + STEP, 1.57); },
      ArrowDown: () => { at.tilt = Math.max(at.tilt - STEP, -1.57); },
      "+": () => { at.zoom *= 1.2; }, "-": () => { at.zoom /= 1.2; },
    };
    if (!(event.key in moves)) return;
    event.preventDefault();
    moves[event.key]();
    soon();
  };
  return html`<canvas ref=${canvas} class="sketch" tabindex="0" role="img" aria-label=${label}
    onPointerDown=${(event) => event.currentTarget.setPointerCapture(event.pointerId)}
    onPointerMove=${drag} onKeyDown=${press}></canvas>`;
}

// The camera looks along -z after turning about z and tilting about x; all lengths in mm.
function camera(box, view, bounds) {
  const [ct, st, cx, sx] = [Math.cos(view.turn), Math.sin(view.turn), Math.sin(view.tilt), Math.cos(view.tilt)];
  const middle = bounds.low.map((low, k) => (low + bounds.high[k]) / 2);
  const reach = Math.hypot(...bounds.low.map((low, k) => bounds.high[k] - low)) || 1;
  const scale = (0.95 * view.zoom * Math.min(box.width, box.height * 1.35)) / reach;
  const project = (x, y, z) => {
    const [a, b, c] = [x - middle[0], y - middle[1], z - middle[2]];
    const [across, away] = [ct * a - st * b, st * a + ct * b];
    return [box.width / 2 + scale * across, box.height / 2 - scale * (cx * away + sx * c), sx * away - cx * c];
  };
  return { project, scale };
}

function boundsOf(flat, stride, columns) {
  const bounds = { low: [Infinity, Infinity, Infinity], high: [-Infinity, -Infinity, -Infinity] };
  for (let i = 0; i < flat.length; i += stride) {
    for (const column of columns) {
      for (let k = 0; k < 3; k += 1) {
        bounds.low[k] = Math.min(bounds.low[k], flat[i + column + k]);
        bounds.high[k] = Math.max(bounds.high[k], flat[i + column + k]);
      }
    }
  }
  return bounds;
}

function paint(canvas, view, sketch, outline) {
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const pen = canvas.getContext("2d");
  pen.clearRect(0, 0, width, height);
  if (!sketch) return;
  const style = getComputedStyle(canvas);
  const bounds = outline ? boundsOf(outline.vertices, 3, [0]) : boundsOf(sketch.pieces, 8, [0, 3]);
  const { project, scale } = camera(canvas, view, bounds);
  if (outline) paintOutline(pen, outline, project, style.getPropertyValue("--tissue"), ratio);
  paintVessels(pen, sketch, project, scale, style, ratio);
}

function paintOutline(pen, { vertices, faces }, project, colour, ratio) {
  const points = [];
  for (let i = 0; i < vertices.length; i += 3) points.push(project(vertices[i], vertices[i + 1], vertices[i + 2]));
  pen.fillStyle = pen.strokeStyle = colour;
  pen.lineWidth = ratio / 2;
  for (let i = 0; i < faces.length; i += 3) {
    const [a, b, c] = [points[faces[i]], points[faces[i + 1]], points[faces[i + 2]]];
    // Only what faces away: one layer of colour behind the vessels, none before them.
    if ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) < 0) continue;
    pen.beginPath();
    pen.moveTo(a[0], a[1]);
    pen.lineTo(b[0], b[1]);
    pen.lineTo(c[0], c[1]);
    pen.fill();
  }
}

const LONGEST_STROKE = 12; // pieces; a longer one would lie at one depth from end to end

// Pieces that continue each other, drawn in one stroke: { kind, points, radius }.
function strokesOf({ pieces, kinds }, project) {
  const strokes = [];
  let open = null;
  kinds.forEach((kind, i) => {
    const [x0, y0, z0, x1, y1, z1, r0, r1] = pieces.slice(8 * i, 8 * i + 8);
    const joined = open && open.kind === kind && open.end === `${x0},${y0},${z0}` && open.points.length < LONGEST_STROKE;
    if (!joined) strokes.push(open = { kind, points: [project(x0, y0, z0)], depth: 0, radius: 0 });
    const point = project(x1, y1, z1);
    open.points.push(point);
    open.end = `${x1},${y1},${z1}`;
    open.depth = open.depth + (point[2] - open.depth) / (open.points.length - 1);
    open.radius = Math.max(open.radius, (r0 + r1) / 2);
  });
  return strokes;
}

function paintVessels(pen, sketch, project, scale, style, ratio) {
  const colours = COLOURS.map((name) => style.getPropertyValue(name).trim());
  const ground = style.getPropertyValue("--raised").trim();
  const strokes = strokesOf(sketch, project).sort((one, other) => other.depth - one.depth);
  pen.lineCap = pen.lineJoin = "round";
  for (const { kind, points, radius } of strokes) { // a rim of the ground's colour tells near from far
    for (const [ink, rim] of [[ground, 1.4 * ratio], [colours[kind], 0]]) {
      pen.beginPath();
      pen.strokeStyle = ink;
      pen.lineWidth = Math.max(2 * scale * radius, ratio) + rim;
      points.forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
      pen.stroke();
    }
  }
}
