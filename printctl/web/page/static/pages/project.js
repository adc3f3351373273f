// The guided way of one project: shape, check, print or rehearse, judge. The server knows how far it
// has come; whoever leaves and comes back finds it where it was.
import { part, send } from "../api.js";
import { Frame } from "../frame.js";
import { Pages, Stages, isGoing } from "../runs.js";
import { SketchView } from "../sketch_view.js";
import {
  Act, Badge, Bullets, Button, Card, Empty, Facts, Field, Findings, Fold, Loaded, Note, Page, go, html, number, sentence, span,
  useEnd, useGet, useKept, useLayoutEffect, useNews, useRef, useState, useStyle,
} from "../ui.js";

const STEPS = [["shape", "Shape"], ["check", "Check"], ["print", "Print"], ["judge", "Judge"]];
const busy = (project) => isGoing(project.run);
const wayOf = (project) => `/runs/${part(project.name)}`;
const settings = (name) => `/design?recipe=${part(name ?? "")}`;

export default function Project({ name, step }) {
  useStyle("pages/project.css");
  // A run tells nothing by itself: it is asked, about as often as it says something.
  const got = useGet(`/projects/${part(name ?? "")}`, { every: (project) => project && busy(project) && 1000 });
  const working = got.value !== null && busy(got.value);
  // What was made or rehearsed is shown where it leads to.
  useEnd(working, () => to(got.value, ["print", "judge"].includes(step) ? next(got.value) : "check", true));
  return html`<${Page} title=${name} tools=${html`<${Button} href=${settings(name)}>All settings</${Button}>`}>
    <${Loaded} of=${got} what="Opening the project">${(project) => html`
      <${Way} project=${project} chosen=${step} reload=${got.reload} />`}</${Loaded}>
  </${Page}>`;
}

// What comes next of itself; a finished project stands at its report.
const next = (project) => (project.step === "done" ? "judge" : project.step);

function Way({ project, chosen, reload }) {
  const at = STEPS.some(([id]) => id === chosen) ? chosen : next(project);
  const Step = { shape: Shape, check: Check, print: Print, judge: Judge }[at];
  const due = project.step === "done" ? STEPS.length : STEPS.findIndex(([id]) => id === next(project));
  const done = project.made && !busy(project) ? due : 0; // so many steps
  return html`
    <nav aria-label="Steps"><ol class="steps">
      <li class="step step-done"><a href="/"><span class="step-mark" aria-hidden="true">✓</span>Choose</a></li>
      ${STEPS.map(([id, title], k) => html`
      <li key=${id} class=${`step ${k < done ? "step-done" : ""}`}>
        <a href=${`/project?name=${part(project.name)}&step=${id}`} aria-current=${id === at ? "step" : undefined}>
          <span class="step-mark" aria-hidden="true">${k < done ? "✓" : k + 2}</span>${title}${
          k < done && html`<span class="unseen"> (done)</span>`}</a></li>`)}
    </ol></nav>
    ${project.problems.length > 0 && html`<${Note} tone="bad"><p>The recipe can't be used as it stands:</p>
      <${Bullets} rows=${project.problems} />
      <${Button} href=${settings(project.name)}>Mend it on the Design page</${Button}></${Note}>`}
    <${Step} project=${project} reload=${reload} />`;
}

const to = (project, step, replace = false) => go(`/project?name=${part(project.name)}&step=${step}`, replace);

