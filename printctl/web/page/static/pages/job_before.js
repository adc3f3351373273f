// Before a print: the job, the printer, all that refuses a start with what helps, then the start.
import { get, listen, part, send } from "../api.js";
import {
  Act, Badge, Button, Card, Drop, Empty, Facts, Failed, Field, Fold, Loaded, Loading, Note, bytes, go, html, number,
  sentence, span, useCallback, useEffect, useGet, useRef, useState, useStyle, when,
} from "../ui.js";
import { LiveView } from "./job_views.js";

const POLL_MS = 2000;
const SHOWN_JOBS = 8;
const address = (job) => `/job?job=${part(job)}`;
const nameOf = (job) => job.replace(/^(run|file)~/, "");

export default function Before({ job, reload }) {
  useStyle("pages/job_steps.css");
  return job ? html`<${Steps} job=${job} reload=${reload} />` : html`<${Jobs} />`;
}

// --- the list of jobs ----------------------------------------------------------------------------

export function Jobs() {
  const jobs = useGet("/jobs");
  const unusable = useGet("/jobs/unusable");
  const [all, setAll] = useState(false);
  return html`<${Card} title="Choose a job">
    <${Drop} label="Upload G-code" accept=".gcode,.gco,.g,.nc" path="/jobs" onDone=${(one) => go(address(one.id))} />
    <${Loaded} of=${jobs} what="Reading the jobs">${(rows) => rows.length === 0
      ? html`<${Empty}>No job yet. Upload a G-code file, or <a href="/">begin with a design</a>.</${Empty}>`
      : html`<ul class="list">${(all ? rows : rows.slice(0, SHOWN_JOBS)).map((one) => html`<li key=${one.id}>
          <a class="link-row" href=${address(one.id)}><strong class="job-name">${one.name}</strong><br />
            <span class="quiet">${factsOf(one)} · ${when(one.changed)}</span></a></li>`)}</ul>
        ${rows.length > SHOWN_JOBS && !all && html`
          <${Button} onClick=${() => setAll(true)}>Show all ${rows.length}</${Button}>`}`
    }</${Loaded}>
    ${unusable.value?.length > 0 && html`<${Note} tone="warn">Not shown, as their names can't be a job's:
      ${" "}${unusable.value.join(", ")}. Rename them: letters, digits, ".", "_" and "-", at most 64.</${Note}>`}
  </${Card}>`;
}

function factsOf(one) {
  const said = [one.id.startsWith("run~") ? "from a run" : `uploaded, ${bytes(one.size)}`];
  if (one.layers) said.push(`${one.layers} layer${one.layers > 1 ? "s" : ""}`);
  if (one.duration_s !== null) said.push(span(one.duration_s));
  if (one.ink_ul !== null) said.push(`${number(one.ink_ul, 3)} µL of ink`);
  return said.join(" · ");
}

// --- what is known -------------------------------------------------------------------------------

// What refuses a start, asked for again and again: the machine changes without us. A job that wasn't
// checked with this set-up is, beside that, which takes as long as its dry run.
function useReadiness(job) {
  const [state, setState] = useState({ value: null, problem: null });
  const again = useRef(() => null);
  useEffect(() => {
    const path = `/jobs/${part(job)}/readiness`;
    let gone = false, looking = false, timer = 0, turn = 0;
    const ask = async () => {
      clearTimeout(timer);
      const mine = (turn += 1);
      try {
        const value = await get(`${path}?wait=false`);
        if (gone || mine !== turn) return;
        setState((old) => ({ value: value.checked ? value : withEarlier(value, old.value), problem: null }));
        if (!value.checked && !looking) look();
      } catch (problem) {
        if (gone || mine !== turn) return;
        setState((old) => ({ ...old, problem }));
      }
      timer = setTimeout(ask, document.hidden ? 5 * POLL_MS : POLL_MS);
    };
    const look = async () => {
      looking = true;
      const value = await get(path).catch(() => null);
      looking = false;
      if (value?.checked && !gone) await ask();
    };
    again.current = ask;
    ask();
    let station = "";
    const end = listen((one) => {
      if (one.event === "controls") ask();
      if (one.event === "station" && one.state !== station) {
        station = one.state;
        ask();
      }
    });
    return () => { gone = true; clearTimeout(timer); end(); };
  }, [job]);
  return { ...state, loading: state.value === null && !state.problem, reload: () => again.current() };
}

