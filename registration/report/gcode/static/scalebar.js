// A round length beside the stage: its bar and its name.
import { short } from "gcode/colours";

export function tellScale(scale, element) {
  const room = 120 / scale;
  const ten = 10 ** Math.floor(Math.log10(room));
  const length = [5, 2, 1].map((x) => x * ten).find((x) => x <= room) ?? ten;
  element.querySelector("i").style.width = `${length * scale}px`;
  element.querySelector("span").textContent =
    length < 1 ? `${short(1000 * length)} µm` : `${short(length)} mm`;
}
