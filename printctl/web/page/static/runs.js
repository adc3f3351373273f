// Runs of designs: what is being made, how far it is, and the pages and files that came of it.
import { part, url } from "./api.js";
import { Frame } from "./frame.js";
import {
  Button, Empty, Loaded, Note, Progress, Segments, html, number, span, useGet, useState, useTheme,
} from "./ui.js";

const MARKS = { waiting: "·", running: "▸", done: "✓", failed: "✕" };
const ENDS = { failed: ["bad", "It failed."], interrupted: ["warn", "It was broken off."] };

export const isGoing = (progress) => ["starting", "running"].includes(progress?.state);

// How far a print came, beside it and in the history; pauses aren't printing.
export const madeRows = (progress) => (progress ? [
  ["Printing time", `${span(progress.active_s)} (expected ${span(progress.predicted_s)})`],
  ["Ink", `${number(progress.ink_ul)} of ${number(progress.ink_total_ul)} µL`],
  progress.layers > 0 && [progress.passes ? "Passes" : "Layers", `${progress.layers_done} of ${progress.layers}`],
  progress.vessels > 0 && ["Vessels", `${progress.vessels_done} of ${progress.vessels}`],
] : []);

// How far it is, stage by stage, and how it failed.
export function Stages({ of: progress }) {
  const [tone, end] = ENDS[progress?.state] ?? [];
  if (!progress?.stages.length && !end) return isGoing(progress) && html`<${Progress} label="Starting" />`;
  return html`
    ${end && html`<${Note} tone=${tone}><p class="lines"><strong>${end}</strong> ${progress.message}</p></${Note}>`}
    <ol class="stages">${progress.stages.map(({ name, state, fraction, note, remarks }) => html`
      <li key=${name} class=${`stage stage-${state}`}>
        <span><span aria-hidden="true">${MARKS[state]}</span> ${name}</span>
        <${Progress} share=${fraction} label=${name} />
        <span class="quiet">${state === "waiting" ? "" : note || state}</span>
        ${remarks?.map((remark) => html`<p class="hint" key=${remark}>${remark}</p>`)}</li>`)}</ol>`;
}

// One of the pages of a run, each [id, name], chosen by `tools` beside other choices.
export function Pages({ run, views, children }) {
  const [view, setView] = useState(views[0][0]);
  const theme = useTheme();
  const address = `/runs/${part(run)}/pages/${view}`;
  return html`<div class="row row-end">${children}
      <${Segments} label="View" options=${views} value=${view} onChange=${setView} />
      <${Button} href=${`${url(address)}?theme=${theme}`} target="_blank" rel="noopener">
        Open in a tab of its own</${Button}></div>
    <${Frame} key=${address} src=${address} title=${`${Object.fromEntries(views)[view]} of ${run}`} />`;
}

// Files to fetch, below `way`, with what each is.
export function Files({ way, words = {} }) {
  const files = useGet(`${way}/files`);
  return html`<${Loaded} of=${files}>${(names) => (names.length ? html`<ul class="files">${names.map((name) => html`
    <li key=${name}><a href=${url(`${way}/files/${part(name)}`)} download>${name}</a>
      ${words[name] && html`<span class="quiet"> ${words[name]}</span>`}</li>`)}</ul>`
    : html`<${Empty}>No files yet.</${Empty}>`)}</${Loaded}>`;
}
