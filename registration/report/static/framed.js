// A frame keeps its keys to itself. In the operator's page Esc twice is the stop, so hand it on.
if (window.parent !== window) {
  window.addEventListener(
    "keydown",
    (event) => {
      if (event.key !== "Escape" || event.repeat) return;
      window.parent.postMessage({ printctl: "escape" }, "*");
    },
    true,
  );
}
