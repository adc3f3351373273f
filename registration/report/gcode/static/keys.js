// Pointer, wheel and keys on the stage.
import { fit, startStrokes, zoom } from "gcode/strokes";

const STEP = 1.25;

export function startKeys(view) {
  startStrokes(view, { point: (u, v) => view.point(u, v) });
  document.addEventListener("keydown", (event) => {
    // A field that is being typed in, and a slider in hand, keep their keys.
    if (event.target.matches?.("input:not([type=checkbox]), select")) return;
    const step = event.shiftKey ? 10 : 1;
    const act = {
      ArrowUp: () => view.show(view.layer + step), ArrowDown: () => view.show(view.layer - step),
      ArrowRight: () => view.to(view.move + step), ArrowLeft: () => view.to(view.move - step),
      Home: () => view.show(0), End: () => view.show(view.count - 1), 0: () => fit(view),
      "+": () => zoom(view, STEP), "=": () => zoom(view, STEP), "-": () => zoom(view, 1 / STEP),
    }[event.key];
    if (!act || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    act();
  });
}
