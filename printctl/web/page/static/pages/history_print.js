// One past print: what it was, how it went, what the scan says, its record, and how to print it again.
import { get, part, send, url } from "../api.js";
import {
  Act, Badge, Bullets, Button, Card, Empty, Facts, Fold, Loaded, Note, Page, Photos, Table, Verdict,
  html, nameOf, runOf, span, stateOf, useGet, useState, when,
} from "../ui.js";
import { RECORD } from "../record.js";
import { madeRows } from "../runs.js";

// A print is known by its design; G-code that was brought by its file.
export const titleOf = (print) => nameOf(print.job) || print.file || "(no name)";

const ENDS = { done: "good", running: "info", stopped: "warn" };
export const End = ({ state }) => html`<${Badge} tone=${ENDS[state] ?? "bad"}>${stateOf(state)}</${Badge}>`;

export default function OnePrint({ id }) {
  const found = useGet(`/history/${part(id)}`, { every: 10_000 });
  const name = found.value ? titleOf(found.value.print) : "Print";
  const tools = html`<${Button} href="/history">All prints</${Button}>`;
  return html`<${Page} title=${name} tools=${tools}>
    <${Loaded} of=${found} what="Looking for all there is of it">${(it) => html`
      <div class="history-cards">
        <div class="stack"><${Printed} it=${it} /><${Filing} it=${it} /></div>
        <div class="stack"><${Judged} it=${it} /><${Again} it=${it} /></div>
        <${Noted} note=${it.note} />
      </div>
      ${it.photos.length > 0 && html`<${Card} title="Photos"><${Photos} rows=${it.photos.map((one) => ({
        href: url(`/history/${part(id)}/photos/${part(one)}`), alt: `Photo ${one}` }))} /></${Card}>`}
      <${Happened} it=${it} />`}</${Loaded}>
  </${Page}>`;
}

function Printed({ it }) {
  const { print } = it;
  return html`<${Card} title="What was printed">
    <${Facts} rows=${[
      ["End", html`<${End} state=${print.state} />`],
      ["Why", print.state === "done" ? "" : print.message],
      ["Begun", when(print.started)],
      ["Over", print.ended ? when(print.ended) : ""],
      ["Took", print.ended ? span(print.ended - print.started) : ""],
      ...madeRows(it.progress),
      ["Held", it.held_s >= 1 ? span(it.held_s) : ""],
      ["Alarms", print.alarms.length ? html`<${Bullets} rows=${print.alarms.map((one) => one.text)} />` : ""],
      ["Printer", print.profile],
      ["Operator", print.operator || print.who],
      ["Design", runOf(print.job) && html`<a href=${`/project?name=${runOf(print.job)}`}>${runOf(print.job)}</a>`],
    ]} />
    <${Fold} title="File, port, computer, hash"><${Facts} rows=${[
      ["File", print.file],
      ["Lines", `${print.done} of ${print.total}`],
      ["Gone on with", print.begun > 1 ? `${print.begun - 1} times` : ""],
      ["Port", print.port],
      ["Computer", `${print.who} at ${print.host}`],
      ["Id", html`<code>${print.id}</code>`],
      ["SHA-256", html`<code>${print.sha256}</code>`],
    ]} /></${Fold}>
  </${Card}>`;
}

function Judged({ it }) {
  const address = `/history/${part(it.print.id)}/report`;
  const run = runOf(it.print.job);
  const open = !it.verdict && !it.report.length;
  return html`<${Card} title="Is it right?">
    ${open ? html`<${Empty}>No scan of this print was compared with its design. Scan the part, then drop the scan on the
        Scan page.</${Empty}>` : html`
      ${it.verdict && html`<${Verdict} outcome=${it.verdict} />`}
      <${Bullets} rows=${it.reasons} />`}
    <div class="row">
      ${it.report.includes("report.html") && html`
        <${Button} href=${url(address)} target="_blank" rel="noopener">Open the report</${Button}>`}
      ${it.report.includes("report.pdf") && html`
        <${Button} href=${url(`${address}?kind=pdf`)} download>Report as PDF</${Button}>`}
      ${run && html`<${Button} kind=${open && it.print.state === "done" ? "main" : "quiet"} href=${`/scan?run=${run}`}>
        Go to the scan</${Button}>`}
    </div>
  </${Card}>`;
}

function Again({ it }) {
  const [plan, setPlan] = useState(null);
  const [job, setJob] = useState("");
  const way = `/history/${part(it.print.id)}/repeat`;
  const look = async () => setPlan(await get(way));
  const make = async () => setJob((await send("POST", way)).job);
  return html`<${Card} title="Print it again">
    ${!it.gcode_there && html`<${Empty}>Not possible here: ${it.missing[0]}.</${Empty}>`}
    ${!plan ? html`
      <p>The same G-code, byte for byte, as a new job. What isn't as it was then is listed first; you start the print
        yourself.</p>
      <${Act} why=${it.gcode_there ? "" : it.missing[0]} work=${look}>Compare with today</${Act}>` : html`
      <p>The G-code is the one that was printed (its SHA-256 agrees).</p>
      <${Bullets} rows=${[
        ...(plan.differences.length ? [] : ["Nothing that is known differs."]),
        ...plan.differences.map((one) => `${one.what}: was ${one.then}, is ${one.now}`),
        ...plan.unknown.map((text) => html`<span class="quiet">Not known: ${text}.</span>`),
      ]} />`}
    ${plan && !job && html`<${Act} kind="main" work=${make}>Make the job</${Act}>`}
    ${job && html`<${Note} tone="good"><p role="status">Job ${nameOf(job)} is ready.</p>
      <${Button} kind="main" href=${`/job?job=${part(job)}`}>Go to the job</${Button}></${Note}>`}
  </${Card}>`;
}

