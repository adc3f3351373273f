// A print that goes on, on one screen: where it stands, what may be done, what is seen. And its end.
import { part, send } from "../api.js";
import {
  Act, Ask, Bullets, Button, Card, Field, Fields, Fold, Known, Loaded, Note, Progress, Tiles, go, html, number, sentence,
  span, useGet, useNews, useState,
} from "../ui.js";
import { HeldLook, LastLooks, useLooks } from "./job_looks.js";
import { Camera, LiveView } from "./job_views.js";

const path = (job, action) => `/prints/${part(job)}/${action}`;
const can = (print, action) => print.actions.find((one) => one.action === action) ?? { possible: false };
const clock = (at) => new Date(1000 * at).toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" });
const day = (at) => new Date(1000 * at).toDateString();

export default function Running({ job, print }) {
  const changing = can(print, "resume").needs === "syringe";
  const looks = useLooks(job, print);
  const asks = Boolean(looks.held?.waits);
  return html`<div class="job-run">
    <section class="stack job-now" aria-label="Print">
      <${State} print=${print} />
      <${Waits} job=${job} print=${print} look=${looks.held} />
      <${Alert} print=${print} look=${looks.held} />
      <${HeldLook} job=${job} print=${print} looks=${looks} />
      ${changing && html`<${NewSyringe} job=${job} />`}
      <${Actions} job=${job} print=${print} changing=${changing} asks=${asks} />
      <${Now} job=${job} print=${print} />
      <${LastLooks} job=${job} looks=${looks.all} />
    </section>
    <${LiveView} key=${print.print_id} job=${job} print=${print} />
    <${Camera} job=${job} print=${print} />
  </div>`;
}

// How a print ended, what is to be decided, what was written.
export function Ending({ job, print, reload }) {
  const [drawn, setDrawn] = useState(false);
  return html`<${Card} aria-label="How it ended">
    <${State} print=${print} />
    <${Alert} print=${print} />
    <div class="row">
      <${BrokeOff} job=${job} print=${print} reload=${reload} />
      <${Button} aria-expanded=${String(drawn)} onClick=${() => setDrawn(!drawn)}>What was written</${Button}>
      ${print.words.tip && html`<span class="hint">Tip: ${print.words.tip}</span>`}
    </div>
    ${drawn && html`<div class="job-written"><${LiveView} job=${job} print=${print} /></div>`}
  </${Card}>`;
}

function State({ print }) {
  return html`<div class="job-state">
    <h2 class="big">${print.words.state}</h2>
    <p class="unseen" role="status">${print.words.state.split(" · ")[0]}</p>
    ${!print.ended && html`<${Progress} share=${print.share} label="Share of the print made" />`}
  </div>`;
}

// What a print waits for, and within what time somebody must confirm.
function Waits({ job, print, look }) {
  const held = ["paused", "pausing", "looking", "resuming"].includes(print.state);
  const left = print.deadman_left_s;
  const waits = print.waits_for.startsWith("syringe") ? "" : print.waits_for; // its form says so
  const known = print.alert?.detail;
  const same = known && (known.includes(print.message) || print.message.includes(known));
  const says = held && !look && !print.waits_for && !same;
  if (!waits && left === null && !says) return null;
  return html`<${Note} tone=${held || waits ? "warn" : "info"}>
    <div class="row">
      ${waits && html`<span role="status">Waits for: ${waits}.</span>`}
      ${says && html`<span role="status">${sentence(print.message.split("; `printctl")[0])}.</span>`}
      ${left !== null && html`<span>Somebody must confirm within ${span(left)}.</span>
        <${Act} work=${() => send("POST", path(job, "alive"))}>I am here</${Act}>`}
    </div>
  </${Note}>`;
}

// What happened, what it means, what to do: once. Codes are one click away.
function Alert({ print, look }) {
  const { alert } = print;
  if (!alert || (look && alert.detail.includes("decided to"))) return null; // the look's card says it
  const more = !print.ended && print.alarms > 1 ? `${print.alarms} alarms, the last: ` : "";
  return html`<${Note} tone=${alert.tone}>
    <div class="job-alert">
      <p><strong>${more}${alert.what}.</strong>${" "}${alert.means}${" "}<em>${alert.remedy}</em></p>
      ${alert.detail && html`<${Fold} title="Details"><p class="mono">${alert.detail}</p></${Fold}>`}
    </div>
  </${Note}>`;
}

