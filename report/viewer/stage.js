// A 3D view: camera, light, cut, scale bar, axes; drawn when something changes. The projection is
// orthographic, so the scale bar holds everywhere in the picture.
import * as THREE from "three";
import { OrbitControls } from "three/orbit";
import { ZOOM, make, showScaleBar } from "viewer/page";

export const DIRECTIONS = {
  Oblique: [-0.55, -1, 0.85], Top: [0, -1e-4, 1], Front: [0, -1, 0], Side: [1, 0, 0],
  Back: [0, 1, 0], Below: [0, -1e-4, -1],
};
const AXES = { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1] };
const LINK_DIGITS = 1e5;

export class Stage {
  constructor(element, drawing = {}) {
    this.element = element;
    this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true, ...drawing });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.canvas = this.renderer.domElement;
    this.lost = make("p", { className: "view-lost", role: "status", hidden: true },
      "The browser took the graphics card away from this view. It is drawn again when it has it back; "
      + "if it stays so, load the page again.");
    element.append(this.canvas, this.lost);
    this.canvas.addEventListener("webglcontextlost", () => { this.lost.hidden = false; });
    this.canvas.addEventListener("webglcontextrestored", () => {
      this.lost.hidden = true;
      this.renderer.setClearAlpha(0); // three.js starts again with opaque black
      this.draw();
    });
    this.scene = new THREE.Scene();
    this.camera = new THREE.OrthographicCamera();
    this.camera.up.set(0, 0, 1);
    this.addLights();
    this.controls = new OrbitControls(this.camera, this.canvas);
    [this.controls.minZoom, this.controls.maxZoom] = [ZOOM.least, ZOOM.most];
    this.controls.addEventListener("change", () => this.draw());
    this.hold(false);
    this.listeners = [];
    this.box = new THREE.Box3();
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(element);
  }

  addLights() {
    // Together they give a face seen head-on its own colour, and a slanted one 60 % of it.
    this.scene.add(new THREE.AmbientLight(0xffffff, 0.6 * Math.PI));
    const lamp = new THREE.DirectionalLight(0xffffff, 0.4 * Math.PI);
    lamp.position.set(-0.25, 0.3, 1);
    this.camera.add(lamp);
    this.scene.add(this.camera);
  }

  // Whether wheel and one-finger strokes are the view's.
  hold(held) {
    this.controls.enableZoom = held;
    this.canvas.style.touchAction = held ? "none" : "pan-y";
  }

  // The box of all there is, and points (flat x, y, z) whose outline is to fill the view.
  frame(box, outline) {
    this.box = box;
    this.outline = outline;
    this.radius = box.getSize(new THREE.Vector3()).length() / 2 || 1;
    this.look("Oblique");
  }

  look(name) {
    const centre = this.box.getCenter(new THREE.Vector3());
    const way = new THREE.Vector3(...DIRECTIONS[name]).normalize();
    this.camera.near = 0;
    this.camera.far = 8 * this.radius;
    this.camera.zoom = 1;
    this.aim(centre, way);
    const seen = this.extent();
    centre.add(seen.getCenter(new THREE.Vector3()).setZ(0).applyQuaternion(this.camera.quaternion));
    this.aim(centre, way);
    this.fitted = seen.getSize(new THREE.Vector3()).multiplyScalar(0.5 * 1.12);
    this.resize();
    this.controls.update();
  }

  aim(centre, way) {
    this.controls.target.copy(centre);
    this.camera.position.copy(centre).addScaledVector(way, 4 * this.radius);
    this.camera.lookAt(centre);
    this.camera.updateMatrixWorld();
  }

  // The outline's box as the camera sees it, in the camera's frame.
  extent() {
    const [seen, point] = [new THREE.Box3(), new THREE.Vector3()];
    const turned = this.camera.matrixWorldInverse.copy(this.camera.matrixWorld).invert();
    for (let i = 0; i < this.outline.length; i += 3) {
      seen.expandByPoint(point.fromArray(this.outline, i).applyMatrix4(turned));
    }
    return seen;
  }

  // The box's corners, flat x, y, z.
  corners() {
    const { min, max } = this.box;
    return Array.from({ length: 8 }, (_, i) =>
      [i & 1 ? max.x : min.x, i & 2 ? max.y : min.y, i & 4 ? max.z : min.z]).flat();
  }

  // Towards the eye.
  eyeWay() {
    return this.camera.position.clone().sub(this.controls.target).normalize();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.element;
    if (!width || !height || !this.fitted) return;
    const reach = Math.max(this.fitted.y, (this.fitted.x * height) / width);
    this.camera.top = reach;
    this.camera.bottom = -reach;
    this.camera.right = (reach * width) / height;
    this.camera.left = -this.camera.right;
    this.camera.updateProjectionMatrix();
    this.renderer.setSize(width, height, false);
    this.render();
  }

  orbit(across, up) {
    const arm = this.camera.position.clone().sub(this.controls.target);
    const turn = new THREE.Quaternion().setFromUnitVectors(this.camera.up, new THREE.Vector3(0, 1, 0));
    const place = new THREE.Spherical().setFromVector3(arm.applyQuaternion(turn));
    place.theta += across;
    place.phi += up;
    place.makeSafe();
    arm.setFromSpherical(place).applyQuaternion(turn.invert());
    this.camera.position.copy(this.controls.target).add(arm);
    this.controls.update();
  }

  pan(across, up) {
    const shift = new THREE.Vector3(across, up, 0).multiplyScalar(1 / this.pixelsPerMm());
    shift.applyQuaternion(this.camera.quaternion);
    this.camera.position.add(shift);
    this.controls.target.add(shift);
    this.controls.update();
  }

  zoom(factor) {
    this.camera.zoom = Math.min(Math.max(this.camera.zoom * factor, ZOOM.least), ZOOM.most);
    this.camera.updateProjectionMatrix();
    this.controls.update();
    this.draw();
  }

  pixelsPerMm() {
    return (this.element.clientHeight * this.camera.zoom) / (this.camera.top - this.camera.bottom);
  }

  // Where a place is seen, in CSS pixels of the view.
  project(place) {
    const at = new THREE.Vector3(...place).project(this.camera);
    const { clientWidth, clientHeight } = this.element;
    return [((at.x + 1) / 2) * clientWidth, ((1 - at.y) / 2) * clientHeight];
  }

  // The ray under a pointer.
  ray({ clientX, clientY }) {
    const frame = this.element.getBoundingClientRect();
    const ray = new THREE.Raycaster();
    ray.setFromCamera(new THREE.Vector2(
      (2 * (clientX - frame.left)) / frame.width - 1,
      1 - (2 * (clientY - frame.top)) / frame.height), this.camera);
    return ray;
  }

  onDraw(action) { this.listeners.push(action); }

  draw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => this.render());
  }

  render() {
    this.waiting = false;
    this.renderer.render(this.scene, this.camera);
    for (const action of this.listeners) action(this);
  }

  picture() {
    this.renderer.render(this.scene, this.camera);
    return this.canvas.toDataURL("image/png");
  }

  // Cuts away what lies beyond `share` of the box along "x", "y", "z" or "view"; "none" cuts nothing.
  clip(axis, share) {
    this.renderer.clippingPlanes = [];
    if (axis !== "none" && share < 1) {
      const way = axis === "view" ? this.eyeWay() : new THREE.Vector3(...AXES[axis]);
      const corners = this.corners();
      const reach = [0, 3, 6, 9, 12, 15, 18, 21].map((i) =>
        new THREE.Vector3().fromArray(corners, i).dot(way));
      const [low, high] = [Math.min(...reach), Math.max(...reach)];
      this.renderer.clippingPlanes = [new THREE.Plane(way.negate(), low + share * (high - low))];
    }
    this.draw();
  }

  // Whether a point is left of what is cut away.
  isKept(point) {
    return this.renderer.clippingPlanes.every((plane) => plane.distanceToPoint(point) >= 0);
  }

  // Way to the eye, what is in the middle (from the box's centre, in radii of the box), zoom.
  viewpoint() {
    const off = this.controls.target.clone().sub(this.box.getCenter(new THREE.Vector3()));
    off.divideScalar(this.radius);
    return [...this.eyeWay().toArray(), ...off.toArray(), this.camera.zoom]
      .map((value) => Math.round(value * LINK_DIGITS) / LINK_DIGITS);
  }

  setViewpoint(numbers) {
    const way = new THREE.Vector3(...numbers.slice(0, 3));
    if (way.length() < 0.5) return;
    const centre = this.box.getCenter(new THREE.Vector3());
    centre.addScaledVector(new THREE.Vector3(...numbers.slice(3, 6)), this.radius);
    this.aim(centre, way.normalize());
    this.camera.zoom = 1;
    this.zoom(numbers[6]);
  }
}