function Shape({ project, reload }) {
  const [values, setValues] = useState({});
  const sketch = useSketch(project, values);
  const changed = Object.keys(values).length > 0;
  // The version that these values were set against: what another tab saves meanwhile is neither lost nor mixed in.
  const seen = useRef(project.version);
  if (!changed) seen.current = project.version;
  const make = async () => {
    let { current: version } = seen;
    if (changed) {
      ({ version } = await send("PATCH", `/projects/${part(project.name)}`, { values, version }));
      seen.current = version;
    }
    await send("POST", `${wayOf(project)}/start`, { version });
    setValues({});
    reload();
    to(project, "check");
  };
  const ready = project.made && !changed && !busy(project);
  return html`<div class="shape">
    <${Card} title="Vessels in the tissue" tools=${html`<${SketchState} of=${sketch} />`}>
      <${SketchView} sketch=${sketch.value} outline=${sketch.outline} label="Picture of the vessels in the tissue; arrow keys turn it, plus and minus zoom" />
      ${sketch.problem ? html`<${Note} tone="warn"><p>No sketch: ${sketch.problem.message}</p></${Note}>`
        : html`<p class="quiet">Drag to turn. A sketch: what is printed is checked in the next step.</p>`}
    </${Card}>
    <${Card} title="What matters">
      ${project.sliders.length ? project.sliders.map((one) => html`<${Slide} key=${one.path} one=${one} value=${values[one.path] ?? one.value}
        onChange=${(value) => setValues({ ...values, [one.path]: value })} />`)
        : html`<${Empty}>This network comes with its design: there is nothing to drag. All else stands under All settings.</${Empty}>`}
      <${Figures} of=${sketch.value} />
      <div class="row shape-next">
        ${ready ? html`<${Button} kind="main" onClick=${() => to(project, "check")}>Next: look at the checks</${Button}>`
          : html`<${Act} kind="main" work=${make} disabled=${busy(project) || project.problems.length > 0}>
              ${changed ? "Save and make it" : "Make it"}</${Act}>`}
        ${changed && html`<${Button} onClick=${() => { setValues({}); reload(); }}>Back to what was saved</${Button}>`}</div>
    </${Card}>
  </div>`;
}

// Many-fold ranges are dragged by their logarithm.
function Slide({ one, value, onChange }) {
  const fold = one.least > 0 && one.most / one.least > 50;
  const [up, down] = fold ? [Math.log, Math.exp] : [(x) => x, (x) => x];
  const told = (x) => onChange(Number((Math.round(down(x) / one.step) * one.step).toPrecision(6)));
  const words = `${number(value)} ${one.unit}`;
  return html`<${Field} label=${one.label} kind="slider" hint=${one.hint} value=${up(value)} min=${up(one.least)}
    max=${up(one.most)} step=${fold ? "any" : one.step} onChange=${told} shown=${words} aria-valuetext=${words} />`;
}

function SketchState({ of }) {
  if (of.problem) return html`<${Badge} tone="warn">no sketch</${Badge}>`;
  return html`<span class="quiet" role="status">${of.loading ? (of.value ? "growing …" : "growing the first sketch: up to a minute …") : of.value ? `grown in ${of.value.took_ms} ms` : ""}</span>`;
}

function Figures({ of }) {
  if (!of) return null;
  const { vessels, length_mm: length, diameter_min_mm: least, diameter_max_mm: most, volume_mm3: volume } = of.figures;
  return html`<${Facts} rows=${[
    ["Vessels", number(vessels, 6)], ["Length", `${number(length, 4)} mm`],
    ["Diameters", `${number(least, 3)} to ${number(most, 3)} mm`], ["Lumen", `${number(volume, 3)} mm³`],
  ]} />`;
}

// The newest values are sketched; while one sketch is grown, only the last of those that came counts.
function useSketch(project, values) {
  const [state, setState] = useState({ value: null, outline: null, problem: null, loading: false });
  const waiting = useRef(null);
  const going = useRef(false);
  const known = useRef("");
  const grow = async () => {
    if (going.current) return;
    going.current = true;
    while (waiting.current) {
      const asked = { values: waiting.current, known: known.current };
      waiting.current = null;
      setState((old) => ({ ...old, loading: true }));
      await send("POST", `/projects/${part(project.name)}/sketch`, asked).then((value) => {
        known.current = value.tissue;
        setState((old) => ({ value, outline: value.outline ?? old.outline, problem: null, loading: false }));
      }, (problem) => setState((old) => ({ ...old, value: null, problem, loading: false })));
    }
    going.current = false;
  };
  useLayoutEffect(() => { // a frame earlier than an effect
    waiting.current = values;
    if (!project.problems.length) grow();
  }, [JSON.stringify(values), project.problems.length]);
  return state;
}

