// The page: which part of it is shown at which address. Each part is a module in pages/ whose default
// export is a component, given the address's query as its properties.
import { beginNews } from "./api.js";
import { beginHeader, markCurrent, setTitle } from "./header.js";
import { Failed, go, html, render } from "./ui.js";

const PAGES = {
  "/": ["home", "Home"],
  "/project": ["project", "Project"],
  "/printer": ["printer", "Printer"],
  "/commission": ["commission", "Set up a printer"],
  "/job": ["job", "Job"],
  "/design": ["design", "Design"],
  "/scan": ["scan", "Scan"],
  "/history": ["history", "History"],
};
const content = document.getElementById("content");
let shown = 0;

async function show(first = false) {
  const [file, title] = PAGES[location.pathname] ?? [];
  const turn = (shown += 1);
  markCurrent(location.pathname === "/project" ? "/" : location.pathname);
  setTitle(title ?? "Not found");
  content.dataset.page = file ?? "";
  let body = html`<${Failed} problem=${{ message: `There is no page ${location.pathname}.` }} />`;
  if (file) {
    try {
      const { default: Page } = await import(`./pages/${file}.js`);
      const query = Object.fromEntries(new URLSearchParams(location.search));
      body = html`<${Page} key=${location.pathname + location.search} ...${query} />`;
    } catch (problem) {
      console.error(problem);
      body = html`<${Failed} problem=${{ message: `The page ${title} can't be shown. EMERGENCY STOP above works. Reload the page.` }} />`;
    }
  }
  if (turn !== shown) return; // another page was asked for meanwhile
  render(body, content);
  if (!first) {
    window.scrollTo(0, 0);
    content.focus({ preventScroll: true });
  }
}

document.addEventListener("click", (event) => {
  const link = event.target instanceof Element && event.target.closest("a[href]");
  if (!link || event.defaultPrevented || event.button || event.metaKey || event.ctrlKey || event.shiftKey) return;
  const to = new URL(link.href, location.href);
  if (to.origin !== location.origin || link.target || link.hasAttribute("download") || !(to.pathname in PAGES)) return;
  event.preventDefault();
  if (to.href !== location.href) go(to.pathname + to.search);
});
window.addEventListener("popstate", () => show());

beginHeader();
beginNews();
show(true);