// While a job is checked anew, what its last check found stays in its place.
function withEarlier(value, earlier) {
  const { preflight } = earlier ?? {};
  if (!preflight) return value;
  const failed = preflight.checks.filter((one) => one.result === "failed");
  const known = ({ what, place }) => failed.some((one) => one.check === what && one.place === place);
  const kept = earlier.refusals.filter(known);
  return { ...value, preflight, refusals: [...value.refusals, ...kept] };
}

function Steps({ job, reload }) {
  const ready = useReadiness(job);
  const form = useGet(`/jobs/${part(job)}/form`);
  const record = useGet(`/jobs/${part(job)}/record`);
  const entry = useGet(`/jobs/${part(job)}`);
  const machine = ready.value?.machine;
  const state = machine ? `${machine.words} ${machine.state}` : "";
  useEffect(() => form.reload(), [state, String(machine?.tip_mm)]); // the printer knows the set-up better
  const refresh = useCallback(async () => { form.reload(); record.reload(); await ready.reload(); }, [job]);
  const all = { job, ready: ready.value, form: form.value, record: record.value, refresh, reload };
  const failed = [entry, form, record].find((one) => one.problem && one.value === null);
  if (failed) return html`<${Failed} problem=${failed.problem} again=${failed.reload} />`;
  if (!form.value || !record.value || !entry.value) return html`<${Loading} what="Reading the job" />`;
  return html`<div class="job-set">
    <div class="stack">
      <${TheJob} ...${all} entry=${entry.value} />
      <${ThePrinter} ...${all} />
      <${TheRecord} ...${all} />
    </div>
    <div class="stack">
      <${Checks} ...${all} problem=${ready.problem} />
      <${Start} ...${all} />
    </div>
  </div>`;
}

// A card of one step: its number, and whether it is done.
const Step = ({ at, title, done, tools, children }) => html`
  <${Card} title=${html`<span class="job-number" aria-hidden="true">${at}</span> ${title}`}
    tools=${html`${done && html`<${Badge} tone="good">${done}</${Badge}>`}${tools}`}>${children}</${Card}>`;

// --- 1: the job ----------------------------------------------------------------------------------

function TheJob({ job, entry, ready }) {
  const found = ready?.preflight ?? entry;
  const changes = ready?.preflight?.reload_at.length;
  const run = job.startsWith("run~") && nameOf(job);
  return html`<${Step} at="1" title="The job">
    <div class="job-picture"><${LiveView} job=${job} /></div>
    <div class="job-facts"><${Facts} rows=${[
      ["Prints for", found.duration_s ? span(found.duration_s) : "checked below"],
      ["Ink", found.ink_ul ? `${number(found.ink_ul, 3)} µL` : null],
      ["Syringes", changes ? `${changes + 1}: changed ${changes === 1 ? "once" : `${changes} times`}` : null],
      [ready?.preflight?.passes ? "Passes" : "Layers", found.layers || null],
      ["Vessels", found.vessels || null],
      ["Lines", found.commands || null],
      run && ["Run", html`<a href=${`/design?recipe=${part(run)}`}>${run}</a>`],
      ["SHA-256", html`<span class="mono" title=${entry.sha256}>${entry.sha256.slice(0, 12)}…</span>`],
    ]} /></div>
  </${Step}>`;
}

// --- 2: the printer ------------------------------------------------------------------------------

const PARTS = { needle: "Needle", syringe: "Syringe", ink: "Ink", bath: "Bath", dish: "Dish" };

const chosen = (form, one) => form.choices[one]?.[form.set_up[one]] ?? form.set_up[one];

// Keep a change of the set-up as it is by then, one after the other; of what is mounted tell the printer, too.
let keeping = Promise.resolve();
function keep(all, change) {
  keeping = keeping.catch(() => null).then(() => keepNow(all, change));
  return keeping;
}

