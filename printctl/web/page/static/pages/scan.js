// Scans of printed parts: added, looked at, compared with a design, judged.
import { part, send, url } from "../api.js";
import {
  Act, Bullets, Button, Card, Drop, Empty, Field, Fold, Links, Loaded, Page, Tabs, Tiles, Unusable,
  bytes, html, number, useAddress, useEnd, useGet, useState, useStyle, when,
} from "../ui.js";
import { Frame } from "../frame.js";
import { Files, Stages, isGoing } from "../runs.js";
import Findings, { Vessels } from "./scan_findings.js";
import { Metadata, Missing } from "./scan_metadata.js";
import Slices from "./scan_slices.js";

const FORMATS = "TIFF, OME-TIFF, NRRD, NIfTI, MetaImage, DICOM, HDF5, MATLAB, Thorlabs .oct, Bioptigen, Heidelberg, .npz; "
  + "or a .zip of TIFF or DICOM slices, or of an OME-Zarr.";
const FOLLOWED_MS = 1500;
const MODALITIES = { oct: "OCT", microct: "micro-CT", confocal: "confocal" };
const NONE = "none"; // no scan is chosen, though there are some
const plain = (scan) => scan.replace(/^file~/, "").replace(/^run~(.*)$/, "$1 (its own scan)");

export default function Scan({ scan = "", run = "", view = "" }) {
  useStyle("pages/scan.css");
  return view === "report" ? html`<${Report} scan=${scan} run=${run} />` : html`<${Room} scan=${scan} run=${run} />`;
}

// The report fills the window: it is long, and has a head of its own.
function Report({ scan, run }) {
  const address = url(`/scans/${part(scan)}/with/${part(run)}/report`);
  const tools = html`
    <${Button} href=${address} target="_blank" rel="noopener">Open in a tab of its own</${Button}>
    <${Button} href=${`/scan?scan=${part(scan)}&run=${part(run)}`}>Back</${Button}>`;
  return html`<${Page} title=${`Report: ${run}`} tools=${tools} wide>
    <${Frame} title=${`Report of ${plain(scan)} with ${run}`} src=${address} />
  </${Page}>`;
}

function Room({ scan, run }) {
  const scans = useGet("/scans");
  const runs = useGet("/runs");
  const unusable = useGet("/scans/unusable");
  const [at, setAt] = useState({ scan, run });
  const go = (more) => setAt((old) => ({ ...old, ...more }));
  const rows = scans.value ?? [];
  const own = rows.find((one) => one.scan === `run~${at.run}`);
  // Who comes from a print without a scan is asked for one; others see the newest.
  const row = rows.find((one) => one.scan === at.scan) ?? own ?? (at.run || at.scan === NONE ? undefined : rows[0]);
  useAddress("/scan", { scan: row?.scan, run: at.run }, scans.value !== null);
  const show = (more) => { scans.reload(); go(more); };
  // Runs whose print is done, and which were not scanned by the simulator yet.
  const done = (useGet("/prints").value ?? []).filter((one) => one.state === "done");
  const printed = (runs.value ?? []).map((one) => one.name).filter((name) =>
    done.some((one) => one.job === `run~${name}`) && !rows.some((one) => one.scan === `run~${name}`));
  return html`<${Page} title="Scan">
    <${Loaded} of=${scans} what="Looking for scans">${() => html`<div class="scan-room">
      <div class="stack">
        <${Card} title=${row ? "Scans" : "Scan the part, then drop the scan here"}>
          <${Drop} label="Add a scan" path="/scans" onDone=${(one) => show({ scan: one.scan })} />
          <${Fold} title="Which files"><p class="hint">${FORMATS}</p>
            <${Unusable} names=${unusable.value} /></${Fold}>
          <${List} rows=${rows} at=${row?.scan} choose=${(name) => go({ scan: name })} />
          ${row && printed.length > 0 && html`
            <${Button} onClick=${() => go({ scan: NONE, run: "" })}>Scan of a simulated print …</${Button}>`}
        </${Card}>
      </div>
      ${row
        ? html`<${OneScan} key=${row.scan} row=${row} run=${at.run} runs=${runs.value ?? []}
            onRun=${(name) => go({ run: name })} onChange=${scans.reload} onGone=${() => show({ scan: "" })} />`
        : html`<${Purpose} run=${at.run} printed=${printed}
            onDone=${(name) => show({ scan: `run~${name}`, run: name })} />`}
    </div>`}</${Loaded}>
  </${Page}>`;
}

