// Before a print: the job, the printer, all that refuses a start with what helps, then the start.
import { get, part, send } from "../api.js";
import {
  Act, Badge, Button, Card, Drop, Empty, Facts, Failed, Field, Fields, Findings, Fold, Kept, Known, Links, Loaded, Loading,
  Note, Unusable, bytes, go, html, nameOf, number, runOf, span, useCallback, useEffect, useFew, useGet, useNews,
  useRef, useState, when,
} from "../ui.js";
import { RECORD } from "../record.js";
import { LiveView } from "./job_views.js";

const POLL_MS = 2000;
const SHOWN_JOBS = 8;
const address = (job) => `/job?job=${part(job)}`;

export default (props) => (props.job ? html`<${Steps} ...${props} />` : html`<${Jobs} />`);

function Jobs() {
  const jobs = useGet("/jobs");
  const unusable = useGet("/jobs/unusable");
  const [few, more] = useFew(jobs.value ?? [], SHOWN_JOBS);
  return html`<${Card} title="Choose a job">
    <${Drop} label="Upload G-code" accept=".gcode,.gco,.g,.nc" path="/jobs" onDone=${(one) => go(address(one.id))} />
    <${Loaded} of=${jobs} what="Reading the jobs">${() => (few.length ? html`<${Links} rows=${few.map((one) => ({
      href: address(one.id), name: one.name, about: `${factsOf(one)} · ${when(one.changed)}` }))} />${more}`
    : html`<${Empty}>No job yet. Upload a G-code file, or <a href="/">begin with a design</a>.</${Empty}>`)}</${Loaded}>
    <${Unusable} names=${unusable.value} />
  </${Card}>`;
}

const factsOf = (one) => [
  runOf(one.id) ? "from a run" : `uploaded, ${bytes(one.size)}`,
  one.layers && `${one.layers} layer${one.layers > 1 ? "s" : ""}`,
  one.duration_s !== null && span(one.duration_s),
  one.ink_ul !== null && `${number(one.ink_ul, 3)} µL of ink`,
].filter(Boolean).join(" · ");

// What refuses a start, asked for again and again: the machine changes without us. A job that wasn't
// checked with this set-up is, beside that, which takes as long as its dry run.
function useReadiness(job) {
  const path = `/jobs/${part(job)}/readiness`;
  const station = useNews("station")?.state;
  const now = useGet(`${path}?wait=false`, { every: POLL_MS, on: ["controls"], key: station });
  const checking = useRef(false);
  const last = useRef(null);
  useEffect(() => {
    if (!now.value || now.value.checked || checking.current) return;
    checking.current = true;
    get(path).catch(() => null).then(() => { checking.current = false; }).then(now.reload);
  }, [now.value]);
  if (now.value) last.current = now.value.checked ? now.value : withEarlier(now.value, last.current);
  return { ...now, value: last.current };
}

// While a job is checked anew, what its last check found stays in its place.
function withEarlier(value, earlier) {
  const { preflight } = earlier ?? {};
  if (!preflight) return value;
  const failed = preflight.checks.filter((one) => one.result === "failed");
  const known = ({ kind, place }) => failed.some((one) => one.kind === kind && one.place === place);
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
  const due = [entry, form, record].find((one) => one.value === null);
  if (due) return html`<${Loaded} of=${due} what="Reading the job" />`;
  return html`<div class="columns job-set">
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

function TheJob({ job, entry, ready }) {
  const found = ready?.preflight ?? entry;
  const changes = ready?.preflight?.reload_at.length;
  const run = runOf(job);
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
      ["SHA-256", html`<span class="mono" title=${entry.sha256}>${entry.sha256.slice(0, 8)}…</span>`],
    ]} /></div>
  </${Step}>`;
}

const PARTS = { printer: "Printer", needle: "Needle", syringe: "Syringe", ink: "Ink", bath: "Bath", dish: "Dish" };

