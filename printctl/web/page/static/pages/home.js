// Where everybody begins: what goes on, what was begun, and what one can begin with.
import { part, send } from "../api.js";
import { progressOf } from "../header.js";
import {
  Act, Ask, Badge, Button, Card, Drop, Empty, Fields, Links, Loaded, Note, Page, go, html, nameOf, number, span, useFew, useGet,
  useNews, useState, when,
} from "../ui.js";

const NEXT = {
  shape: ["Shape it", "info"], check: ["Look at the checks", "warn"], print: ["Print or rehearse", "info"],
  judge: ["Scan and judge", "info"], done: ["Judged", "good"],
};
const LISTED = 4;

export default function Home() {
  const projects = useGet("/projects");
  return html`<${Page} title="From a shape to a judged print">
    <${Running} />
    <${Loaded} of=${projects} what="Looking for projects">${(rows) => html`
      ${rows.length > 0 && html`<${Projects} rows=${rows} />`}
      <${Gallery} taken=${rows.map((one) => one.name)} first=${!rows.length} />`}</${Loaded}>
    <${Bring} />
  </${Page}>`;
}

function Running() {
  const print = useNews("print");
  if (!print?.state || print.ended) return null;
  return html`<${Note} tone="info"><p>
    <b>${nameOf(print.job)}</b> is on the printer: ${progressOf(print).filter(Boolean).join(", ")}.</p>
    <${Button} kind="main" href=${`/job?job=${part(print.job)}`}>See the print</${Button}></${Note}>`;
}

function Projects({ rows }) {
  const [few, more] = useFew(rows, LISTED);
  return html`<${Card} title="Go on with">
    <${Links} rows=${few.map(({ name, step, modified }) => ({
      href: `/project?name=${part(name)}`, name, about: when(modified),
      badge: html`<${Badge} tone=${NEXT[step][1]}>${NEXT[step][0]}</${Badge}>`,
    }))} />
    ${more}
  </${Card}>`;
}

function Gallery({ taken, first }) {
  const entries = useGet("/gallery");
  return html`<section class="stack" aria-labelledby="gallery">
    <h2 id="gallery">${first ? "Begin with one of these" : "Begin a new one"}</h2>
    ${first && html`<p class="quiet">Choose, shape, check, rehearse on a simulated printer, judge by a simulated scan:
      a few minutes, and nothing needs to be connected.</p>`}
    <${Loaded} of=${entries}>${(list) => list.length ? html`
      <ul class="gallery">${list.map((one) => html`<${Entry} key=${one.example} one=${one} taken=${taken} />`)}</ul>`
      : html`<${Empty}>The examples aren't installed here. <a href="/design">Write a recipe on the Design page.</a></${Empty}>`}</${Loaded}>
  </section>`;
}

const free = (name, taken) => {
  let made = name;
  for (let k = 2; taken.includes(made); k += 1) made = `${name}_${k}`;
  return made;
};

function Entry({ one, taken }) {
  const start = async () => {
    const name = free(one.example, taken);
    await send("POST", "/recipes", { name, source: one.example });
    go(`/project?name=${part(name)}`);
  };
  return html`<li class="card gallery-entry">
    <img src=${new URL(`../pictures/${one.example}.webp`, import.meta.url).href} alt="" width="480" height="300" loading="lazy" />
    <h3>${one.title}</h3>
    <p>${one.shows}</p>
    <p class="quiet">${one.size} · prints in ${span(60 * one.print_min)}</p>
    <${Act} kind="main" work=${start} aria-label=${`Start from ${one.title}`}>Start from this</${Act}>
  </li>`;
}

const SHAPES = ".stl,.obj,.ply,.3mf";
const NETWORKS = ".csv,.vtp,.swc,.json,.npz,.txt";

function Bring() {
  const [file, setFile] = useState(null);
  return html`<${Card} title="Or bring your own">
    <div class="columns">
      <div class="stack"><h3>A shape to fill with vessels, or a network to print</h3>
        <p class="quiet">A closed mesh (STL, OBJ, PLY, 3MF), or vessels (CSV, VTP, SWC, JSON, NPZ).</p>
        <${Drop} label="Choose a file" accept=${`${SHAPES},${NETWORKS}`} path="/recipes/files" onDone=${(name) => setFile(name)} /></div>
      <div class="stack"><h3>G-code to print</h3>
        <p class="quiet">It is dry-run and checked before anything moves.</p>
        <${Drop} label="Choose G-code" accept=".gcode,.gco,.g,.nc" path="/jobs" onDone=${(job) => go(`/job?job=${part(job.id)}`)} /></div>
    </div>
    ${file && html`<${FromFile} file=${file} onClose=${() => setFile(null)} />`}
  </${Card}>`;
}

const UNITS = [["", "choose"], ["mm", "millimetres"], ["cm", "centimetres"], ["m", "metres"], ["um", "micrometres"],
  ["in", "inches"]];
const MM_PER = { mm: 1, cm: 10, m: 1000, um: 1e-3, in: 25.4 };
const INLETS = [["face", "inside a face, clear of its edges"], ["top", "at the highest place"], ["each_part", "one for each separate part"]];

function FromFile({ file, onClose }) {
  const mesh = SHAPES.split(",").some((one) => file.toLowerCase().endsWith(one));
  const asks = !/\.(3mf|json|npz)$/i.test(file);
  const [said, setSaid] = useState({
    name: file.replace(/\.[^.]*$/, "").slice(0, 60), unit: /\.txt$/i.test(file) ? "cm" : asks ? "" : "mm",
    ...(mesh && { needle: "30g_50mm", inlet: "face", smallest_diameter_mm: null }),
  });
  const found = useGet(mesh ? `/recipes/files/${part(file)}/size` : null);
  const choices = useGet(mesh ? "/recipes/choices" : null);
  const size = found.value?.size.map((one) => number(one * (asks ? MM_PER[said.unit] : 1), 3)).join(" × ");
  const make = async () => {
    await send("POST", "/projects", { ...said, file });
    go(`/project?name=${part(said.name)}`);
  };
  return html`<${Ask} title=${`Begin with ${file}`} yes="Begin" work=${make} onClose=${onClose}
      why=${said.unit ? "" : "choose the unit first"}>
    <${Fields} of=${said} onChange=${setSaid} fields=${[
      { name: "name", label: "Name of the project" },
      asks && { name: "unit", label: "Unit of the file", kind: "choice", options: UNITS,
        hint: "Never guessed: the file doesn't say it." },
      mesh && { name: "needle", label: "Needle", kind: "choice",
        options: Object.entries(choices.value?.profiles.needles ?? { [said.needle]: said.needle }) },
      mesh && { name: "smallest_diameter_mm", label: "Smallest vessel", kind: "number", unit: "mm", min: 0.01, max: 20,
        hint: "Left empty: the narrowest that the needle prints" },
      mesh && { name: "inlet", label: "Where the vessels enter", kind: "choice", options: INLETS,
        hint: "An exact place is picked later, under All settings." },
    ]} />
    ${size && (said.unit || !asks) && html`<p role="status">The shape is ${size} mm large.</p>`}
    <p class="quiet">${mesh ? "A tree of vessels is grown in it; you shape it next."
      : "Its vessels are printed as they are."}</p>
  </${Ask}>`;
}