const CANCEL = {
  title: "Cancel the print?", yes: "Yes, cancel it", no: "No, go on", danger: true,
  text: "The move in flight ends, the plunger is relieved, the needle goes straight up. The print can't be "
    + "gone on with.",
};
const RESUME = { paused: "Resume", looking: "Go on without the observer" };

function Actions({ job, print, changing, asks }) {
  const does = (action, body) => () => send("POST", path(job, action), body);
  const pause = can(print, "pause").possible;
  const mayReload = ["printing", "paused", "looking"].includes(print.state);
  return html`<div class="row row-top job-actions" role="group" aria-label="What may be done">
    ${pause && html`<${Act} kind="main" work=${does("pause", { after: "now" })}>Pause now</${Act}>`}
    ${can(print, "resume").possible && !changing && html`
      <${Act} kind=${pause || asks ? "quiet" : "main"} work=${does("resume", {})}>
        ${RESUME[print.state] ?? "Don't pause after all"}</${Act}>`}
    ${pause && html`<${Act} work=${does("pause", { after: "layer" })}>Pause after layer</${Act}>`}
    ${print.state === "printing" && print.words.vessel && html`
      <${Act} work=${does("pause", { after: "vessel" })}>Pause after vessel</${Act}>`}
    ${mayReload && !changing && html`<${Act} work=${does("reload", {})}>Change syringe</${Act}>`}
    ${can(print, "stop").possible && html`<${Act} kind="danger" ask=${CANCEL} work=${does("cancel")}>
      Cancel print</${Act}>`}
  </div>`;
}

const PUT_IN = [
  { name: "plunger_mm", kind: "number", label: "Plunger travel used up", unit: "mm", min: 0, max: 1000,
    hint: "0 for a full syringe" },
  { name: "syringe", label: "Its profile", hint: "Only where it is of another kind" },
];

// What is asked after a change of syringe.
function NewSyringe({ job }) {
  const [put, setPut] = useState({ plunger_mm: 0, syringe: "" });
  const resume = (body) => () => send("POST", path(job, "resume"), body);
  return html`<${Card} title="What was put in?">
    <${Fields} fields=${PUT_IN} of=${put} onChange=${setPut} />
    <div class="row">
      <${Act} kind="main" work=${resume({ plunger_mm: put.plunger_mm ?? 0, syringe: put.syringe || null })}>
        Resume with this syringe</${Act}>
      <${Act} work=${resume({ unchanged: true })}>Resume, syringe unchanged</${Act}>
    </div>
  </${Card}>`;
}

function Now({ job, print }) {
  const station = useNews("station");
  const cells = useGet(path(job, "viability"), { every: 60_000, key: print.state }).value;
  const late = ["late", "close"].includes(cells?.state);
  return html`<div class="job-tiles"><${Tiles} rows=${[
    ["Time left", ...timeOf(print)],
    [print.progress?.passes ? "Pass" : "Layer", ...layerOf(print)],
    ["Ink", ...inkOf(print.progress)],
    ["Temperatures", heatOf(station), print.readings.join(", ")],
    ["Tip", html`<${Known} why=${print.words.tip ? "" : "the print hasn't said where it is"}>${print.words.tip}</${Known}>`],
    ["Alarms", print.alarms ? `${print.alarms}, see above` : "none",
      print.line_errors ? `${print.line_errors} lines sent again` : ""],
    cells && cells.minutes !== null && ["Cells", cells.words, "", late && "warn"],
  ]} /></div>`;
}

function timeOf({ progress, time_left_s: left }) {
  if (left === null || !progress) return ["not known yet"];
  const error = progress.remaining_error_s;
  const at = progress.ends_at;
  const until = day(at) === new Date().toDateString() ? clock(at) : `${clock(at)} on ${day(at).slice(0, 10)}`;
  return [span(left), `${error === null || error < 1 ? "" : `± ${span(error)}, `}until ${until}`];
}

