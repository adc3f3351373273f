// Vessels in their tissue, on a plain canvas: thousands of strokes take a few milliseconds on any machine, and no
// WebGL is needed.
import { Camera, FlatView, corners } from "/live/static/flat.js";
import { hues, startViewKeys } from "/live/static/page.js";
import { html, useEffect, useLayoutEffect, useRef } from "./ui.js";

const KINDS = ["vessel-artery", "vessel-vein", "vessel-lymph", "vessel-link", "vessel-artery"];
const [AZIMUTH, ELEVATION] = [35, 30]; // degrees, to begin with
const LONGEST_STROKE = 12; // pieces; a longer one would lie at one depth from end to end

export function SketchView({ sketch, outline, label }) {
  const box = useRef(null);
  const view = useRef(null);
  useLayoutEffect(() => {
    view.current ??= new Sketch(box.current);
    view.current.take(sketch, outline); // at once: a frame later is seen while one drags
  }, [sketch, outline]);
  useEffect(() => () => view.current.dispose(), []);
  return html`<div ref=${box} class="sketch" tabindex="0" role="img" aria-label=${label}><canvas></canvas></div>`;
}

class Sketch extends FlatView {
  constructor(element) {
    super(element, element.firstElementChild, new Camera([[0, 0, 0], [1, 1, 1]], { margin: 0.95 }));
    this.camera.look(AZIMUTH, ELEVATION);
    this.hold(false);
    this.listen({ turns: "drag" });
    startViewKeys(element, this);
  }

  orbit(across, up) {
    const degrees = 180 / Math.PI;
    this.camera.look(this.camera.azimuth + across * degrees, this.camera.elevation - up * degrees);
    this.draw();
  }

  take(sketch, outline) {
    Object.assign(this, { sketch, outline });
    if (!sketch) return this.draw();
    const all = outline ? boundsOf(outline.vertices, 3, [0]) : boundsOf(sketch.pieces, 8, [0, 3]);
    this.camera.points = corners(...all);
    return this.resize();
  }

  paint() {
    this.clear();
    if (!this.sketch) return;
    this.hues = hues([...KINDS, "raised", "tissue"], this.canvas);
    if (this.outline) this.paintOutline();
    this.paintVessels();
  }

  // Only what faces away: one layer of colour behind the vessels, none before them.
  paintOutline() {
    const { context: pen, outline: { vertices, faces } } = this;
    const points = [];
    for (let i = 0; i < vertices.length; i += 3) points.push(this.project(vertices.slice(i, i + 3)));
    Object.assign(pen, { fillStyle: this.hues.tissue, strokeStyle: this.hues.tissue });
    for (let i = 0; i < faces.length; i += 3) {
      const [a, b, c] = [points[faces[i]], points[faces[i + 1]], points[faces[i + 2]]];
      if ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) < 0) continue;
      pen.beginPath();
      for (const point of [a, b, c]) pen.lineTo(...point);
      pen.fill();
    }
  }

  // Each in its colour, with a rim of the ground's colour that tells near from far.
  paintVessels() {
    const { context: pen, camera } = this;
    const strokes = strokesOf(this.sketch, camera).sort((one, other) => one.depth - other.depth);
    pen.lineCap = pen.lineJoin = "round";
    for (const { kind, points, radius } of strokes) {
      for (const [ink, rim] of [[this.hues.raised, 1.4], [this.hues[KINDS[kind]], 0]]) {
        pen.beginPath();
        pen.strokeStyle = ink;
        pen.lineWidth = Math.max(2 * camera.scale * radius, 1) + rim;
        for (const point of points) pen.lineTo(...point);
        pen.stroke();
      }
    }
  }
}

// Lowest and highest corner of places that begin at some columns of each row.
function boundsOf(flat, stride, columns) {
  const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  for (let i = 0; i < flat.length; i += stride) {
    for (const column of columns) {
      for (let k = 0; k < 3; k += 1) {
        low[k] = Math.min(low[k], flat[i + column + k]);
        high[k] = Math.max(high[k], flat[i + column + k]);
      }
    }
  }
  return [low, high];
}

// Pieces that continue each other, drawn in one stroke: { kind, points, depth, radius }.
function strokesOf({ pieces, kinds }, camera) {
  const strokes = [];
  let open = null;
  const seen = (x, y, z) => [camera.u(x, y), camera.v(x, y, z)];
  kinds.forEach((kind, i) => {
    const [x0, y0, z0, x1, y1, z1, r0, r1] = pieces.slice(8 * i, 8 * i + 8);
    const joined = open && open.kind === kind && open.end === `${x0},${y0},${z0}` && open.points.length < LONGEST_STROKE;
    if (!joined) strokes.push(open = { kind, points: [seen(x0, y0, z0)], depth: 0, radius: 0 });
    open.points.push(seen(x1, y1, z1));
    open.end = `${x1},${y1},${z1}`;
    open.depth += (camera.depth(x1, y1, z1) - open.depth) / (open.points.length - 1);
    open.radius = Math.max(open.radius, (r0 + r1) / 2);
  });
  return strokes;
}