async function keepNow({ job, form, ready, refresh }, change) {
  const { set_up } = await get(`/jobs/${part(job)}/form`);
  const next = { ...set_up, ...change, care: { ...set_up.care, ...change.care } };
  if (!next.dish) Object.assign(next, { bath_depth_mm: null, dish_centre_mm: null });
  await send("PUT", `/jobs/${part(job)}/set-up`, next);
  const named = Object.entries(change).filter(([one]) => one in PARTS);
  const mounted = named.map(([one, value]) => [one, form.choices[one][value] ?? value]);
  if (ready?.machine && mounted.length) await send("POST", "/printer/mount", Object.fromEntries(mounted));
  await refresh();
}

function ThePrinter(all) {
  const { form, ready } = all;
  const { set_up } = form;
  const machine = ready?.machine;
  const tip = machine?.tip_mm?.map((mm, k) => `${"XYZ"[k]} ${mm.toFixed(2)}`).join(" ");
  const named = Object.keys(PARTS).filter((one) => set_up[one]);
  const names = (parts) => parts.map((one) => chosen(form, one)).join(", ");
  const told = named.filter((one) => machine?.mounted[one]);
  const assumed = named.filter((one) => !machine?.mounted[one]);
  const start = set_up.start_mm.map((mm, k) => `${"XYZ"[k]} ${mm.toFixed(2)}`).join(" ");
  return html`<${Step} at="2" title="The printer" done=${machine?.ready && "ready"}
      tools=${machine && !machine.ready && html`<${Badge} tone="warn">${machine.state}</${Badge}>`}>
    ${ready && !machine && html`<${Connect} ...${all} />`}
    <${Facts} rows=${[
      machine && ["Connected", `${machine.words}${machine.simulated ? ", a rehearsal" : ""}`],
      ["Mounted", names(told)],
      ["Checked with", assumed.length ? `${names(assumed)}${machine ? " (not said to be mounted)" : ""}` : null],
      ["Starts at", `${start} mm${form.declared ? ", as the job says" : machine ? ", where the tip stands" : ""}`],
      machine && ["Tip", tip ? `${tip} mm` : "not known"],
      machine && ["In the syringe", machine.ul_left === null ? null : `${number(machine.ul_left, 3)} µL`],
    ]} />
    <div class="job-folds">
    <${Fold} title="Change what is mounted">
      <div class="job-fields">
        ${!machine && html`<${PartField} ...${all} one="printer" />`}
        ${Object.keys(PARTS).map((one) => html`<${PartField} key=${one} ...${all} one=${one} />`)}
        ${set_up.dish && html`<${Kept} kind="number" label="Bath depth" unit="mm" min="0.1"
          value=${set_up.bath_depth_mm} save=${(mm) => keep(all, { bath_depth_mm: mm })} />`}
        ${!machine && !form.declared && ["X", "Y", "Z"].map((axis, k) => html`<${Kept} kind="number" key=${axis}
          label=${`Start ${axis}`} unit="mm" value=${set_up.start_mm[k]}
          save=${(mm) => keep(all, { start_mm: set_up.start_mm.with(k, mm ?? 0) })} />`)}
      </div>
    </${Fold}>
    <${Watched} ...${all} />
    </div>
  </${Step}>`;
}

function PartField(all) {
  const { form, one } = all;
  const value = form.set_up[one];
  const options = Object.entries(form.choices[one]);
  if (!(value in form.choices[one]) && value) options.unshift([value, value]);
  if (one !== "printer") options.unshift(["", "none named"]);
  return html`<${Kept} kind="choice" label=${PARTS[one] ?? "Printer"} value=${value} options=${options}
    save=${(next) => keep(all, { [one]: next })} />`;
}

// A field that is kept by `save` (async): at once what is chosen, what is typed when one leaves it.
function Kept({ save, value, kind, ...more }) {
  const [draft, setDraft] = useState(value);
  const [problem, setProblem] = useState("");
  useEffect(() => setDraft(value), [value]);
  const refused = (error) => {
    setProblem(error.message);
    setDraft(value);
  };
  const done = (next) => next !== value && save(next).then(() => setProblem(""), refused);
  const typed = kind !== "choice" && kind !== "flag";
  return html`<${Field} kind=${kind} ...${more} value=${draft} problem=${problem}
    onChange=${(next) => { setDraft(next); if (!typed) done(next); }} onBlur=${() => typed && done(draft)}
    onKeyDown=${(event) => event.key === "Enter" && kind !== "long" && typed && event.target.blur()} />`;
}

