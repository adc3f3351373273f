// After a print: what came out and where to go on, the steps that follow, notes and photos.
import { part, send, url } from "../api.js";
import {
  Act, Button, Card, Drop, Facts, Field, Fields, Fold, Kept, Loaded, Photos, bytes, html, nameOf, number, runOf,
  useGet, useState, when,
} from "../ui.js";
import { madeRows } from "../runs.js";

export default function After({ job, print }) {
  return html`<div class="columns job-set">
    <div class="stack"><${Outcome} job=${job} print=${print} />
      <div class="job-later"><${Notes} key=${print.print_id} job=${job} /></div></div>
    <div class="stack"><${Steps} key=${print.print_id} job=${job} />
      <div class="job-later"><${TimeLapse} job=${job} print=${print} /></div></div>
  </div>`;
}

function Outcome({ job, print }) {
  const run = runOf(job);
  const files = useGet(run ? `/runs/${part(run)}/files` : null);
  const report = files.value?.includes("report.html") && `/runs/${part(run)}/pages/report`;
  const history = `/history/${part(print.print_id)}`;
  return html`<${Card} title="What came out">
    <${Facts} rows=${[
      ["Began", when(print.started)],
      ...madeRows(print.progress),
      ["Lines", `${print.lines_done} of ${print.lines_total}`],
    ]} />
    <div class="job-links">
      ${run && html`<${Next} href=${`/scan?run=${part(run)}`} main name="Scan and judge it"
        says="Bring in its scan, and compare it with the design." />`}
      ${report && html`<${Next} href=${url(report)} away name="Report" says="What the run and its scan say so far." />`}
      <${Next} href=${`/job?job=${part(job)}&again=${part(print.print_id)}`} main=${!run} name="Print again"
        says="The same job, checked anew." />
      <${Next} href=${`/history?print=${part(print.print_id)}`} name="History"
        says="All that happened in this print, beside earlier ones." />
      <${Next} href=${url(`${history}/bundle`)} away download name="Record"
        says="Signed: journal, G-code, profiles, notes (zip)." />
    </div>
  </${Card}>`;
}

const Next = ({ href, name, says, main, away, download }) => html`<div class="job-next">
  <${Button} kind=${main ? "main" : "quiet"} href=${href} download=${download}
    target=${away && !download ? "_blank" : undefined}
    rel=${away ? "noopener" : undefined}>${name}</${Button}><span class="quiet">${says}</span></div>`;

function TimeLapse({ job, print }) {
  const lapse = useGet(`/prints/${part(job)}/timelapse`, { every: 5000 });
  const one = lapse.value;
  if (!one || !(one.frames || one.message)) return null;
  const film = `/prints/${part(job)}/timelapse/film`;
  return html`<${Card} title="Time-lapse">
    ${one.film && html`<img class="job-film" src=${url(`${film}?of=${part(print.print_id)}`)}
        alt=${`Film of ${one.frames} pictures`} />
      <${Button} href=${url(film)} download=${`${nameOf(job)}_timelapse.webp`}>Fetch the film (WebP)</${Button}>`}
    <p class="quiet">${one.frames} pictures, ${bytes(one.bytes)}${one.making ? "; the film is being made" : ""}.
      ${" "}${one.message}</p>
  </${Card}>`;
}

function Steps({ job }) {
  const path = `/prints/${part(job)}/steps`;
  const steps = useGet(path);
  const more = { melt_out: MeltOut, flush: Flush };
  return html`<${Card} title="What follows">
    <${Loaded} of=${steps} what="Reading the steps">${(rows) => rows.map((one) => html`
      <div key=${one.id} class="job-step">
      <${Kept} kind="flag" label=${one.text} value=${one.done}
        hint=${one.done && one.at ? `${when(one.at)}, ${one.who}` : ""}
        save=${(done) => send("PUT", `${path}/${part(one.id)}`, { done }).then(steps.reload)} />
      ${more[one.id] && html`<${more[one.id]} job=${job} />`}
    </div>`)}</${Loaded}>
  </${Card}>`;
}

