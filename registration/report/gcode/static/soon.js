// Acts with the next frame; without frames (a tab in the background, a print) soon all the same.
const LATEST_MS = 100;

export function soon(action) {
  let done = false;
  const once = () => {
    if (done) return;
    done = true;
    action();
  };
  requestAnimationFrame(once);
  setTimeout(once, LATEST_MS);
}