// A part that nobody named, and one of which a person said that it isn't there.
const NOTHING = new Set(["", "none"]);

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
  if (NOTHING.has(next.dish)) Object.assign(next, { bath_depth_mm: null, dish_centre_mm: null });
  await send("PUT", `/jobs/${part(job)}/set-up`, next);
  const named = Object.entries(change).filter(([one]) => one in PARTS && one !== "printer");
  const mounted = named.map(([one, value]) =>
    [one, NOTHING.has(value) ? "" : form.choices[one][value] ?? value]);
  if (change.bath_depth_mm) mounted.push(["bath_depth_mm", change.bath_depth_mm]);
  if (ready?.machine && mounted.length) await send("POST", "/printer/mount", Object.fromEntries(mounted));
  await refresh();
}

const placed = (mm) => mm.map((one, k) => `${"XYZ"[k]} ${one.toFixed(2)}`).join(" ");

const known = (why, value) => html`<${Known} why=${why}>${value}</${Known}>${why && html`
  <span class="quiet">: ${why}</span>`}`;

function ThePrinter(all) {
  const { form, ready } = all;
  const { set_up } = form;
  const machine = ready?.machine;
  const named = Object.keys(PARTS).filter((one) => one !== "printer" && !NOTHING.has(set_up[one]));
  const names = (parts) => parts.map((one) => chosen(form, one)).join(", ");
  const assumed = named.filter((one) => !machine?.mounted[one]);
  const fields = [
    ...Object.keys(PARTS).filter((one) => one !== "printer" || !machine).map((one) => partField(form, one)),
    !NOTHING.has(set_up.dish) && { name: "bath_depth_mm", kind: "number", label: "Bath depth", unit: "mm", min: "0.1" },
  ];
  return html`<${Step} at="2" title="The printer" done=${machine?.ready && "ready"}
      tools=${machine && !machine.ready && html`<${Badge} tone="warn">${machine.state}</${Badge}>`}>
    <${Facts} rows=${[
      machine && ["Connected", `${machine.words}${machine.simulated ? ", a rehearsal" : ""}`],
      ["Mounted", names(named.filter((one) => machine?.mounted[one]))],
      ["Checked with", assumed.length ? `${names(assumed)}${machine ? " (not said to be mounted)" : ""}` : null],
      ["Starts at", `${placed(set_up.start_mm)} mm${
        form.declared ? ", as the job says" : machine ? ", where the tip stands" : ""}`],
      machine && ["Tip", known(machine.unknown.position, machine.tip_mm && `${placed(machine.tip_mm)} mm`)],
      machine && ["In the syringe", known(machine.unknown.ink,
        machine.ul_left !== null && `${number(machine.ul_left, 3)} µL`)],
    ]} />
    <div class="job-folds">
    <${Fold} title="Change what is mounted">
      <${Fields} fields=${fields} of=${set_up} save=${(change) => keep(all, change)}>
        ${!machine && !form.declared && ["X", "Y", "Z"].map((axis, k) => html`<${Kept} kind="number" key=${axis}
          label=${`Start ${axis}`} unit="mm" value=${set_up.start_mm[k]}
          save=${(mm) => keep(all, { start_mm: set_up.start_mm.with(k, mm ?? 0) })} />`)}
      </${Fields}>
    </${Fold}>
    <${Watched} ...${all} />
    </div>
  </${Step}>`;
}

function partField(form, one) {
  const value = form.set_up[one];
  const known = form.choices[one];
  const options = Object.entries(!value || value in known ? known : { [value]: value, ...known });
  return { name: one, kind: "choice", label: PARTS[one],
    options: one === "printer" ? options : [["", "none named"], ...options] };
}

