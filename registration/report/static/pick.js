// A click on a surface marks the place and tells it to the page around this one.
import * as THREE from "three";
import { firstKept } from "report/pointer";

const MARK = 0.012;

// Gives what is done with a click's ray.
export function pickPlaces(stage, view) {
  const shape = new THREE.SphereGeometry(MARK * stage.radius, 24, 16);
  const material = new THREE.MeshLambertMaterial({ color: 0xc8102e });
  return (ray) => {
    const hits = view.surfaces
      .filter(({ group }) => group.visible)
      .map(({ mesh }) => firstKept(stage, ray, mesh))
      .filter(Boolean)
      .sort((a, b) => a.distance - b.distance);
    if (!hits.length) return;
    const mark = new THREE.Mesh(shape, material);
    mark.position.copy(hits[0].point);
    stage.scene.add(mark);
    stage.draw();
    window.parent.postMessage({ printctl: "pick", at: hits[0].point.toArray() }, "*");
  };
}
