// Pointer and wheel on a canvas view move its camera.

// `taken` says whether the wheel is the view's; `point` gets where a pointer is that drags nothing.
export function startStrokes(view, { taken = () => true, point = () => {} } = {}) {
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
  stage.addEventListener("pointerleave", () => point(null, null));
  stage.addEventListener("pointermove", (event) => {
    const now = place(event);
    const before = held.get(event.pointerId);
    if (!before) { point(...now); return; }
    drag(view, held, event, before, now);
    held.set(event.pointerId, now);
  });
  stage.addEventListener("wheel", (event) => {
    if (!taken()) return;
    event.preventDefault();
    zoom(view, Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)), place(event));
  }, { passive: false });
  stage.addEventListener("dblclick", () => fit(view));
}

function drag(view, held, event, before, now) {
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

export function pan(view, du, dv) {
  view.fitted = false;
  view.camera.pan(du, dv);
  view.draw();
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