function List({ rows, at, choose }) {
  const about = (one) => {
    const size = one.megabytes ? bytes(1e6 * one.megabytes) : "slices";
    const compared = one.scan.startsWith("file~") && one.registered.length > 0 && `with ${one.registered.join(", ")}`;
    return [when(one.modified), size, compared].filter(Boolean).join(" · ");
  };
  return html`<div class="scan-list"><${Links} rows=${rows.map((one) => ({
    href: `/scan?scan=${part(one.scan)}`, name: plain(one.scan), about: about(one), current: one.scan === at,
  }))} choose=${(name) => choose(rows.find((one) => plain(one.scan) === name).scan)} /></div>`;
}

// What a scan is for, and the simulated one of a simulated print.
function Purpose({ run, printed, onDone }) {
  const [chosen, setChosen] = useState("");
  const name = run ? printed.find((one) => one === run) : printed.find((one) => one === chosen) ?? printed[0];
  const progress = useGet(name && `/runs/${part(name)}/progress`, { every: FOLLOWED_MS });
  const going = isGoing(progress.value);
  const way = `/runs/${part(name ?? "")}`;
  useEnd(going, () => progress.value?.state === "done" && onDone(name));
  return html`<${Card} title="What comes of it">
    <p>The scan is laid over the design: each vessel is measured, and the report says whether the part is right, and
      where it isn't.</p>
    <${Bullets} list="ol" rows=${["Scan the part (OCT, micro-CT or confocal).",
      "Drop the scan's file where it says so.", "Choose its design and press Register."]} />
    ${name ? html`
      <h3>After a rehearsal</h3>
      <p>A simulated print can be scanned by the simulator.</p>
      <div class="row row-end scan-row">
        ${!run && printed.length > 1 && html`<${Field} kind="choice" label="Print" value=${name} onChange=${setChosen}
          options=${printed} />`}
        ${going ? html`<${Act} post=${`${way}/cancel`} work=${progress.reload}>Cancel</${Act}>`
          : html`<${Act} kind="main" post=${`${way}/continue`} work=${progress.reload}>
            Simulate the scan of ${name}, and judge it</${Act}>`}
      </div>
      <${Stages} of=${progress.value} />`
    : run && html`<${Empty}>${run} has no finished print here; a scan of any part of its design can be compared with
        it.</${Empty}>`}
  </${Card}>`;
}

function OneScan({ row, run, runs, onRun, onChange, onGone }) {
  const way = `/scans/${part(row.scan)}`;
  const needs = useGet(`${way}/said`);
  const readable = needs.value?.problem === "";
  const volume = useGet(readable && way);
  const [saying, setSaying] = useState(false);
  const uploaded = row.scan.startsWith("file~");
  const said = () => { setSaying(false); needs.reload(); volume.reload(); };
  const text = "The scan goes; what was found with it stays in the runs.";
  const ask = { title: `Delete ${plain(row.scan)}?`, text, yes: "Delete", danger: true };
  const drop = async () => { await send("DELETE", way); onGone(); };
  const tools = uploaded && html`
    ${readable && html`<${Button} onClick=${() => setSaying(!saying)} aria-expanded=${String(saying)}>
      Correct what is known</${Button}>`}
    <${Act} ask=${ask} work=${drop}>Delete</${Act}>`;
  return html`<div class="stack">
    <${Card} title=${plain(row.scan)} tools=${tools}>
      <${Loaded} of=${needs} what="Reading the scan">${(it) => (it.problem
        ? html`<${Missing} key=${it.missing.join()} scan=${row.scan} needs=${it} uploaded=${uploaded} onSaid=${said} />`
        : html`<${Loaded} of=${volume} what="Reading the scan">${(known) => html`<${Known} it=${known} />`}</${Loaded}>`
      )}</${Loaded}>
      ${saying && readable && html`<${Metadata} scan=${row.scan} needs=${needs.value} onSaid=${said} />`}
    </${Card}>
    ${readable && volume.value && html`<${Compare} row=${row} run=${run} runs=${runs} volume=${volume.value}
      onRun=${onRun} onChange=${onChange} />`}
  </div>`;
}

