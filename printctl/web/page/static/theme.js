// Light, dark, or as the system says; kept in this browser. Runs before anything is drawn.
(() => {
  "use strict";
  const KEY = "printctl.theme";
  const MODES = ["auto", "light", "dark"];
  const system = window.matchMedia("(prefers-color-scheme: dark)");

  let chosen = "auto";
  try {
    chosen = MODES.find((mode) => mode === localStorage.getItem(KEY)) ?? chosen;
  } catch {
    // A browser that keeps nothing: the choice lasts as long as the page.
  }

  function apply() {
    const dark = chosen === "dark" || (chosen === "auto" && system.matches);
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    const button = document.getElementById("pc-theme");
    if (!button) return;
    button.textContent = chosen[0].toUpperCase() + chosen.slice(1);
    button.setAttribute("aria-label", `Theme: ${chosen}`);
    button.title = `Theme: ${chosen}`;
  }

  apply();
  system.addEventListener("change", apply);
  document.addEventListener("DOMContentLoaded", () => {
    apply();
    document.getElementById("pc-theme")?.addEventListener("click", () => {
      chosen = MODES[(MODES.indexOf(chosen) + 1) % MODES.length];
      apply();
      localStorage.setItem(KEY, chosen);
    });
  });
})();
