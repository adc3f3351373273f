// Light, dark, or what the system says.
import "report/framed";

const NEXT = { system: "light", light: "dark", dark: "system" };

export function startTheme() {
  const button = document.getElementById("theme");
  let theme = "system";
  button.hidden = false;
  button.addEventListener("click", () => {
    theme = NEXT[theme];
    if (theme === "system") delete document.documentElement.dataset.theme;
    else document.documentElement.dataset.theme = theme;
    button.textContent = `Theme: ${theme}`;
  });
}
