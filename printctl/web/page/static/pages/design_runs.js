// What runs have made: their pages, figures and files, and two of them beside each other.
import { part } from "../api.js";
import { Frame } from "../frame.js";
import { Files, Pages } from "../runs.js";
import { Empty, Facts, Field, Loaded, Table, html, number, useEffect, useGet, useRef, useState } from "../ui.js";

const VIEWS = [
  ["network", "Network in 3D"], ["layers", "Layers and passes"], ["dry_run", "Dry run"], ["report", "Report"],
];

// [the run that is looked at, its choice]: the recipe's own, or else the newest, until another is chosen.
function useRun({ names, first }) {
  const [name, setName] = useState("");
  const run = names.includes(name) ? name : names.includes(first) ? first : names[0] ?? "";
  return [run, run ? html`<${Field} kind="choice" label="Run" value=${run} onChange=${setName} options=${names} />`
    : html`<${Empty}>Nothing is made yet: make a recipe's design first.</${Empty}>`];
}

export function Look(props) {
  const [run, choice] = useRun(props);
  return run ? html`<${Pages} run=${run} views=${VIEWS}>${choice}</${Pages}>` : choice;
}

function shown({ value, unit }) {
  const text = typeof value === "number" ? number(value, Number.isInteger(value) ? 12 : 4) : value;
  return `${text} ${unit}`.trim();
}

export function Figures(props) {
  const [run, choice] = useRun(props);
  const figures = useGet(run && `/runs/${part(run)}/figures`);
  return html`<div class="row">${choice}</div>
    ${run && html`<${Loaded} of=${figures}>${(rows) => html`<div class="design-figures">
      <${Facts} rows=${rows.map((one) => [one.name, shown(one)])} />
      ${!rows.length && html`<${Empty}>No stage has said a figure yet.</${Empty}>`}</div>`}</${Loaded}>
    <h3>Files</h3>
    <${Files} key=${run} way=${`/runs/${part(run)}`} />`}`;
}

export function Compare({ names, first }) {
  const [one, setOne] = useState("");
  const [other, setOther] = useState("");
  const left = one || (names.includes(first) ? first : names[0]);
  const pair = [left, other || names.find((name) => name !== left)];
  const differ = names.length > 1 && pair[0] !== pair[1];
  const found = useGet(differ && `/runs/compare?${new URLSearchParams({ one: pair[0], other: pair[1] })}`);
  if (names.length < 2) return html`<${Empty}>Two runs are needed: make the designs of two recipes first.</${Empty}>`;
  const choice = (label, value, set) => html`
    <${Field} kind="choice" label=${label} value=${value} onChange=${set} options=${names} />`;
  return html`<div class="columns">${choice("One run", pair[0], setOne)}${choice("The other", pair[1], setOther)}</div>
    ${!differ ? html`<${Empty}>Choose two different runs.</${Empty}>` : html`<${Linked} names=${pair} />
      <${Loaded} of=${found}>${(rows) => html`
        <${Differences} title="Key figures" what="Figure" rows=${rows.figures} names=${pair} />
        <${Differences} title="What the recipes say otherwise" what="Key" rows=${rows.recipe} names=${pair} />`}
      </${Loaded}>`}`;
}

function Differences({ title, what, rows, names }) {
  const numbers = ["one", "other", "change"].map((key, k) =>
    ({ name: [...names, "Change"][k], number: true, of: (row) => row[key] }));
  return html`<h3>${title}</h3>${rows.length
    ? html`<${Table} caption=${title} columns=${[{ name: what, of: (row) => row.name }, ...numbers]} rows=${rows} />`
    : html`<${Empty}>Nothing.</${Empty}>`}`;
}

// Networks beside each other, seen from the same side (viewer/stage.js).
function Linked({ names }) {
  const box = useRef(null);
  useEffect(() => {
    const turn = ({ data, source }) => {
      const frames = [...box.current.querySelectorAll("iframe")].map((frame) => frame.contentWindow);
      if (data?.printctl !== "view" || !frames.includes(source)) return;
      const message = { printctl: "view", view: data.view };
      frames.filter((frame) => frame !== source).forEach((frame) => frame.postMessage(message, "*"));
    };
    window.addEventListener("message", turn);
    return () => window.removeEventListener("message", turn);
  }, []);
  return html`<div class="columns" ref=${box}>${names.map((name) => html`<div key=${name}><h3>${name}</h3>
    <${Frame} src=${`/runs/${part(name)}/pages/network`} title=${`Network of ${name}`} tall=${false} /></div>`)}</div>`;
}
