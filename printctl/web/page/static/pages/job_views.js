// What is seen of a job: the drawing of what is written, and the camera.
import { get, part } from "../api.js";
import { Button, Note, bytes, html, useEffect, useGet, useKept, useNews, useRef, useState, useStyle } from "../ui.js";

const LIVE = "/live/static";
const STILL_MS = 1000;
const AHEAD_S = 10; // what comes next is drawn in a colour of its own

// What has been written, the needle, what comes next; all of a job that isn't printed (no `print`).
export function LiveView({ job, print = null }) {
  useStyle(`${LIVE}/live_view.css`);
  const box = useRef(null);
  const [view, setView] = useState(null);
  const [tools, setTools] = useKept("live.tools", false);
  const [mends, setMends] = useState([]);
  const live = print !== null;
  const ahead = print?.ended ? 0 : AHEAD_S;
  useEffect(() => {
    let [gone, made] = [false, null];
    import(`${LIVE}/live_view.js`)
      .then(({ liveView }) => gone || liveView(box.current, { scene: `/live/${part(job)}/scene`, live, ahead }))
      .then((one) => {
        made = one || null;
        if (gone) made?.dispose();
        else setView(made);
      });
    return () => {
      gone = true;
      made?.dispose();
    };
  }, [job, live, ahead]);
  const inserted = print?.inserted ?? [];
  useEffect(() => {
    if (inserted.length) get(`/prints/${part(job)}/mends`).then(setMends, () => null);
  }, [job, String(inserted)]);
  const executed = print?.lines_executed;
  useEffect(() => {
    if (!view || !print) return;
    view.update({
      executed: inFile(executed, inserted), acknowledged: inFile(ahead ? print.lines_done : executed, inserted),
      mends: mends.map((one) => ({ ...one, written: one.last <= executed })),
    });
  }, [view, executed, print?.lines_done, mends]);
  return html`<div class=${tools ? "job-live job-live-tools" : "job-live"}>
    <div class="job-live-box" ref=${box}></div>
    ${live && !tools && html`<ul class="job-legend">
      <li class="job-written-key">written</li>
      ${ahead > 0 && html`<li class="job-next-key">next ${ahead} s</li>`}
      <li class="job-rest-key">${ahead ? "still to come" : "not written"}</li></ul>`}
    <${Button} aria-expanded=${String(tools)} onClick=${() => setTools(!tools)}>
      ${tools ? "Fewer" : "View …"}</${Button}>
  </div>`;
}

// How many of the lines of a job that has grown are of its file.
const inFile = (lines, inserted) =>
  lines - inserted.reduce((sum, [after, count]) => sum + Math.min(Math.max(lines - after, 0), count), 0);

// The camera's picture of now, where there is one; a new one about every second while it is looked at.
export function Camera({ job, print }) {
  const camera = useNews("camera");
  const [at, setAt] = useState(0);
  const there = camera?.state === "there";
  useEffect(() => {
    if (!there) return undefined;
    const timer = setInterval(() => document.hidden || setAt(Date.now()), STILL_MS);
    return () => clearInterval(timer);
  }, [there]);
  if (!camera || camera.state === "none") return null;
  return html`<figure class="job-camera">
    ${there ? html`<div><img src=${`/api/v1/camera/still?at=${at}`} alt="The print, seen by the camera" /></div>`
      : html`<${Note} tone="warn">${camera.message || "The camera begins."}</${Note}>`}
    <figcaption><${Kept} job=${job} print=${print} /></figcaption>
  </figure>`;
}

// How many pictures of its layers or vessels are kept; the film is made at the end.
function Kept({ job, print }) {
  const { layers_done: layers, vessels_done: vessels } = print.progress ?? {};
  const { value } = useGet(`/prints/${part(job)}/timelapse`, { key: `${layers} ${vessels}` });
  if (!value?.frames) return null;
  return html`<p class="hint">Time-lapse: ${value.frames} pictures,
    ${" "}${bytes(value.bytes)}${value.message && `; ${value.message}`}.</p>`;
}
