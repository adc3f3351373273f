// One past print: what it was, how it went, what the scan says, its record, and how to print it again.
import { get, part, send, url } from "../api.js";
import {
  Act, Badge, Button, Card, Empty, Facts, Fold, Loaded, Note, Page, Table, html, useGet, useState, when,
} from "../ui.js";
import { madeRows, nameOf, notedLines, notedValues, stateOf, took } from "./history_words.js";

const TONES = { pass: "good", fail: "bad", undecided: "warn" };
const VERDICTS = { pass: "Passed", fail: "Not passed", undecided: "Undecided: neither pass nor fail is proven" };
const run = (print) => (print.job.startsWith("run~") ? print.job.slice(4) : "");

const ENDS = { done: "good", running: "info", stopped: "warn" };
export const End = ({ state }) => html`<${Badge} tone=${ENDS[state] ?? "bad"}>${stateOf(state)}</${Badge}>`;
const listed = (texts) => html`<ul class="history-plain">${texts.map((text) => html`<li>${text}</li>`)}</ul>`;

export default function OnePrint({ id }) {
  const found = useGet(`/history/${part(id)}`, { every: 10_000 });
  const name = found.value ? nameOf(found.value.print) : "Print";
  const tools = html`<${Button} href="/history">All prints</${Button}>`;
  return html`<${Page} title=${name} tools=${tools}>
    <${Loaded} of=${found} what="Looking for all there is of it">${(it) => html`
      <div class="history-cards">
        <div class="stack"><${Printed} it=${it} /><${Filing} it=${it} /></div>
        <div class="stack"><${Judged} it=${it} /><${Again} it=${it} /></div>
        <${Noted} note=${it.note} />
      </div>
      <${Photos} it=${it} />
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
      ["Took", print.ended ? took(print.ended - print.started) : ""],
      ...madeRows(it.progress),
      ["Held", it.held_s >= 1 ? took(it.held_s) : ""],
      ["Alarms", print.alarms.length ? listed(print.alarms.map((one) => one.text)) : ""],
      ["Printer", print.profile],
      ["Operator", print.operator || print.who],
      ["Design", run(print) && html`<a href=${`/project?name=${run(print)}`}>${run(print)}</a>`],
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
  const scan = run(it.print) && `/scan?run=${run(it.print)}`;
  if (!it.verdict && !it.report.length) {
    return html`<${Card} title="Is it right?">
      <${Empty}>No scan of this print was compared with its design. Scan the part, then drop the scan on the Scan
        page.</${Empty}>
      ${scan && html`<div class="row">
        <${Button} kind=${it.print.state === "done" ? "main" : "quiet"} href=${scan}>Go to the scan</${Button}></div>`}
    </${Card}>`;
  }
  return html`<${Card} title="Is it right?">
    ${it.verdict && html`<p><${Badge} tone=${TONES[it.verdict]}>${VERDICTS[it.verdict]}</${Badge}></p>`}
    ${it.reasons.length > 0 && listed(it.reasons)}
    <div class="row">
      ${it.report.includes("report.html") && html`
        <${Button} href=${url(address)} target="_blank" rel="noopener">Open the report</${Button}>`}
      ${it.report.includes("report.pdf") && html`
        <${Button} href=${url(`${address}?kind=pdf`)} download>Report as PDF</${Button}>`}
      ${scan && html`<${Button} href=${scan}>Go to the scan</${Button}>`}
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
    ${!plan && html`
      <p>The same G-code, byte for byte, as a new job. What isn't as it was then is listed first; you start the print
        yourself.</p>
      <${Act} why=${it.gcode_there ? "" : it.missing[0]} work=${look}>Compare with today</${Act}>`}
    ${!it.gcode_there && html`<${Empty}>Not possible here: ${it.missing[0]}.</${Empty}>`}
    ${plan && html`<p>The G-code is the one that was printed (its SHA-256 agrees).</p>
      <ul class="history-plain">
        ${plan.differences.length === 0 && html`<li>Nothing that is known differs.</li>`}
        ${plan.differences.map((one) => html`<li>${one.what}: was ${one.then}, is ${one.now}</li>`)}
        ${plan.unknown.map((text) => html`<li class="quiet">Not known: ${text}.</li>`)}
      </ul>`}
    ${plan && !job && html`<${Act} kind="main" work=${make}>Make the job</${Act}>`}
    ${job && html`<${Note} tone="good"><p role="status">Job ${job.replace(/^file~/, "")} is ready.</p>
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

function Noted({ note }) {
  const rows = notedValues(note);
  const lists = [["Steps after the print", notedLines(note, "steps")], ["Notes", notedLines(note, "notes")]];
  if (!rows.length && !lists.some(([, lines]) => lines.length)) return null;
  return html`<${Card} title="What the operator noted">
    <${Facts} rows=${rows} />
    ${lists.map(([name, lines]) => lines.length > 0 && html`<h3>${name}</h3>
      <ul class="history-plain history-line">${lines.map((line) => html`<li>${line}</li>`)}</ul>`)}
  </${Card}>`;
}

function Photos({ it }) {
  if (!it.photos.length) return null;
  return html`<${Card} title="Photos"><div class="row">${it.photos.map((name) => {
    const address = url(`/history/${part(it.print.id)}/photos/${part(name)}`);
    return html`<a href=${address} target="_blank" rel="noopener">
      <img class="history-photo" src=${address} alt=${`Photo ${name}`} loading="lazy" /></a>`;
  })}</div></${Card}>`;
}

function Happened({ it }) {
  if (!it.events.length) return null;
  const kind = (name) => (["alarm", "damaged"].includes(name) ? html`<${Badge} tone="bad">${name}</${Badge}>` : name);
  const columns = [
    { name: "Clock", of: (one) => (one.at ? new Date(1000 * one.at).toLocaleTimeString() : "") },
    { name: "After", of: (one) => took(one.after_s) },
    { name: "What", of: (one) => kind(one.kind) },
    { name: "Said", of: (one) => one.text },
  ];
  return html`<${Card} title="What happened">
    <${Strip} states=${it.states} />
    <div class="history-events"><${Table} caption="Events of the print" columns=${columns} rows=${it.events} /></div>
    ${it.more_events > 0 && html`<p class="quiet">${it.more_events} more events are in the journal.</p>`}
  </${Card}>`;
}

// The states that it went through, drawn to scale.
function Strip({ states }) {
  const sums = new Map();
  for (const one of states) sums.set(one.state, (sums.get(one.state) ?? 0) + one.end_s - one.start_s);
  const whole = [...sums.values()].reduce((sum, one) => sum + one, 0);
  if (whole <= 0) return null;
  const words = [...sums].map(([state, seconds]) => [state, `${state} ${took(seconds)}`]);
  const label = `Times in each state: ${words.map(([, text]) => text).join(", ")}`;
  return html`<div class="stack">
    <div class="history-strip" role="img" aria-label=${label}>${states.map((one) => html`
      <i data-state=${one.state} style=${{ flexGrow: (one.end_s - one.start_s) / whole }}></i>`)}</div>
    <div class="row">${words.map(([state, text]) => html`
      <span class="history-key"><i data-state=${state}></i>${text}</span>`)}</div>
  </div>`;
}
