// Starts the page's parts.
import { startKeys } from "gcode/keys";
import { startPanel } from "gcode/panel";
import { View } from "gcode/view";
import { startTheme } from "report/theme";

startTheme();
const viewer = document.getElementById("viewer");
try {
  const data = JSON.parse(document.getElementById("view-data").textContent);
  const view = new View(data, document.getElementById("stage"));
  startPanel(view);
  startKeys(view);
  viewer.dataset.state = "ready";
  view.resize();
  await view.show(data.first.layer);
} catch (error) {
  viewer.dataset.state = "failed";
  document.getElementById("viewer-message").textContent = `The view failed: ${error.message}`;
  console.warn(`View: ${error.message}`);
}
document.documentElement.dataset.state = "ready";
