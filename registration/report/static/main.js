// Starts the page's parts; each works without the others.
import { startSections } from "report/sections";
import { startSelection } from "report/selection";
import { startTables } from "report/tables";
import { startTheme } from "report/theme";
import { startViewer } from "report/viewer";

startTheme();
startTables();
const block = document.getElementById("view-data");
if (block) {
  const viewer = document.getElementById("viewer");
  try {
    const data = JSON.parse(block.textContent);
    const view = await startViewer(data);
    viewer.dataset.state = "ready";
    if (view.network) startSelection(view.network);
  } catch (error) {
    // Without WebGL the tables and drawings still stand; the message in the page says so.
    viewer.dataset.state = "failed";
    console.warn(`3D view: ${error.message}`);
  }
}
const sections = document.getElementById("sections-data");
if (sections) await startSections(JSON.parse(sections.textContent));
document.documentElement.dataset.state = "ready";