// Where there is room for it; a phone shows what is needed to act.
const Rate = ({ value, unit }) => typeof value === "number" && html`<span class="job-rate">, ${number(value, 2)} ${unit}</span>`;

function layerOf({ progress, lines_executed: made, lines_total: all }) {
  if (!progress) return [`${made} of ${all} commands`];
  const { layer, layers, layers_done: whole, vessel, vessels, speed_mm_s: speed } = progress;
  const done = vessels ? `vessel ${vessel} of ${vessels}` : `${whole} whole`;
  return [`${layer} of ${layers}`, html`${done}<${Rate} value=${speed} unit="mm/s" />`];
}

function inkOf(progress) {
  if (!progress) return ["not known yet"];
  const { ink_left_ul: left, ink_ul: ink, ink_total_ul: all, flow_ul_s: flow } = progress;
  const written = html`${number(ink, 3)} of ${number(all, 3)} µL written<${Rate} value=${flow} unit="µL/s" />`;
  return left === null ? [html`<${Known} why="how full the syringe was isn't known" /> left`, written]
    : [`${left.toFixed(0)} µL left`, written];
}

function heatOf(station) {
  const why = station ? station.unknown.temperatures : "no printer is connected";
  if (why) return html`<${Known} why=${why} />`;
  const one = ({ name, now_c: now, target_c: target }) =>
    `${name}\u00a0${now.toFixed(1)}${target ? ` → ${number(target)}` : ""}\u00a0°C`;
  return html`<${Known}>${station.temperatures.map(one).join(", ")}</${Known}>`;
}

const GO_ON = {
  title: "Go on with the print?", yes: "Yes, go on",
  text: "Look first: the printer must have kept its power, and nobody may have moved the needle. "
    + "The printer is asked for its last line; where that or its position doesn't agree, nothing moves.",
};
const GIVE_UP = {
  title: "Give the print up?", yes: "Yes, give it up",
  text: "The end is written into the print's record. It can't be gone on with afterwards; the printer may be "
    + "connected again. Nothing is sent to the printer.",
};

function BrokeOff({ job, print, reload }) {
  const [asking, setAsking] = useState(false);
  const does = (action) => () => send("POST", path(job, action)).then(reload);
  const offered = (action) => can(print, action).possible;
  if (!["go_on", "recover", "give_up"].some(offered)) return null;
  return html`
    ${offered("go_on") && html`<${Act} kind="main" work=${does("go-on")} ask=${GO_ON}>Go on …</${Act}>`}
    ${offered("recover") && html`<${Button} onClick=${() => setAsking(true)}>Recover …</${Button}>`}
    ${offered("give_up") && html`<${Act} work=${does("give-up")} ask=${GIVE_UP}>Give up …</${Act}>`}
    ${asking && html`<${Recovery} job=${job} plan=${can(print, "recover")} onClose=${() => setAsking(false)} />`}
    ${!offered("go_on") && print.state === "interrupted" && html`
      <p class="hint">No Go on: ${can(print, "go_on").reason}.</p>`}`;
}

// What to do by hand, and where the rest begins: it becomes a job of its own.
function Recovery({ job, plan, onClose }) {
  const [line, setLine] = useState(plan.from_line || null);
  const needsLine = plan.needs === "from_line";
  const rest = useGet(needsLine ? null : path(job, "recovery"));
  const write = async () => {
    const made = await send("POST", path(job, "recover"), { from_line: line });
    go(`/job?job=${part(made.job)}`);
  };
  return html`<${Ask} title="Recover the rest of the print?" yes="Write the rest as a job" no="Not now" work=${write}
      onClose=${onClose} text="The rest becomes a job of its own, which is checked and started like any other.">
    ${plan.reason && html`<${Note} tone="warn">${sentence(plan.reason)}</${Note}>`}
    ${!needsLine && html`<${Loaded} of=${rest} what="Planning the rest">${({ steps }) => html`
      <div class="job-steps"><${Bullets} list="ol" rows=${steps} /></div>`}</${Loaded}>`}
    <${Field} kind="number" label="Line of the job's file to begin with" min="1" step="1"
      value=${line} onChange=${setLine} hint=${needsLine ? "" : "Left empty: where the last sure place is"} />
  </${Ask}>`;
}