const VIEWS = [["network", "Network"], ["layers", "Print, line by line"], ["dry_run", "Dry run"]];

const LOADS = ["pressure", "shear_stress", "plunger_force"];

function Check({ project, reload }) {
  if (busy(project)) return html`<${Making} project=${project} reload=${reload} />`;
  if (!project.made) return html`<${NotMade} project=${project} reload=${reload} />`;
  const { passed = [], refused = [], noted = [] } = Object.groupBy(
    project.checks, (one) => (one.passed ? "passed" : one.refuses ? "refused" : "noted"));
  const loads = project.checks.filter((one) => one.value !== null && LOADS.includes(one.kind));
  return html`<div class="columns">
    <${Card} title=${refused.length ? `${refused.length} of ${project.checks.length} checks refuse the print`
      : `All ${project.checks.length} checks let it be printed`} tone=${refused.length ? "bad" : undefined}>
      ${refused.length > 0 && html`<${Findings} rows=${refused} refuses label="What refuses the print" />`}
      ${noted.length > 0 && html`<${Fold} title=${`${noted.length} to know before the print`} open>
        <${Findings} rows=${noted} /></${Fold}>`}
      <div class="row">
        <${Button} kind=${refused.length ? "quiet" : "main"} onClick=${() => to(project, "print")}
          why=${refused.length ? "something refuses the print" : ""}>Next: print or rehearse</${Button}>
        <${Mend} project=${project} main=${refused.length > 0} /></div>
      ${loads.length > 0 && html`<${Facts} rows=${loads.map((one) =>
        [sentence(one.check), `${number(one.value, 3)} ${one.unit}, limit ${number(one.limit, 3)}`])} />`}
      <${Fold} title=${`${passed.length} checks passed`}><${Findings} rows=${passed} /></${Fold}>
    </${Card}>
    <${Card} title="Look at it"><${Pages} run=${project.name} views=${VIEWS} /></${Card}></div>`;
}

const Mend = ({ project, main }) => html`
  <${Button} kind=${main ? "main" : "quiet"} onClick=${() => to(project, "shape")}>Change the shape</${Button}>
  ${main && html`<${Button} href=${settings(project.name)}>All settings</${Button}>`}`;

function NotMade({ project, reload }) {
  const failed = project.run.stages.find((one) => one.state === "failed");
  return html`<${Card} title=${failed ? "It can't be made as it stands" : "Not made yet, as the recipe stands now"} tone=${failed ? "bad" : undefined}>
    ${failed && html`<p><b>${failed.name}</b>: ${failed.note || project.run.message}</p>`}
    ${!failed && project.run.message && html`<p>${project.run.message}</p>`}
    <div class="row">${failed && html`<${Mend} project=${project} main />`}
      <${Act} kind=${failed ? "quiet" : "main"} post=${`${wayOf(project)}/start`} body=${{ version: project.version }}
        work=${reload}>
        ${failed ? "Try again" : "Make it"}</${Act}></div>
  </${Card}>`;
}

function Making({ project, reload, title = "Making it" }) {
  const kept = project.run.stages.filter((one) => one.state === "done" && one.note.startsWith("unchanged"));
  const stages = project.run.stages.filter((one) => !kept.includes(one));
  return html`<${Card} title=${title} tools=${html`
      <${Act} post=${`/runs/${part(project.run.name)}/cancel`} work=${reload}>Cancel</${Act}>`}>
    ${kept.length > 0 && html`<p class="quiet">Made before and unchanged: ${kept.map((one) => one.name).join(", ")}.</p>`}
    <${Stages} of=${{ ...project.run, stages }} />
  </${Card}>`;
}