function Watched(all) {
  const { set_up } = all.form;
  const { care } = set_up;
  const change = ({ deadman_min: min, prime_ul: ul, ...more }) => keep(all, { care: {
    ...more, ...(min !== undefined && { deadman_min: min ?? 0, deadman_stops: Boolean(min) && care.deadman_stops }),
    ...(ul !== undefined && { prime_ul: ul ?? 0 }),
  } });
  return html`<${Fold} title="How the print is watched over">
    <${Fields} of=${care} save=${change} fields=${[
      { name: "deadman_min", kind: "number", label: "Pause unless confirmed within", unit: "min", min: "0" },
      { name: "prime_ul", kind: "number", label: "Extra ink after a pause", unit: "µL", min: "0" },
      { name: "reload", kind: "flag", label: "Pause for a new syringe where one doesn't last" },
      { name: "deadman_stops", kind: "flag", label: "Cancel instead of pausing when nobody confirms",
        disabled: !care.deadman_min },
    ]} />
    <${Kept} kind="flag" label="Print although the needle's shaft passes through written vessels (the journal keeps it)"
      value=${set_up.accept_crossings} save=${(on) => keep(all, { accept_crossings: on })} />
  </${Fold}>`;
}

function Checks(all) {
  const { ready, problem } = all;
  if (!ready) {
    return html`<${Step} at="3" title="Checks">
      <${Loaded} of=${{ problem, value: null, loading: true }} what="Looking at job and printer" /></${Step}>`;
  }
  const refusals = ready.refusals.filter((one) => one.action !== "tick");
  const open = ready.refusals.length - refusals.length;
  const rows = ready.preflight?.checks ?? [];
  const left = ready.refusals.length;
  const folded = (result, name) => {
    const some = rows.filter((one) => one.result === result);
    return some.length > 0 && html`<${Fold} title=${`${some.length} ${name}`}><${Findings} rows=${some} /></${Fold}>`;
  };
  return html`<${Step} at="3" title="Checks" done=${ready.ready && "nothing refuses the start"}>
    <p role="status" class=${left ? "job-left" : "unseen"}>${
      left ? refusing(left) : ready.checked && "Nothing refuses the start"}</p>
    ${problem && html`<${Failed} problem=${problem} />`}
    ${refusals.length > 0 && html`<${Findings} rows=${refusals.map(asField)} refuses label="What refuses the start"
      mend=${(one) => html`<${Remedy} ...${all} one=${one} />`} />`}
    ${!ready.checked && html`<${Loading} what="Checking the job: all of it is run through the planner" />`}
    ${ready.machine && !ready.machine.simulated && html`
      <${Points} ...${all} left=${open} due=${ready.checked && !refusals.length} />`}
    ${ready.preflight?.accepted.map((text) => html`
      <${Note} key=${text} tone="warn">Accepted, and kept in the journal: ${text}</${Note}>`)}
    <div class="job-folds">${folded("warning", "to know before the start")}${folded("passed", "checks passed")}</div>
  </${Step}>`;
}

// The operator's name is asked for by its field alone, and a confirmation by its tick.
const asField = (one) => (
  ["operator", "for_mounted"].includes(one.action) ? { ...one, check: "", place: "", remedy: "" } : one);
const refusing = (count) => `${count} ${count === 1 ? "thing refuses" : "things refuse"} the start`;

const FILL = {
  title: "Was a full syringe put in?", yes: "Yes, it is full", no: "Not yet",
  text: "The printer then counts its ink from full. Say how full another one is on the Printer page.",
};
const CROSS = {
  title: "Print through written vessels?", yes: "Accept the crossings", danger: true,
  text: "The needle's shaft may tear what it passes through. The journal keeps that it was accepted.",
};