function Watched(all) {
  const { set_up } = all.form;
  const { care } = set_up;
  const change = (care) => keep(all, { care });
  return html`<${Fold} title="How the print is watched over">
    <div class="job-fields">
      <${Kept} kind="number" label="Pause unless confirmed within" unit="min" min="0" value=${care.deadman_min}
        save=${(min) => change({ deadman_min: min ?? 0, deadman_stops: Boolean(min) && care.deadman_stops })} />
      <${Kept} kind="number" label="Extra ink after a pause" unit="µL" min="0" value=${care.prime_ul}
        save=${(ul) => change({ prime_ul: ul ?? 0 })} />
    </div>
    <${Kept} kind="flag" label="Pause for a new syringe where one doesn't last" value=${care.reload}
      save=${(on) => change({ reload: on })} />
    <${Kept} kind="flag" label="Stop instead of pausing when nobody confirms" value=${care.deadman_stops}
      disabled=${!care.deadman_min} save=${(on) => change({ deadman_stops: on })} />
    <${Kept} kind="flag" label="Print although the needle's shaft passes through written vessels (the journal keeps it)"
      value=${set_up.accept_crossings} save=${(on) => keep(all, { accept_crossings: on })} />
  </${Fold}>`;
}

// Connect a printer; a simulated one is offered with the refusal.
function Connect(all) {
  const { form, refresh } = all;
  const ports = useGet("/printer/ports");
  const [port, setPort] = useState("");
  const found = (ports.value ?? []).map((one) => [one.device, `${one.device} ${one.description}`.trim()]);
  const connect = async () => {
    await send("POST", "/printer/connect", { profile: chosen(form, "printer"), port });
    await refresh();
  };
  return html`<div class="stack">
    <div class="job-fields">
      <${PartField} ...${all} one="printer" />
      <${Field} kind="choice" label="Port" value=${port} onChange=${setPort}
        options=${[["", found.length ? "choose" : "none found"], ...found, ["auto", "find it by itself"]]} />
    </div>
    <${Act} work=${connect} why=${port ? "" : "choose a port first"}>Connect</${Act}>
  </div>`;
}

// --- 3: the checks -------------------------------------------------------------------------------

function Checks(all) {
  const { ready, problem, form, record } = all;
  if (!ready) {
    return html`<${Step} at="3" title="Checks">
      ${problem ? html`<${Failed} problem=${problem} />` : html`<${Loading} what="Looking at job and printer" />`}
    </${Step}>`;
  }
  const refusals = ready.refusals.filter((one) => one.action !== "tick");
  const open = ready.refusals.length - refusals.length;
  const rows = ready.preflight?.checks ?? [];
  const warnings = rows.filter((one) => one.result === "warning");
  const passed = rows.filter((one) => one.result === "passed");
  const left = ready.refusals.length;
  const says = left ? refusing(left) : ready.checked ? "Nothing refuses the start" : "";
  return html`<${Step} at="3" title="Checks" done=${ready.ready && "nothing refuses the start"}>
    <p role="status" class=${left ? "job-left" : "unseen"}>${says}</p>
    ${problem && html`<${Failed} problem=${problem} />`}
    ${refusals.length > 0 && html`<ul class="job-refusals" aria-label="What refuses the start">
      ${refusals.map((one) => html`
        <li key=${one.what + one.about + one.place}><${Refused} ...${all} one=${one} /></li>`)}</ul>`}
    ${!ready.checked && html`<${Loading} what="Checking the job: all of it is run through the planner" />`}
    ${ready.machine && !ready.machine.simulated && html`
      <${Points} ...${all} left=${open} due=${ready.checked && !refusals.length} />`}
    ${ready.preflight?.accepted.map((text) => html`
      <${Note} key=${text} tone="warn">Accepted, and kept in the journal: ${text}</${Note}>`)}
    <div class="job-folds">
      <${Found} rows=${warnings} name="to know before the start" />
      <${Found} rows=${passed} name="checks passed" />
    </div>
  </${Step}>`;
}

