// Camera, light and drawing on demand. The projection is orthographic, so the scale bar holds
// everywhere in the picture.
import * as THREE from "three";
import { OrbitControls } from "three/orbit";

const DIRECTIONS = {
  Oblique: [-0.55, -1, 0.85], Top: [0, -1e-4, 1], Front: [0, -1, 0], Side: [1, 0, 0],
  Back: [0, 1, 0], Below: [0, -1e-4, -1],
};

export class Stage {
  constructor(element, drawing = {}) {
    this.element = element;
    this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true, ...drawing });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    element.append(this.renderer.domElement);
    this.scene = new THREE.Scene();
    this.camera = new THREE.OrthographicCamera();
    this.camera.up.set(0, 0, 1);
    this.addLights();
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.addEventListener("change", () => this.draw());
    this.takeHold(false);
    this.listeners = [];
    this.box = new THREE.Box3();
    new ResizeObserver(() => this.resize()).observe(element);
  }

  addLights() {
    // Together they give a face seen head-on its own colour, and a slanted one 60 % of it.
    this.scene.add(new THREE.AmbientLight(0xffffff, 0.6 * Math.PI));
    const lamp = new THREE.DirectionalLight(0xffffff, 0.4 * Math.PI);
    lamp.position.set(-0.25, 0.3, 1);
    this.camera.add(lamp);
    this.scene.add(this.camera);
  }

  // Until it is clicked, the view leaves wheel and one-finger strokes to the page.
  takeHold(held) {
    this.controls.enableZoom = held;
    this.renderer.domElement.style.touchAction = held ? "none" : "pan-y";
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

  // Corner i of the box, 0 to 7.
  corner(i) {
    const { min, max } = this.box;
    return new THREE.Vector3(i & 1 ? max.x : min.x, i & 2 ? max.y : min.y, i & 4 ? max.z : min.z);
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
    this.camera.zoom = Math.min(Math.max(this.camera.zoom * factor, 0.2), 500);
    this.camera.updateProjectionMatrix();
    this.controls.update();
    this.draw();
  }

  pixelsPerMm() {
    return (this.element.clientHeight * this.camera.zoom) / (this.camera.top - this.camera.bottom);
  }

  onDraw(action) {
    this.listeners.push(action);
  }

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
    return this.renderer.domElement.toDataURL("image/png");
  }
}

export const directions = Object.keys(DIRECTIONS);