// What can be done about a refusal at the page, else where to do it.
function Remedy(all) {
  const { one, job, form, record, refresh } = all;
  const act = (words, work, ask) => html`<${Act} work=${work} ask=${ask}>${words}</${Act}>`;
  const post = (words, path, body, ask) => html`
    <${Act} post=${path} body=${body} work=${refresh} ask=${ask}>${words}</${Act}>`;
  const link = (words, href) => html`<${Button} href=${href}>${words}</${Button}>`;
  const touchOff = (words) => link(words, "/printer?tab=needle");
  const remedies = {
    controls: () => post("Take them over", "/controls", { force: true }),
    connect: () => html`${post("Rehearse (simulated)", "/printer/connect", {
      profile: chosen(form, "printer"), port: "simulated" })}${link("Connect a printer …", `/printer?job=${part(job)}`)}`,
    reconnect: () => post("Connect anew", "/printer/reconnect"),
    to_start: () => html`${post("Move the tip to the start", `/jobs/${part(job)}/to-start`, {})}
      ${all.ready?.machine?.touch_off_due && touchOff("Touch off first")}`,
    fill: () => post("A full one was put in", "/printer/mount", { full: true }, FILL),
    reload: () => act("Allow changes of syringe", () => keep(all, { care: { reload: true } })),
    accept_crossings: () => act("Accept the crossings", () => keep(all, { accept_crossings: true }), CROSS),
    mount: () => html`<${Kept} ...${partField(form, one.about)} value=${form.set_up[one.about]}
      save=${(next) => keep(all, { [one.about]: next })} />
      ${all.ready?.machine?.mounted[one.about] === "" && form.set_up[one.about]
        && post(`${chosen(form, one.about)} is mounted`, "/printer/mount", { [one.about]: chosen(form, one.about) })}`,
    for_mounted: () => html`<${Kept} kind="flag" label="The file records no set-up: it was made for what is mounted" value=${false}
      save=${() => send("POST", `/jobs/${part(job)}/for-mounted`, {}).then(refresh)} />`,
    operator: () => html`<${Kept} label="Operator's name" value=${record.operator} maxlength="200" autocomplete="name"
      save=${(operator) => write(all, { operator })} />`,
    see_print: () => link("See it", "/job"),
    touch_off: () => touchOff("Touch off"),
    set_position: () => link("Say where the tip is", "/printer?open=place"),
  };
  return html`<div class="row">${remedies[one.action]?.()}</div>`;
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

async function write({ job, refresh }, changes) {
  await send("PATCH", `/jobs/${part(job)}/record`, changes);
  await refresh();
}

const STERILITY = [{ name: "sterility", kind: "long", label: "Notes on sterility" }];
const CLOCK = { late: "bad", close: "warn", "in time": "good" };

function TheRecord(all) {
  const { job, record } = all;
  const [ago, setAgo] = useState(0);
  const clock = useGet(record.mixed_at === null ? null : `/prints/${part(job)}/viability`, { every: 30_000 });
  const known = RECORD.filter(({ kind }) => !kind).map(({ name }) => record[name]).filter(Boolean);
  const save = (changes) => write(all, changes);
  return html`<${Card} aria-label="Record">
    ${clock.value && html`<${Note} tone=${CLOCK[clock.value.state] ?? "info"}>${clock.value.words}</${Note}>`}
    <${Fold} title=${known.length ? `Record: ${known.join(", ")}` : "Record: operator, lots, cells, notes"}>
    <${Fields} fields=${RECORD} of=${record} save=${save} />
    <div class="row row-end">
      <${Field} kind="number" label="Cells were mixed … ago" unit="min" min="0" max="10000" value=${ago}
        onChange=${setAgo} />
      <${Act} work=${() => save({ mixed_at: Date.now() / 1000 - 60 * (ago ?? 0) })}>
        Start the clock of the cells</${Act}>
      ${record.mixed_at !== null && html`<span class="quiet">mixed ${when(record.mixed_at)}</span>`}
    </div>
    <${Fields} fields=${STERILITY} of=${record} save=${save} />
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
  const watch = ready?.machine?.simulated ? "" : " Stay within reach of EMERGENCY STOP.";
  return html`<${Step} at="4" title="Start">
    <${Act} kind="main" post=${`/prints/${part(job)}/start`} body=${{ confirmed: words }} work=${reload} why=${why}
      ask=${{ title: "Start the print?", yes: "Yes, start it",
        text: `${words} will move now and write ${nameOf(job)}${lasts}.${watch}` }}>
      ${words ? `Start on ${words} …` : "Start …"}</${Act}>
    ${why && html`<p class="hint">${why}</p>`}
  </${Step}>`;
}