function Filing({ it }) {
  const running = it.print.state === "running";
  return html`<${Card} title="File the record">
    <p>Journal, G-code, recipe, profiles, checks, notes and report in one zip that this lab's key signs: any change to
      it is found.</p>
    ${running ? html`<${Empty}>The print is still going on.</${Empty}>`
      : !it.journal_there ? html`<${Empty}>The journal isn't there any more: nothing can be filed.</${Empty}>`
        : html`<div class="row">
            <${Button} href=${url(`/history/${part(it.print.id)}/bundle`)} download>Download the record</${Button}>
            <${Button} href=${url("/history/key")} download>Lab's key</${Button}></div>`}
    ${it.missing.map((text) => html`<p class="quiet">Not in it: ${text}.</p>`)}
  </${Card}>`;
}

function Happened({ it }) {
  if (!it.events.length) return null;
  const kind = (name) => (["alarm", "damaged"].includes(name) ? html`<${Badge} tone="bad">${name}</${Badge}>` : name);
  const columns = [
    { name: "Clock", of: (one) => (one.at ? new Date(1000 * one.at).toLocaleTimeString() : "") },
    { name: "After", of: (one) => span(one.after_s) },
    { name: "What", of: (one) => kind(one.kind) },
    { name: "Said", of: (one) => one.text },
  ];
  return html`<${Card} title="What happened">
    <${Strip} states=${it.states} />
    <div class="history-events">
      <${Table} caption="Events of the print" columns=${columns} rows=${it.events} tall /></div>
    ${it.more_events > 0 && html`<p class="quiet">${it.more_events} more events are in the journal.</p>`}
  </${Card}>`;
}

// The states that it went through, drawn to scale.
function Strip({ states }) {
  const sums = new Map();
  for (const one of states) sums.set(one.state, (sums.get(one.state) ?? 0) + one.end_s - one.start_s);
  if (![...sums.values()].some((seconds) => seconds > 0)) return null;
  return html`<div class="history-strip" aria-hidden="true">${states.map((one) => html`
      <i data-state=${one.state} style=${{ flexGrow: 1000 * (one.end_s - one.start_s) }}></i>`)}</div>
    <ul class="row history-keys" aria-label="Times in each state">${[...sums].map(([state, seconds]) => html`
      <li key=${state}><i data-state=${state}></i>${state} ${span(seconds)}</li>`)}</ul>`;
}

const NAMES = {
  ...Object.fromEntries(RECORD.map(({ name, label, unit }) => [name, unit ? `${label} (${unit})` : label])),
  mixed_at: "Mixed", sterility: "Sterility", ticked: "Checklist",
};
const UNNAMED = ["text", "note", "step", "name"];
const isEmpty = (value) => [null, "", "{}", "[]"].includes(typeof value === "object" ? JSON.stringify(value) : value);

function textOf(key, value) {
  if (key === "ticked" && typeof value === "object") {
    const ticks = Object.values(value);
    return `${ticks.filter((one) => one === true).length} of ${ticks.length} points ticked before the start`;
  }
  if (typeof value !== "number") return typeof value === "object" ? JSON.stringify(value) : String(value);
  return key === "mixed_at" ? when(value) : value.toLocaleString([], { maximumFractionDigits: 6 });
}

// Names and values of a record; those that nobody filled in are left out.
const filled = (record) => Object.entries(record ?? {}).filter(([, value]) => !isEmpty(value));

// A step after the print, or a note: when, who, what.
function lineOf(entry) {
  if (!entry || typeof entry !== "object") return String(entry);
  const { at, who, ...rest } = entry;
  const words = filled(rest).map(([key, value]) => {
    if (typeof value === "boolean") return value ? `(${key})` : `(not ${key})`;
    return UNNAMED.includes(key) ? textOf(key, value) : `${key}: ${textOf(key, value)}`;
  });
  return [typeof at === "number" ? when(at) : "", who ?? "", ...words].filter(Boolean).join("  ");
}

function Noted({ note }) {
  const rows = filled(note.values).map(([key, value]) => [NAMES[key] ?? key.replaceAll("_", " "), textOf(key, value)]);
  const lists = [["Steps after the print", "steps"], ["Notes", "notes"]]
    .map(([name, list]) => [name, [note[list] ?? []].flat().slice(0, 500).map(lineOf)]);
  if (!rows.length && !lists.some(([, lines]) => lines.length)) return null;
  return html`<${Card} title="What the operator noted">
    <${Facts} rows=${rows} />
    ${lists.map(([name, lines]) => lines.length > 0 && html`<h3>${name}</h3>
      <div class="lines"><${Bullets} rows=${lines} /></div>`)}
  </${Card}>`;
}
