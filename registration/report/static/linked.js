// Two designs beside each other in the operator's page are seen the same way: each view tells the
// page where it is looked at from, and takes over what the page hands on of the other.
import * as THREE from "three";

const DIGITS = 1e5;

export function linkView(stage) {
  if (window.parent === window) return;
  let known = JSON.stringify(viewOf(stage));
  stage.onDraw(() => {
    const view = viewOf(stage);
    const said = JSON.stringify(view);
    if (said === known) return;
    known = said;
    window.parent.postMessage({ printctl: "view", view }, "*");
  });
  window.addEventListener("message", (event) => {
    if (event.source !== window.parent || event.data?.printctl !== "view") return;
    const view = event.data.view;
    if (!Array.isArray(view) || view.length !== 7 || !view.every(Number.isFinite)) return;
    show(stage, view);
    known = JSON.stringify(viewOf(stage));
    stage.draw();
  });
}

// Way to the eye, what is in the middle (from the box's centre, in radii of the box), zoom.
function viewOf(stage) {
  const centre = stage.box.getCenter(new THREE.Vector3());
  const off = stage.controls.target.clone().sub(centre).divideScalar(stage.radius);
  const numbers = [...stage.eyeWay().toArray(), ...off.toArray(), stage.camera.zoom];
  return numbers.map((one) => Math.round(one * DIGITS) / DIGITS);
}

function show(stage, view) {
  const way = new THREE.Vector3(...view.slice(0, 3));
  if (way.length() < 0.5) return;
  const centre = stage.box.getCenter(new THREE.Vector3());
  centre.addScaledVector(new THREE.Vector3(...view.slice(3, 6)), stage.radius);
  stage.aim(centre, way.normalize());
  stage.camera.zoom = Math.min(Math.max(view[6], 0.2), 500);
  stage.camera.updateProjectionMatrix();
  stage.controls.update();
}
