// A plane that cuts part of the scene away.
import * as THREE from "three";

const WAYS = {
  x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1],
};

export function startClip(stage) {
  const [axis, slider] = ["clip-axis", "clip"].map((id) => document.getElementById(id));
  const plane = new THREE.Plane();
  const update = () => {
    const share = Number(slider.value) / 1000;
    slider.disabled = axis.value === "none";
    stage.renderer.clippingPlanes = slider.disabled || share === 1 ? [] : [plane];
    if (slider.disabled) return stage.draw();
    const way = axis.value === "view" ? stage.eyeWay() : new THREE.Vector3(...WAYS[axis.value]);
    const reach = [];
    for (let i = 0; i < 8; i++) reach.push(stage.corner(i).dot(way));
    const [low, high] = [Math.min(...reach), Math.max(...reach)];
    plane.normal.copy(way).negate();
    plane.constant = low + share * (high - low);
    return stage.draw();
  };
  axis.addEventListener("change", () => {
    if (Number(slider.value) === 1000) slider.value = 500;
    update();
  });
  slider.addEventListener("input", update);
  stage.controls.addEventListener("change", () => { if (axis.value === "view") update(); });
  update();
}

// Whether a point is left of what the plane cuts away.
export function isKept(stage, point) {
  return stage.renderer.clippingPlanes.every((plane) => plane.distanceToPoint(point) >= 0);
}