function Known({ it }) {
  const times = (values, digits) => values.map((one) => number(one, digits)).join(" × ");
  return html`<${Tiles} rows=${[
    ["Size (x, y, z)", `${times(it.size_mm, 3)} mm`],
    ["Voxels", times(it.shape, 6)],
    ["Voxel size", `${times(it.voxel_um, 4)} µm`],
    ["Scanned by", MODALITIES[it.modality] ?? it.modality],
    it.modality === "oct" && ["Depth", `grows ${it.depth_down ? "down" : "up"}, index ${number(it.refractive_index)}`],
    it.scale === "db" && ["Intensity", "dB"],
  ]} />
    ${it.notes.map((text) => html`<p class="hint">Note: ${text}.</p>`)}`;
}

// Compare a scan with a design, follow that, and show what was found.
function Compare({ row, run, runs, volume, onRun, onChange }) {
  const names = runs.map((one) => one.name);
  const chosen = [run, ...row.registered, names[0]].find((one) => names.includes(one)) ?? "";
  const own = row.scan === `run~${chosen}`;
  const way = `/scans/${part(row.scan)}/with/${part(chosen)}`;
  const works = own ? `/runs/${part(chosen)}` : way;
  const progress = useGet(chosen && `${works}/progress`, { every: FOLLOWED_MS });
  const files = useGet(chosen && `${way}/files`);
  const measured = files.value?.includes("registration.json");
  const found = useGet(measured && `${way}/findings`);
  const [filled, setFilled] = useState(false);
  const [tab, setTab] = useState("");
  const going = isGoing(progress.value);
  useEnd(going, () => {
    found.reload();
    files.reload();
    onChange();
  });
  const result = measured && !going ? found.value : null;
  const report = `/scan?scan=${part(row.scan)}&run=${part(chosen)}&view=report`;
  const vessels = result && `Vessels (${result.vessels.length})`;
  const tabs = [
    result && { id: "result", name: "Result", body: () => html`<${Findings} found=${result} report=${report} />` },
    result && { id: "vessels", name: vessels, body: () => html`<${Vessels} rows=${result.vessels} />` },
    { id: "slices", name: "Slices", body: () => html`<${Slices} scan=${row.scan} volume=${volume} />` },
    result && { id: "files", name: "Files", body: () => html`<${Files} way=${way} words=${WHAT} />` },
  ].filter(Boolean);
  const stages = html`<${Stages} of=${progress.value} />`;
  const words = own ? "Judge it again" : result ? "Register again" : "Register";
  return html`
    <${Card} title="Compare with the design" fold=${result ? "scan.compare" : undefined} folded>
      ${!names.length ? html`<${Empty}>There is no design yet to compare it with. Make one on the
          <a href="/">home page</a>.</${Empty}>` : html`
        <div class="row row-end scan-row">
          <${Field} kind="choice" label="Design (run)" value=${chosen} options=${names} onChange=${onRun} />
          ${!own && !going && html`<${Field} kind="flag" label="Lumens are bright (filled with contrast agent)"
            value=${filled} onChange=${setFilled} />`}
          ${going ? html`<${Act} post=${`${works}/cancel`} work=${progress.reload}>Cancel</${Act}>`
            : html`<${Act} kind=${result ? "quiet" : "main"} post=${`${works}/${own ? "continue" : "start"}`}
              body=${own ? undefined : { filled }} work=${progress.reload}>${words}</${Act}>`}
        </div>
        ${own && html`<p class="hint">This scan is the run's own: judging it continues the run.</p>`}
        ${going && stages}`}
    </${Card}>
    ${["failed", "interrupted"].includes(progress.value?.state) && stages}
    <${Card}>
      <${Tabs} label="What is shown of the scan" tabs=${tabs} at=${tab || tabs[0].id} onChange=${setTab} />
    </${Card}>`;
}

const WHAT = {
  "report.json": "the report's figures",
  "report.pdf": "the report, to print",
  "registration.json": "pose, scales and intervals",
  "vessels.csv": "a line for each vessel",
  "sections.csv": "a line for each section of a vessel",
  "defects.csv": "leaks and bridges",
  "deviation.ply": "the surface with its deviation, for MeshLab",
  "deviation.vtp": "the same, for ParaView",
  "sections.vtp": "sections, for ParaView",
  "scan_in_part.nrrd": "the scan in the part's frame, for 3D Slicer",
};