const refusing = (count) => `${count} ${count === 1 ? "thing refuses" : "things refuse"} the start`;

// "3.2 mm, limit 0.05 mm"; nothing for a question to a person.
function measured(one) {
  if (one.value === null && one.limit === null) return "";
  return `: ${number(one.value)}${one.unit && ` ${one.unit}`}, limit ${number(one.limit)}${one.unit && ` ${one.unit}`}`;
}

const Found = ({ rows, name }) => rows.length > 0 && html`<${Fold} title=${`${rows.length} ${name}`}>
  <ul class="list">${rows.map((one, at) => html`<li key=${at}><strong>${sentence(one.check)}</strong>${measured(one)}
    <br /><span class="quiet">${[one.place, !one.passed && one.remedy].filter(Boolean).join(": ")}</span></li>`)}</ul>
</${Fold}>`;

function Refused(all) {
  const { what, place, remedy, action } = all.one;
  return html`<div class="job-refusal">
    <div class="job-why"><strong>${sentence(what)}</strong>${measured(all.one)}</div>
    <${Remedy} ...${all} />
    ${action !== "operator" && html`
      <p class="quiet">${sentence(remedy.includes(place) ? remedy : `${place}: ${remedy}`)}.</p>`}
  </div>`;
}

const FILL = {
  title: "Was a full syringe put in?", yes: "Yes, it is full", no: "Not yet",
  text: "The printer then counts its ink from full. Say how full another one is on the page Printer.",
};
const CROSS = {
  title: "Print through written vessels?", yes: "Accept the crossings", danger: true,
  text: "The needle's shaft may tear what it passes through. The journal keeps that it was accepted.",
};

// What can be done about a refusal at the page, else where to do it.
function Remedy(all) {
  const { one, job, form, record, refresh } = all;
  const post = (path, body) => async () => {
    await send("POST", path, body);
    await refresh();
  };
  const rehearsal = { profile: chosen(form, "printer"), port: "simulated" };
  switch (one.action) {
    case "controls":
      return html`<${Act} work=${post("/controls", { force: true })}>Take them over</${Act}>`;
    case "connect":
      return html`<${Act} work=${post("/printer/connect", rehearsal)}>Rehearse (simulated)</${Act}>`;
    case "reconnect":
      return html`<${Act} work=${post("/printer/reconnect")}>Connect anew</${Act}>`;
    case "to_start":
      return html`<${Act} work=${post(`/jobs/${part(job)}/to-start`, {})}>Move the tip to the start</${Act}>
        ${all.ready?.machine?.touch_off_due && html`<${Button} href="/printer?tab=needle">Touch off first</${Button}>`}`;
    case "fill":
      return html`<${Act} work=${post("/printer/mount", { syringe: chosen(form, "syringe") })} ask=${FILL}>
        A full one was put in</${Act}>`;
    case "reload":
      return html`<${Act} work=${() => keep(all, { care: { reload: true } })}>Allow changes of syringe</${Act}>`;
    case "accept_crossings":
      return html`<${Act} work=${() => keep(all, { accept_crossings: true })} ask=${CROSS}>
        Accept the crossings</${Act}>`;
    case "mount":
      return html`<${PartField} ...${all} one=${one.about} />`;
    case "operator":
      return html`<${Kept} label="Operator's name" value=${record.operator} maxlength="200" autocomplete="name"
        save=${(operator) => write(all, { operator })} />`;
    case "see_print":
      return html`<${Button} href="/job">See it</${Button}>`;
    case "touch_off":
      return html`<${Button} href="/printer?tab=needle">Touch off</${Button}>`;
    case "set_position":
      return html`<${Button} href="/printer?open=place">Say where the tip is</${Button}>`;
    default:
      return null;
  }
}

