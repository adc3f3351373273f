// Which vessel is pointed at, and which is chosen; table and 3D view both tell and listen.
const target = new EventTarget();
export const state = { hovered: null, selected: null };

export function set(name, vessel) {
  if (state[name] === vessel) return;
  state[name] = vessel;
  target.dispatchEvent(new Event(name));
}

export function listen(name, action) {
  target.addEventListener(name, () => action(state[name]));
}