// Scale bar and axes over a stage.
export function startOverlays(stage, bar, triad) {
  bar.hidden = false;
  triad.removeAttribute("hidden");
  stage.onDraw(() => {
    showScaleBar(bar, stage.pixelsPerMm());
    const turned = stage.camera.quaternion.clone().invert();
    const arms = Object.entries(AXES).map(([name, way]) =>
      ({ name, tip: new THREE.Vector3(...way).applyQuaternion(turned) }));
    arms.sort((a, b) => a.tip.z - b.tip.z);
    triad.replaceChildren(...arms.flatMap(({ name, tip: { x, y } }) => [
      make("svg:line", { x2: 24 * x, y2: -24 * y }),
      make("svg:text", { x: 32 * x, y: -32 * y }, Math.hypot(x, y) > 0.15 ? name : ""),
    ]));
  });
}

// Two designs beside each other in the operator's page are seen the same way: each view posts to the
// page where it is looked at from, and takes over what the page hands on of the other.
export function linkView(stage) {
  if (window.parent === window) return;
  let known = JSON.stringify(stage.viewpoint());
  stage.onDraw(() => {
    const view = stage.viewpoint();
    if (JSON.stringify(view) === known) return;
    known = JSON.stringify(view);
    window.parent.postMessage({ printctl: "view", view }, "*");
  });
  window.addEventListener("message", ({ source, data }) => {
    if (source !== window.parent || data?.printctl !== "view") return;
    const { view } = data;
    if (!Array.isArray(view) || view.length !== 7 || !view.every(Number.isFinite)) return;
    stage.setViewpoint(view);
    known = JSON.stringify(stage.viewpoint());
  });
}
