// Pointer, wheel and keys on the stage.
const STEP = 1.25;

export function startHands(view) {
  const stage = view.holder;
  const held = new Map();
  const place = (event) => {
    const box = stage.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  stage.addEventListener("contextmenu", (event) => view.passes && event.preventDefault());
  stage.addEventListener("pointerdown", (event) => {
    if (event.isTrusted) stage.setPointerCapture(event.pointerId);
    held.set(event.pointerId, place(event));
  });
  for (const name of ["pointerup", "pointercancel"]) {
    stage.addEventListener(name, (event) => held.delete(event.pointerId));
  }
  stage.addEventListener("pointerleave", () => view.point(null, null));
  stage.addEventListener("pointermove", (event) => {
    const [u, v] = place(event);
    const before = held.get(event.pointerId);
    if (!before) { view.point(u, v); return; }
    drag(view, held, event, before, [u, v]);
    held.set(event.pointerId, [u, v]);
  });
  stage.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(view, Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)), place(event));
  }, { passive: false });
  stage.addEventListener("dblclick", () => fit(view));
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

export function drag(view, held, event, before, now) {
  const [du, dv] = [now[0] - before[0], now[1] - before[1]];
  view.fitted = false;
  if (held.size === 2) {
    const other = [...held].find(([id]) => id !== event.pointerId)[1];
    const apart = (a) => Math.hypot(a[0] - other[0], a[1] - other[1]);
    view.camera.zoom(apart(now) / Math.max(apart(before), 1), ...other);
  } else if (turns(view, event)) {
    view.camera.look(view.camera.azimuth - 0.4 * du, view.camera.elevation + 0.4 * dv);
  } else view.camera.pan(du, dv);
  view.draw();
}

// Where there is no right button (a tablet) a plain stroke may turn; then Shift pans.
function turns(view, event) {
  if (!view.passes) return false;
  return event.buttons === 2 || event.altKey || (view.turnsByDrag && !event.shiftKey);
}

export function zoom(view, factor, [u, v] = view.camera.size.map((x) => x / 2)) {
  view.fitted = false;
  view.camera.zoom(factor, u, v);
  view.draw();
}

export function fit(view) {
  view.fitted = true;
  view.camera.fit();
  view.draw();
}