const RAMP = [
  { name: "heater", kind: "choice", label: "Heater", options: ["bed", "nozzle", "chamber"] },
  { name: "target_c", kind: "number", label: "Target", unit: "°C", min: 0, max: 60 },
  { name: "rate_c_min", kind: "number", label: "Rate", unit: "°C/min", min: 0.1, max: 20 },
];

function MeltOut({ job }) {
  const first = useGet(`/prints/${part(job)}/melt-out`);
  const ramp = useGet("/melt-out", { every: 2000 });
  const [typed, setTyped] = useState(null);
  const said = typed ?? first.value;
  const now = ramp.value;
  const celsius = (value) => (value === null ? "–" : `${value.toFixed(1)} °C`);
  return html`<${Fold} title="Warm the bath slowly" open=${now?.going_on}>
    ${said && html`<${Fields} fields=${RAMP} of=${said} onChange=${setTyped} />
    <div class="row">
      <${Act} work=${() => send("POST", "/melt-out", said).then(ramp.reload)}>Warm</${Act}>
      <${Act} work=${() => send("DELETE", "/melt-out").then(ramp.reload)} disabled=${!now?.going_on}>Hold here</${Act}>
    </div>`}
    ${now && html`<p role="status">${now.heater}: ${celsius(now.now_c)} now, set to ${celsius(now.set_c)}, up to
      ${" "}${celsius(now.target_c)} at ${number(now.rate_c_min)} °C/min; ${now.message}</p>`}
  </${Fold}>`;
}

function Flush({ job }) {
  const [allowed, setAllowed] = useState(null);
  const limit = useGet(`/prints/${part(job)}/flush${allowed ? `?wall_shear_pa=${allowed}` : ""}`);
  return html`<${Fold} title="How hard the channels bear it">
    <${Field} kind="number" label="Allowed wall shear" unit="Pa" min="0.01" max="1000"
      value=${allowed ?? limit.value?.wall_shear_pa ?? null} onChange=${setAllowed} />
    <${Loaded} of=${limit}>${(one) => html`<p>${one
      ? `At most ${number(one.pressure_pa, 3)} Pa between inlet and outlet: vessel ${one.vessel} then has
        ${number(one.wall_shear_pa)} Pa at its wall (at its mean radius; its narrow end has more).`
      : "No flow was solved for this job: keep the pressure low and look at the outlet."}</p>`}</${Loaded}>
  </${Fold}>`;
}

function Notes({ job }) {
  const way = `/prints/${part(job)}`;
  const notes = useGet(`${way}/notes`);
  const photos = useGet(`${way}/photos`);
  const [text, setText] = useState("");
  const add = async () => {
    await send("POST", `${way}/notes`, { text });
    setText("");
    notes.reload();
  };
  return html`<${Card} title="Notes and photos">
    <${Loaded} of=${notes} what="Reading the notes">${(rows) => rows.length > 0 && html`
      <ul class="list job-notes">${rows.map((one, at) => html`<li key=${at}><p>${one.text}</p>
        <span class="quiet">${when(one.at)}, ${one.who}</span></li>`)}</ul>`}</${Loaded}>
    <div class="job-note">
      <${Field} kind="long" label="Note" value=${text} maxlength="10000" onChange=${setText} />
      <${Act} work=${add} why=${text.trim() ? "" : "write the note first"}>Add note</${Act}>
    </div>
    <${Loaded} of=${photos} what="Reading the photos">${(rows) => rows.length > 0 && html`<${Photos}
      rows=${rows.map(({ name, at, who }) => ({
        href: url(`${way}/photos/${part(name)}`), alt: `Photo of ${when(at)}, ${who}` }))} />`}</${Loaded}>
    <${Drop} label="Add a photo" accept="image/*" path=${`${way}/photos`} onDone=${photos.reload} />
  </${Card}>`;
}
