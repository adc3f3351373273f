// Starts the slider; in a page of its own the theme's switch, too.
import { readPlay } from "play/data";
import { startKeys, startPanel, startPlaying, startTouch } from "play/panel";
import { PlayView } from "play/view";
import { startTheme } from "report/theme";

const own = document.body.classList.contains("play-page");
if (own) startTheme();
const viewer = document.getElementById("play-viewer");
try {
  const data = JSON.parse(document.getElementById("play-data").textContent);
  const view = new PlayView(data, await readPlay(data), document.getElementById("play-stage"));
  startPanel(view);
  startKeys(view, startPlaying(view));
  startTouch(view);
  viewer.dataset.state = "ready";
  const follow = () => fromAddress(view);
  window.addEventListener("hashchange", follow);
  follow();
  view.resize();
} catch (error) {
  viewer.dataset.state = "failed";
  console.warn(`Slider: ${error.message}`);
}
if (own) document.documentElement.dataset.state = "ready";

// #t=0.5 is half of the time; &colour=width says what by.
function fromAddress(view) {
  const said = new URLSearchParams(location.hash.slice(1));
  const [share, colour] = [Number(said.get("t")), said.get("colour")];
  const known = view.data.colourings.some(({ key }) => key === colour);
  if (known) {
    document.getElementById("play-colouring").value = colour;
    view.colour(colour);
  }
  if (said.has("t") && Number.isFinite(share)) view.to(share * view.duration);
}
