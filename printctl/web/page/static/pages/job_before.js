// Before a print: the job, the printer, all that refuses a start with what helps, then the start.
import { get, listen, part, send } from "../api.js";
import {
  Act, Badge, Button, Card, Drop, Empty, Facts, Failed, Field, Fold, Fragment, Loaded, Loading, Note, Segments,
  bytes, go, html, number, span, useCallback, useEffect, useGet, useRef, useState, useStyle, when,
} from "../ui.js";

const POLL_MS = 2000;
const SHOWN_JOBS = 8;
const address = (job) => `/job?job=${part(job)}`;
const nameOf = (job) => job.replace(/^(run|file)~/, "");

export default function Before({ job, print, reload }) {
  useStyle("pages/job_steps.css");
  return job ? html`<${Steps} job=${job} print=${print} reload=${reload} />` : html`<${Jobs} />`;
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
        ${rows.length > SHOWN_JOBS && !all && html`<${Button} onClick=${() => setAll(true)}>Show all ${rows.length}</${Button}>`}`
    }</${Loaded}>
    ${unusable.value?.length > 0 && html`<${Note} tone="warn">Not shown, as their names can't be a job's: ${unusable.value.join(", ")}.
      Rename them: letters, digits, ".", "_" and "-", at most 64.</${Note}>`}
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
        setState({ value, problem: null });
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

function Steps({ job, print, reload }) {
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
  return html`<div class="job-steps">
    <div class="stack">
      <${TheJob} ...${all} entry=${entry.value} print=${print} />
      <${ThePrinter} ...${all} />
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

function TheJob({ job, entry, print, ready }) {
  const found = ready?.preflight ?? entry;
  const changes = ready?.preflight?.reload_at.length;
  const run = job.startsWith("run~") && nameOf(job);
  return html`<${Step} at="1" title="The job"
      tools=${!print && html`<a href="/job?other=1">Another job</a>`}>
    <${Picture} job=${job} />
    <div class="job-facts"><${Facts} rows=${[
      ["Prints for", found.duration_s ? span(found.duration_s) : "checked below"],
      ["Ink", found.ink_ul ? `${number(found.ink_ul, 3)} µL` : null],
      ["Syringes", changes ? `${changes + 1}: changed ${changes === 1 ? "once" : `${changes} times`}` : null],
      [ready?.preflight?.passes ? "Passes" : "Layers", found.layers || null],
      ["Vessels", found.vessels || null],
      ["Lines", found.commands || null],
      run ? ["Run", html`<a href=${`/design?run=${part(run)}`}>${run}</a>`] : ["Uploaded", when(entry.changed)],
      ["SHA-256", html`<span class="mono" title=${entry.sha256}>${entry.sha256.slice(0, 12)}…</span>`],
    ]} /></div>
  </${Step}>`;
}

// The job as it will be written, in the live view.
function Picture({ job }) {
  const place = useRef(null);
  const [problem, setProblem] = useState(null);
  useStyle("/live/static/live_view.css");
  useEffect(() => {
    let gone = false, view = null;
    import("/live/static/live_view.js")
      .then(({ liveView }) => liveView(place.current, { scene: `/live/${part(job)}/scene`, live: false }))
      .then((made) => { view = made; if (gone) view.dispose(); })
      .catch((error) => { console.error(error); setProblem(error); });
    return () => { gone = true; view?.dispose(); };
  }, [job]);
  return html`<div class="job-picture">${problem ? html`<${Empty}>No picture of this job.</${Empty}>` : html`<div ref=${place}></div>`}</div>`;
}

// --- 2: the printer ------------------------------------------------------------------------------

const PARTS = { needle: "Needle", syringe: "Syringe", ink: "Ink", bath: "Bath", dish: "Dish" };
const ARTICLES = { printer: "the printer", ...Object.fromEntries(Object.keys(PARTS).map((one) => [one, `the ${one}`])) };

const chosen = (form, one) => form.choices[one]?.[form.set_up[one]] ?? form.set_up[one];

// Keep a change of the set-up; of what is mounted tell the printer, too.
async function keep({ job, form, ready, refresh }, changes) {
  const set_up = { ...form.set_up, ...changes };
  if (!set_up.dish) Object.assign(set_up, { bath_depth_mm: null, dish_centre_mm: null });
  await send("PUT", `/jobs/${part(job)}/set-up`, set_up);
  const mounted = Object.entries(changes).filter(([one]) => one in PARTS);
  if (ready?.machine && mounted.length) {
    await send("POST", "/printer/mount", Object.fromEntries(mounted.map(([one, value]) => [one, form.choices[one][value] ?? value])));
  }
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
    <${Fold} title="Change what is mounted">
      <div class="job-fields">
        ${!machine && html`<${PartField} ...${all} one="printer" />`}
        ${Object.keys(PARTS).map((one) => html`<${PartField} key=${one} ...${all} one=${one} />`)}
        ${set_up.dish && html`<${Amount} label="Bath depth" unit="mm" min="0.1" value=${set_up.bath_depth_mm}
          save=${(mm) => keep(all, { bath_depth_mm: mm })} />`}
        ${!machine && !form.declared && "XYZ".split("").map((axis, k) => html`<${Amount} key=${axis} label=${`Start ${axis}`} unit="mm"
          value=${set_up.start_mm[k]} save=${(mm) => keep(all, { start_mm: set_up.start_mm.map((old, j) => (j === k ? (mm ?? 0) : old)) })} />`)}
      </div>
    </${Fold}>
    <${Watched} ...${all} />
  </${Step}>`;
}

function PartField(all) {
  const { form, one } = all;
  const value = form.set_up[one];
  const options = Object.entries(form.choices[one]);
  if (!(value in form.choices[one]) && value) options.unshift([value, value]);
  if (one !== "printer") options.unshift(["", "none named"]);
  const [problem, setProblem] = useState("");
  return html`<${Field} kind="choice" label=${PARTS[one] ?? "Printer"} value=${value} options=${options} problem=${problem}
    onChange=${(next) => keep(all, { [one]: next }).then(() => setProblem(""), (error) => setProblem(error.message))} />`;
}

// A number that is kept when one leaves its field.
function Amount({ save, value, ...more }) {
  const [draft, setDraft] = useState(value);
  const [problem, setProblem] = useState("");
  useEffect(() => setDraft(value), [value]);
  const done = () => draft !== value && save(draft).then(() => setProblem(""), (error) => setProblem(error.message));
  return html`<${Field} kind="number" ...${more} value=${draft} problem=${problem} onChange=${setDraft} onBlur=${done}
    onKeyDown=${(event) => event.key === "Enter" && event.target.blur()} />`;
}

function Line({ save, value, ...more }) {
  const [draft, setDraft] = useState(value);
  const [problem, setProblem] = useState("");
  useEffect(() => setDraft(value), [value]);
  const done = () => draft !== value && save(draft).then(() => setProblem(""), (error) => setProblem(error.message));
  return html`<${Field} ...${more} value=${draft} problem=${problem} onChange=${setDraft} onBlur=${done}
    onKeyDown=${(event) => event.key === "Enter" && more.kind !== "long" && event.target.blur()} />`;
}

function Watched(all) {
  const { set_up } = all.form;
  const { care } = set_up;
  const change = (changes) => keep(all, { care: { ...care, ...changes } });
  return html`<${Fold} title="How the print is watched over">
    <div class="job-fields">
      <${Amount} label="Pause unless confirmed within" unit="min" min="0" value=${care.deadman_min}
        save=${(min) => change({ deadman_min: min ?? 0, deadman_stops: Boolean(min) && care.deadman_stops })} />
      <${Amount} label="Extra ink after a pause" unit="µL" min="0" value=${care.prime_ul} save=${(ul) => change({ prime_ul: ul ?? 0 })} />
    </div>
    <${Field} kind="flag" label="Pause for a new syringe where one doesn't last" value=${care.reload} onChange=${(on) => change({ reload: on })} />
    <${Field} kind="flag" label="Stop instead of pausing when nobody confirms" value=${care.deadman_stops} disabled=${!care.deadman_min}
      onChange=${(on) => change({ deadman_stops: on })} />
    <${Field} kind="flag" label="Print although the needle's shaft passes through written vessels (the journal keeps it)"
      value=${set_up.accept_crossings} onChange=${(on) => keep(all, { accept_crossings: on })} />
  </${Fold}>`;
}

// Connect a printer, or a simulated one.
function Connect(all) {
  const { form, refresh } = all;
  const ports = useGet("/printer/ports");
  const [port, setPort] = useState("");
  const found = (ports.value ?? []).map((one) => [one.device, `${one.device} ${one.description}`.trim()]);
  const connect = async (to) => {
    await send("POST", "/printer/connect", { profile: chosen(form, "printer"), port: to });
    await refresh();
  };
  return html`<div class="stack">
    <div class="row">
      <${Act} kind="main" work=${() => connect("simulated")}>Rehearse on a simulated printer</${Act}>
    </div>
    <div class="job-fields">
      <${PartField} ...${all} one="printer" />
      <${Field} kind="choice" label="Port" value=${port} onChange=${setPort}
        options=${[["", found.length ? "choose" : "no printer found at a USB port"], ...found, ["auto", "find it by itself"]]} />
    </div>
    <${Act} work=${() => connect(port)} why=${port ? "" : "choose a port first"}>Connect</${Act}>
  </div>`;
}

// --- 3: the checks -------------------------------------------------------------------------------

function Checks(all) {
  const { ready, problem, form, record } = all;
  if (!ready) {
    return html`<${Step} at="3" title="Checks">${problem ? html`<${Failed} problem=${problem} />` : html`<${Loading} what="Looking at job and printer" />`}</${Step}>`;
  }
  const refusals = ready.refusals.filter((one) => one.action !== "tick");
  const open = ready.refusals.length - refusals.length;
  const rows = ready.preflight?.checks ?? [];
  const warnings = rows.filter((one) => one.result === "warning");
  const passed = rows.filter((one) => one.result === "passed");
  const left = ready.refusals.length;
  return html`<${Step} at="3" title="Checks" done=${ready.ready && "nothing refuses the start"}>
    <p role="status" class=${left ? "job-left" : "unseen"}>${left ? `${left} ${left === 1 ? "thing refuses" : "things refuse"} the start` : ready.checked ? "Nothing refuses the start" : ""}</p>
    ${problem && html`<${Failed} problem=${problem} />`}
    ${refusals.length > 0 && html`<ul class="job-refusals" aria-label="What refuses the start">${refusals.map((one) => html`
      <li key=${one.what + one.about + one.place}><${Refused} ...${all} one=${one} /></li>`)}</ul>`}
    ${!ready.checked && html`<${Loading} what="Checking the job: all of it is run through the planner" />`}
    ${ready.machine && !ready.machine.simulated && html`<${Points} ...${all} open=${open} />`}
    ${ready.preflight?.accepted.map((text) => html`<${Note} key=${text} tone="warn">Accepted, and kept in the journal: ${text}</${Note}>`)}
    ${warnings.length > 0 && html`<${Fold} title=${`${warnings.length} to know before the start`}><${Rows} rows=${warnings} /></${Fold}>`}
    ${passed.length > 0 && html`<${Fold} title=${`${passed.length} checks passed`}><${Rows} rows=${passed} /></${Fold}>`}
  </${Step}>`;
}

const sentence = (text) => text.charAt(0).toUpperCase() + text.slice(1);

// "3.2 mm, limit 0.05 mm"; nothing for a question to a person.
function measured(one) {
  if (one.value === null && one.limit === null) return "";
  return `: ${number(one.value)}${one.unit && ` ${one.unit}`}, limit ${number(one.limit)}${one.unit && ` ${one.unit}`}`;
}

const Rows = ({ rows }) => html`<ul class="list">${rows.map((one, at) => html`<li key=${at}>
  <strong>${sentence(one.check)}</strong>${measured(one)}
  <br /><span class="quiet">${[one.place, !one.passed && one.remedy].filter(Boolean).join(": ")}</span></li>`)}</ul>`;

function Refused(all) {
  const { one } = all;
  return html`<div class="job-refusal">
    <div><strong>${sentence(one.what)}</strong>${measured(one)}<br />
      <span class="quiet">${[one.place, one.remedy].filter(Boolean).join(": ")}</span></div>
    <${Remedy} ...${all} />
  </div>`;
}

// What can be done about a refusal at the page, else where to do it.
function Remedy(all) {
  const { one, job, form, record, refresh } = all;
  const { set_up } = form;
  const post = (path, body) => async () => { await send("POST", path, body); await refresh(); };
  switch (one.action) {
    case "controls":
      return html`<${Act} work=${post("/controls", { force: true })}>Take them over</${Act}>`;
    case "connect":
      return html`<${Act} work=${post("/printer/connect", { profile: chosen(form, "printer"), port: "simulated" })}>Rehearse (simulated)</${Act}>`;
    case "reconnect":
      return html`<${Act} work=${post("/printer/reconnect")}>Connect anew</${Act}>`;
    case "to_start":
      return html`<${Act} work=${post(`/jobs/${part(job)}/to-start`, {})}>Move the tip to the start</${Act}>`;
    case "reload":
      return html`<${Act} work=${() => keep(all, { care: { ...set_up.care, reload: true } })}>Allow changes of syringe</${Act}>`;
    case "accept_crossings":
      return html`<${Act} work=${() => keep(all, { accept_crossings: true })}
        ask=${{ title: "Print through written vessels?", yes: "Accept the crossings", danger: true,
          text: "The needle's shaft may tear what it passes through. The journal keeps that it was accepted." }}>Accept the crossings</${Act}>`;
    case "mount":
      return html`<${PartField} ...${all} one=${one.about} />`;
    case "operator":
      return html`<${Line} label="Operator's name" value=${record.operator} maxlength="200" autocomplete="name"
        save=${(operator) => write(all, { operator })} />`;
    case "touch_off":
      return html`<${Button} href="/printer">Touch off</${Button}>`;
    case "set_position":
      return html`<${Button} href="/printer">Find the place</${Button}>`;
    default:
      return null;
  }
}

// What a person looks at before a machine moves; folded once all of it is ticked.
function Points(all) {
  const { form, record, open } = all;
  const tick = (id) => (on) => write(all, { ticked: { ...record.ticked, [id]: on } });
  return html`<${Fold} key=${open > 0} open=${open > 0} title=${open ? `Look at the machine: ${open} of ${form.checklist.length} left` : `All ${form.checklist.length} points were looked at`}>
    <div class="job-points">${form.checklist.map((one) => html`<${Field} key=${one.id} kind="flag" label=${one.text}
      value=${record.ticked[one.id]} onChange=${tick(one.id)} />`)}</div>
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

function TheRecord(all) {
  const { job, record } = all;
  const [ago, setAgo] = useState(0);
  const clock = useGet(record.mixed_at === null ? null : `/prints/${part(job)}/viability`, { every: 30_000 });
  const known = LINES.filter(([key]) => record[key]).map(([key]) => record[key]);
  return html`
    ${clock.value && html`<${Note} tone=${{ late: "bad", close: "warn", "in time": "good" }[clock.value.state] ?? "info"}>${clock.value.words}</${Note}>`}
    <${Fold} title=${known.length ? `Record: ${known.join(", ")}` : "Record: operator, lots, cells, notes"}>
    <div class="job-fields">
      ${LINES.map(([key, label]) => html`<${Line} key=${key} label=${label} value=${record[key]} maxlength="200" save=${(text) => write(all, { [key]: text })} />`)}
      ${NUMBERS.map(([key, label, unit, step]) => html`<${Amount} key=${key} label=${label} unit=${unit} min="0" step=${step} value=${record[key]}
        save=${(value) => write(all, { [key]: value })} />`)}
    </div>
    <div class="row">
      <${Field} kind="number" label="Cells were mixed … ago" unit="min" min="0" max="10000" value=${ago} onChange=${setAgo} />
      <${Act} work=${() => write(all, { mixed_at: Date.now() / 1000 - 60 * (ago ?? 0) })}>Start the clock of the cells</${Act}>
      ${record.mixed_at !== null && html`<span class="quiet">mixed ${when(record.mixed_at)}</span>`}
    </div>
    <${Line} kind="long" label="Notes on sterility" value=${record.sterility} save=${(text) => write(all, { sterility: text })} />
  </${Fold}>`;
}

function Start(all) {
  const { job, ready, reload } = all;
  const words = ready?.machine?.words;
  const count = ready?.refusals.length ?? 0;
  const why = ready?.ready ? ""
    : count ? `${count} ${count === 1 ? "thing refuses" : "things refuse"} the start: mend ${count === 1 ? "it" : "them"} in step 3.`
    : "The job is still being checked.";
  const seconds = ready?.preflight?.duration_s;
  const start = async () => {
    await send("POST", `/prints/${part(job)}/start`, { confirmed: words });
    await reload();
  };
  return html`<${Step} at="4" title="Start">
    <${TheRecord} ...${all} />
    <${Act} kind="main" work=${start} why=${why} ask=${{
      title: "Start the print?", yes: "Yes, start it",
      text: `${words} will move now and write ${nameOf(job)}${seconds ? `, for about ${span(seconds)}` : ""}.${ready?.machine?.simulated ? "" : " Stay within reach of STOP."}`,
    }}>${words ? `Start on ${words} …` : "Start …"}</${Act}>
    ${why && html`<p class="hint">${why}</p>`}
  </${Step}>`;
}