function Print({ project, reload }) {
  const [kept, setKept] = useKept("rehearsal.speed", null);
  if (busy(project)) return html`<${Rehearsing} project=${project} reload=${reload} />`;
  if (!project.made) return html`<${NotMade} project=${project} reload=${reload} />`;
  const speed = kept ?? project.rehearsal_speed;
  const took = (at) => (at ? span(project.print_time_s / at) : "as fast as it can");
  const choices = [...new Set([1, 10, project.rehearsal_speed, 100, 0])].sort((a, b) => (a || Infinity) - (b || Infinity));
  const again = Boolean(project.judged) && project.judged !== project.name;
  return html`<div class="columns">
    <${Card} title="Rehearse it">
      ${project.rehearsal_broken && html`<${Note} tone="warn"><p>The last rehearsal didn't come to its end: nothing was judged.</p></${Note}>`}
      <p>The real program prints on a simulated printer, a simulated scanner scans what came out, and the report judges it.
        Nothing needs to be connected, and nothing moves.</p>
      <${Field} label="How fast" kind="choice" value=${speed} onChange=${setKept}
        options=${choices.map((one) => [one, one ? `${one} × real time: the print takes ${took(one)}` : "as fast as it can"])} />
      <${Act} kind="main" post=${`/projects/${part(project.name)}/rehearse`}
        body=${{ speed, version: project.version }} work=${reload}>
        ${again ? "Rehearse again" : "Rehearse"}</${Act}>
    </${Card}>
    <${Card} title="Print it">
      <p>On a printer of yours: ${span(project.print_time_s)} of print. The Job page lists all that must be ready before the
        start, then follows the print.</p>
      <${Button} href=${`/job?job=${part(`run~${project.name}`)}`}>Prepare the print</${Button}>
      ${project.print_state === "done" && html`<${Button} onClick=${() => to(project, "judge")}>Next: judge the print</${Button}>`}
    </${Card}>
  </div>`;
}

function Rehearsing({ project, reload }) {
  const print = useNews("print");
  const printing = project.run.stages.find((one) => one.name === "print");
  const job = `run~${project.run.name}`;
  const live = print?.job === job && !print.ended;
  return html`<${Making} project=${project} reload=${reload} title=${printing ? "Rehearsing" : "Making it"} />
    ${printing?.state === "running" && html`<${Note}><p>It prints now${live && Number.isFinite(print.share) ? `: ${(100 * print.share).toFixed(0)} %` : ""}.
      ${" "}The Job page shows it as it would show a real one.</p>
      <${Button} kind="main" href=${`/job?job=${part(job)}`}>Watch it print</${Button}></${Note}>`}`;
}

function Judge({ project, reload }) {
  if (busy(project)) return html`<${Rehearsing} project=${project} reload=${reload} />`;
  if (project.has_report) return html`<${Report} project=${project} />`;
  const printed = project.print_state === "done";
  return html`<${Card} title=${printed ? "Printed; now scan it" : "Nothing to judge yet"}>
    ${printed ? html`<p>Scan the part and drop the scan on the Scan page, or have the scan made that the recipe names.</p>
      <div class="row"><${Button} kind="main" href=${`/scan?run=${part(project.name)}`}>Take in a scan</${Button}>
        <${Act} post=${`${wayOf(project)}/continue`} work=${reload}>Take the recipe's own scan</${Act}></div>`
      : html`<p>First it is printed or rehearsed.</p><div class="row"><${Button} kind="main" onClick=${() => to(project, "print")}>Back to Print</${Button}></div>`}
  </${Card}>`;
}

function Report({ project }) {
  const address = `/api/v1/runs/${part(project.judged)}/pages/report`;
  const what = project.judged === project.name ? "print" : "rehearsal";
  return html`
    <${Card} title=${`The ${what} ${project.passed ? "is" : "isn't"} as designed`} tone=${project.passed ? undefined : "bad"}
      tools=${html`<${Button} href=${address} target="_blank">Open the report in a tab of its own</${Button}>`}>
      ${!project.passed && html`<${Bullets} rows=${project.reasons.slice(0, 5)} />`}
      <${Fold} title="What next">
        <div class="row"><${Button} onClick=${() => to(project, "shape")}>Change the shape</${Button}>
          <${Button} onClick=${() => to(project, "print")}>Print it again</${Button}>
          <${Button} href="/history">All prints</${Button}></div></${Fold}>
    </${Card}>
    <${Frame} title="Report" whole src=${address} />`;
}
