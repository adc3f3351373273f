// Light, dark, or as the system says; kept in this browser. Runs before anything is drawn.
(() => {
  "use strict";
  const KEY = "printctl.theme";
  const MODES = ["auto", "light", "dark"];
  const system = window.matchMedia("(prefers-color-scheme: dark)");

  function mode() {
    try {
      const kept = localStorage.getItem(KEY);
      return MODES.includes(kept) ? kept : "auto";
    } catch {
      return "auto";
    }
  }

  function apply() {
    const chosen = mode();
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
      try {
        localStorage.setItem(KEY, MODES[(MODES.indexOf(mode()) + 1) % MODES.length]);
      } catch {
        // A browser that keeps nothing: the system's choice stays.
      }
      apply();
    });
  });
})();
