// A stage's surfaces and network on a plain canvas, where there is no WebGL: turned, zoomed and
// coloured; nothing is cut, marked or picked.
import { Camera, FlatView } from "viewer/flat";
import { byId, hues, make, showScaleBar, startViewKeys } from "viewer/page";
import { Scale, cssOf } from "viewer/scale";
import { flatPlaces, unpackTable } from "viewer/unpack";

const MOST_TRIANGLES = 4000; // of a surface, drawn by their edges
const MOST_POINTS = 4000; // that the picture is fitted to
const DEG = Math.PI / 180;
const NOTE = "Drawn plainly: this browser has no WebGL, or has it switched off. Cutting, opacity and "
  + "marking need it.";

class Drawn extends FlatView {
  constructor(element, { meshes, network }) {
    const points = [];
    for (const { places } of network ? [...meshes, network] : meshes) {
      const stride = 3 * Math.ceil(places.length / 3 / MOST_POINTS);
      for (let i = 0; i < places.length; i += stride) points.push([...places.subarray(i, i + 3)]);
    }
    const half = network ? network.radius.reduce((a, b) => Math.max(a, b), 0) : 0;
    const canvas = make("canvas");
    super(element, canvas, new Camera(points, { half }));
    Object.assign(this, { meshes, network });
    element.append(canvas);
    this.listen({ turns: "drag" });
  }

  orbit(across, up) {
    this.fitted = false;
    this.camera.look(this.camera.azimuth + across / DEG, this.camera.elevation + up / DEG);
    this.draw();
  }

  see([x, y, z]) { this.turn(Math.atan2(x, -y) / DEG, Math.atan2(z, Math.hypot(x, y)) / DEG); }

  paint() {
    this.clear();
    this.context.lineCap = this.context.lineJoin = "round";
    for (const mesh of this.meshes) this.paintEdges(mesh);
    if (this.network) this.paintVessels(this.network);
    this.changed();
  }

  at(places, i) { return this.project(places.subarray(3 * i, 3 * i + 3)); }

  paintEdges({ places, corners }) {
    const { context } = this;
    const stride = 3 * Math.ceil(corners.length / 3 / MOST_TRIANGLES);
    context.beginPath();
    for (let i = 0; i < corners.length; i += stride) {
      const [a, b, c] = [0, 1, 2].map((k) => this.at(places, corners[i + k]));
      context.moveTo(...a);
      for (const to of [b, c, a]) context.lineTo(...to);
    }
    [context.strokeStyle, context.lineWidth, context.globalAlpha] = [hues(["muted"]).muted, 1, 0.3];
    context.stroke();
    context.globalAlpha = 1;
  }

  // The farthest first, each with an edge that sets it off from what lies behind it.
  paintVessels({ places, radius, pieces, colouring: { values, at, scale } }) {
    const depth = pieces.map(({ from }) => this.camera.depth(...places.subarray(3 * from, 3 * from + 3)));
    const order = pieces.map((_, i) => i).sort((a, b) => depth[a] - depth[b]);
    for (const { from, vessel } of order.map((i) => pieces[i])) {
      const width = Math.max((radius[from] + radius[from + 1]) * this.camera.scale, 1);
      const rgb = scale.rgb(values[at === "point" ? from : vessel]);
      this.context.beginPath();
      this.context.moveTo(...this.at(places, from));
      this.context.lineTo(...this.at(places, from + 1));
      for (const [share, shade] of [[1, 0.7], [0.8, 1]]) {
        this.context.lineWidth = share * width;
        this.context.strokeStyle = cssOf(rgb.map((part) => shade * part));
        this.context.stroke();
      }
    }
  }
}

async function networkOf(data, colours) {
  const table = await unpackTable(data.points);
  const { number, end } = await unpackTable(data.vessels);
  const pieces = [];
  for (let v = 0; v < number.length; v++) {
    for (let from = v ? end[v - 1] : 0; from + 1 < end[v]; from++) pieces.push({ from, vessel: v });
  }
  const colourings = await Promise.all(data.colourings.map(async (one) =>
    ({ key: one.key, at: one.at, values: (await unpackTable(one.values)).value, scale: new Scale(one, colours) })));
  return { places: flatPlaces(table), radius: table.radius, pieces, colourings };
}

async function meshOf(data) {
  const corners = new Uint32Array((await unpackTable(data.corners)).vertex.buffer);
  return { places: flatPlaces(await unpackTable(data.points)), corners };
}

// Draws `data` of page_frame.scene into the viewer of view.html, seen from `directions`.
export async function drawPlainly(element, data, directions) {
  const meshes = await Promise.all(data.surfaces.map(meshOf));
  const network = data.network && (await networkOf(data.network, data.colours));
  const select = byId("colouring");
  for (const id of ["layers", "opacity", "clip"]) byId(id).closest("fieldset").hidden = true;
  select.closest("fieldset").hidden = !network;
  network?.colourings.forEach(({ key, scale }, i) =>
    select.add(new Option(scale.title, String(i), key === data.network.first, key === data.network.first)));
  if (network) network.colouring = network.colourings[Number(select.value)];
  byId("panel").hidden = false;
  element.dataset.state = "ready"; // laid out beside the panel from now on
  const view = new Drawn(byId("stage"), { meshes, network });
  view.hold(false);
  const recolour = () => {
    if (network) network.colouring = network.colourings[Number(select.value)];
    byId("legends").replaceChildren(...(network ? [network.colouring.scale.legend()] : []));
    view.draw();
  };
  select.addEventListener("change", recolour);
  recolour();
  byId("directions").append(...Object.entries(directions).map(([name, way]) => {
    const button = make("button", { type: "button" }, name);
    button.addEventListener("click", () => view.see(way));
    return button;
  }));
  byId("panel").append(make("p", { className: "small" }, NOTE));
  startViewKeys(byId("stage"), view, { 0: () => view.see(directions.Oblique), Escape: () => view.element.blur() });
  byId("scalebar").hidden = false;
  view.onDraw(() => showScaleBar(byId("scalebar"), view.pixelsPerMm()));
  view.see(directions.Oblique);
  window.addEventListener("beforeprint", () =>
    Object.assign(byId("print-picture"), { src: view.canvas.toDataURL(), hidden: false }));
  return { stage: view, surfaces: [], network: null };
}