// What a person looks at before a machine moves: last of all, as the tip must stand at the start by then.
function Points(all) {
  const { form, record, left, due } = all;
  const count = form.checklist.length;
  const tick = (id) => (on) => write(all, { ticked: { [id]: on } });
  return html`<${Fold} key=${due && left > 0} open=${due && left > 0}
      title=${left ? `Look at the machine: ${left} of ${count} points left` : `All ${count} points were looked at`}>
    <div class="job-points">${form.checklist.map((one) => html`<${Kept} key=${one.id} kind="flag" label=${one.text}
      value=${Boolean(record.ticked[one.id])} save=${tick(one.id)} />`)}</div>
  </${Fold}>`;
}

// --- 4: the record, and the start ----------------------------------------------------------------

async function write({ job, refresh }, changes) {
  await send("PATCH", `/jobs/${part(job)}/record`, changes);
  await refresh();
}

const LINES = [
  ["operator", "Operator's name"], ["ink_lot", "Lot of the ink"], ["bath_lot", "Lot and age of the bath"],
  ["needle_lot", "Lot of the needle"], ["cells", "Cells (line or donor)"],
];
const NUMBERS = [
  ["passage", "Passage", "", 1], ["density_per_ml", "Cells per mL of ink", "/mL", "any"],
  ["viability_percent", "Viability when mixed", "%", "any"], ["viability_min", "Time the cells have", "min", "any"],
];

const CLOCK = { late: "bad", close: "warn", "in time": "good" };

function TheRecord(all) {
  const { job, record } = all;
  const [ago, setAgo] = useState(0);
  const clock = useGet(record.mixed_at === null ? null : `/prints/${part(job)}/viability`, { every: 30_000 });
  const known = LINES.filter(([key]) => record[key]).map(([key]) => record[key]);
  return html`<${Card} aria-label="Record">
    ${clock.value && html`<${Note} tone=${CLOCK[clock.value.state] ?? "info"}>${clock.value.words}</${Note}>`}
    <${Fold} title=${known.length ? `Record: ${known.join(", ")}` : "Record: operator, lots, cells, notes"}>
    <div class="job-fields">
      ${LINES.map(([key, label]) => html`<${Kept} key=${key} label=${label} value=${record[key]} maxlength="200"
        save=${(text) => write(all, { [key]: text })} />`)}
      ${NUMBERS.map(([key, label, unit, step]) => html`<${Kept} kind="number" key=${key} label=${label} unit=${unit}
        min="0" step=${step} value=${record[key]} save=${(value) => write(all, { [key]: value })} />`)}
    </div>
    <div class="row">
      <${Field} kind="number" label="Cells were mixed … ago" unit="min" min="0" max="10000" value=${ago}
        onChange=${setAgo} />
      <${Act} work=${() => write(all, { mixed_at: Date.now() / 1000 - 60 * (ago ?? 0) })}>
        Start the clock of the cells</${Act}>
      ${record.mixed_at !== null && html`<span class="quiet">mixed ${when(record.mixed_at)}</span>`}
    </div>
    <${Kept} kind="long" label="Notes on sterility" value=${record.sterility}
      save=${(text) => write(all, { sterility: text })} />
    </${Fold}>
  </${Card}>`;
}

function Start(all) {
  const { job, ready, reload } = all;
  const words = ready?.machine?.words;
  const count = ready?.refusals.length ?? 0;
  const why = ready?.ready ? ""
    : count ? `${refusing(count)}: mend ${count === 1 ? "it" : "them"} in step 3.`
    : "The job is still being checked.";
  const seconds = ready?.preflight?.duration_s;
  const lasts = seconds ? `, for about ${span(seconds)}` : "";
  const watch = ready?.machine?.simulated ? "" : " Stay within reach of STOP.";
  const start = async () => {
    await send("POST", `/prints/${part(job)}/start`, { confirmed: words });
    await reload();
  };
  return html`<${Step} at="4" title="Start">
    <${Act} kind="main" work=${start} why=${why} ask=${{
      title: "Start the print?", yes: "Yes, start it",
      text: `${words} will move now and write ${nameOf(job)}${lasts}.${watch}`,
    }}>${words ? `Start on ${words} …` : "Start …"}</${Act}>
    ${why && html`<p class="hint">${why}</p>`}
  </${Step}>`;
}
