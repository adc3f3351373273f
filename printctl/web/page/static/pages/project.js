// The guided way of one project: shape, check, print or rehearse, judge. The server knows how far it
// has come; whoever leaves and comes back finds it where it was.
import { part, send } from "../api.js";
import { Frame } from "../frame.js";
import { SketchView } from "../sketch_view.js";
import {
  Act, Badge, Button, Card, Empty, Facts, Field, Fold, Loaded, Note, Page, Progress, Table, go, html, number, sentence,
  span, useEffect, useGet, useKept, useLayoutEffect, useNews, useRef, useState, useStyle,
} from "../ui.js";

const STEPS = [
  ["shape", "Shape"], ["check", "Check"], ["print", "Print"], ["judge", "Judge"],
];
const BUSY = ["starting", "running"];
const busy = (project) => BUSY.includes(project.run.state);

export default function Project({ name, step }) {
  useStyle("pages/project.css");
  const got = useGet(`/projects/${part(name ?? "")}`);
  const working = got.value !== null && busy(got.value);
  useEffect(() => { // a run tells nothing by itself: it is asked, about as often as it says something
    if (!working) return undefined;
    const timer = setInterval(got.reload, 1000);
    return () => clearInterval(timer);
  }, [working]);
  const worked = useRef(false);
  useEffect(() => { // what was made or rehearsed is shown where it leads to
    if (worked.current && !working) to(got.value, ["print", "judge"].includes(step) ? next(got.value) : "check", true);
    worked.current = working;
  }, [working]);
  return html`<${Page} title=${name} tools=${html`<${Button} href=${`/design?recipe=${part(name ?? "")}`}>All settings</${Button}>`}>
    <${Loaded} of=${got} what="Opening the project">${(project) => html`
      <${Way} project=${project} chosen=${step} reload=${got.reload} />`}</${Loaded}>
  </${Page}>`;
}

// What comes next of itself; a finished project stands at its report.
const next = (project) => (project.step === "done" ? "judge" : project.step);
const reached = (project, id) => STEPS.findIndex(([one]) => one === next(project)) >= STEPS.findIndex(([one]) => one === id);

function Way({ project, chosen, reload }) {
  const at = STEPS.some(([id]) => id === chosen) ? chosen : next(project);
  const Step = { shape: Shape, check: Check, print: Print, judge: Judge }[at];
  const done = (id) => project.made && !busy(project) && (project.step === "done" || (reached(project, id) && id !== next(project)));
  return html`
    <nav aria-label="Steps"><ol class="steps">
      <li class="step step-done"><a href="/"><span class="step-mark" aria-hidden="true">✓</span>Choose</a></li>
      ${STEPS.map(([id, title], k) => html`
      <li key=${id} class=${`step ${done(id) ? "step-done" : ""}`}>
        <a href=${`/project?name=${part(project.name)}&step=${id}`} aria-current=${id === at ? "step" : undefined}>
          <span class="step-mark" aria-hidden="true">${done(id) ? "✓" : k + 2}</span>${title}${done(id) && html`<span class="unseen"> (done)</span>`}</a></li>`)}
    </ol></nav>
    ${project.problems.length > 0 && html`<${Note} tone="bad"><p>The recipe can't be used as it stands:</p>
      <ul>${project.problems.map((one) => html`<li>${one}</li>`)}</ul>
      <${Button} href=${`/design?recipe=${part(project.name)}`}>Mend it on the page Design</${Button}></${Note}>`}
    <${Step} project=${project} reload=${reload} />`;
}

const to = (project, step, replace = false) => go(`/project?name=${part(project.name)}&step=${step}`, replace);

// --- shape -------------------------------------------------------------------------------------

function Shape({ project, reload }) {
  const [values, setValues] = useState({});
  const sketch = useSketch(project, values);
  const changed = Object.keys(values).length > 0;
  const make = async () => {
    if (changed) await send("PATCH", `/projects/${part(project.name)}`, { values });
    await send("POST", `/runs/${part(project.name)}/start`, {});
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
      ${changed && html`<${Button} onClick=${() => setValues({})}>Back to what was saved</${Button}>`}
      ${ready ? html`<${Button} kind="main" onClick=${() => to(project, "check")}>Next: look at the checks</${Button}>`
        : html`<${Act} kind="main" work=${make} disabled=${busy(project) || project.problems.length > 0}>${changed ? "Save and make it" : "Make it"}</${Act}>`}
    </${Card}>
  </div>`;
}

// Many-fold ranges are dragged by their logarithm.
function Slide({ one, value, onChange }) {
  const fold = one.least > 0 && one.most / one.least > 50;
  const [up, down] = fold ? [Math.log, Math.exp] : [(x) => x, (x) => x];
  const told = (x) => onChange(Number((Math.round(down(x) / one.step) * one.step).toPrecision(6)));
  return html`<div class="slide">
    <${Field} label=${one.label} kind="slider" hint=${one.hint} value=${up(value)} min=${up(one.least)} max=${up(one.most)}
      step=${fold ? "any" : one.step} onChange=${told} aria-valuetext=${`${number(value)} ${one.unit}`} />
    <span class="slide-value">${number(value)} ${one.unit}</span></div>`;
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
      const asked = waiting.current;
      waiting.current = null;
      setState((old) => ({ ...old, loading: true }));
      try {
        const value = await send("POST", `/projects/${part(project.name)}/sketch`, { values: asked, known: known.current });
        known.current = value.tissue;
        setState((old) => ({ value, outline: value.outline ?? old.outline, problem: null, loading: false }));
      } catch (problem) {
        setState((old) => ({ ...old, value: null, problem, loading: false }));
      }
    }
    going.current = false;
  };
  useLayoutEffect(() => { // a frame earlier than an effect
    waiting.current = values;
    if (!project.problems.length) grow();
  }, [JSON.stringify(values), project.problems.length]);
  return state;
}

// --- check -------------------------------------------------------------------------------------

function Check({ project, reload }) {
  if (busy(project)) return html`<${Making} project=${project} reload=${reload} />`;
  if (!project.made) return html`<${NotMade} project=${project} reload=${reload} />`;
  const failed = project.checks.filter((one) => !one.passed);
  const refused = failed.filter((one) => one.refuses);
  const passed = project.checks.filter((one) => one.passed);
  return html`
    <${Card} title=${refused.length ? `${refused.length} of ${project.checks.length} checks refuse the print`
      : `All ${project.checks.length} checks let it be printed`} tone=${refused.length ? "bad" : undefined}>
      ${failed.length > 0 && html`<ul class="list">${failed.map((one) => html`<${Finding} one=${one} project=${project} />`)}</ul>`}
      <div class="row">
        <${Button} kind=${refused.length ? "quiet" : "main"} onClick=${() => to(project, "print")}
          why=${refused.length ? "something refuses the print" : ""}>Next: print or rehearse</${Button}>
        <${Button} onClick=${() => to(project, "shape")}>Change the shape</${Button}></div>
      <${Fold} title=${`${passed.length} checks passed`}><${Table} caption="Checks that passed" rows=${passed} columns=${[
        { name: "Check", of: (one) => sentence(one.check) }, { name: "Found", number: true, of: (one) => `${number(one.value)} ${one.unit}` },
        { name: "Limit", number: true, of: (one) => `${number(one.limit)} ${one.unit}` }, { name: "Where", of: (one) => one.place },
      ]} /></${Fold}>
    </${Card}>
    <${Look} project=${project} pages=${[["network", "Network"], ["layers", "Print, line by line"], ["dry_run", "Dry run"]]} />`;
}

function Finding({ one, project }) {
  return html`<li class="stack">
    <div class="row"><${Badge} tone=${one.refuses ? "bad" : "warn"}>${one.refuses ? "refuses" : "note"}</${Badge}><b>${sentence(one.check)}</b>
      ${one.value !== null && html`<span>${number(one.value)}${one.unit && ` ${one.unit}`}, limit ${number(one.limit)}</span>`}
      <span class="quiet">${one.place}</span></div>
    ${one.remedy && html`<p>${sentence(one.remedy)}.</p>`}
    ${one.refuses && html`<div class="row"><${Button} onClick=${() => to(project, "shape")}>Change the shape</${Button}>
      <${Button} href=${`/design?recipe=${part(project.name)}`}>All settings</${Button}></div>`}
  </li>`;
}

function NotMade({ project, reload }) {
  const failed = project.run.stages.find((one) => one.state === "failed");
  const make = async () => {
    await send("POST", `/runs/${part(project.name)}/start`, {});
    reload();
  };
  return html`<${Card} title=${failed ? "It can't be made as it stands" : "Not made yet, as the recipe stands now"} tone=${failed ? "bad" : undefined}>
    ${failed && html`<p><b>${failed.name}</b>: ${failed.note || project.run.message}</p>`}
    ${!failed && project.run.message && html`<p>${project.run.message}</p>`}
    <div class="row">${failed ? html`<${Button} kind="main" onClick=${() => to(project, "shape")}>Change the shape</${Button}>
      <${Button} href=${`/design?recipe=${part(project.name)}`}>All settings</${Button}>` : null}
      <${Act} kind=${failed ? "quiet" : "main"} work=${make}>${failed ? "Try again" : "Make it"}</${Act}></div>
  </${Card}>`;
}

function Making({ project, reload, title = "Making it" }) {
  const cancel = async () => {
    await send("POST", `/runs/${part(project.run.name)}/cancel`, {});
    reload();
  };
  const share = project.run.stages.length ? project.run.stages.reduce((sum, one) => sum + one.fraction, 0) / project.run.stages.length : undefined;
  const kept = project.run.stages.filter((one) => one.state === "done" && one.note.startsWith("unchanged"));
  return html`<${Card} title=${title} tools=${html`<${Act} work=${cancel}>Cancel</${Act}>`}>
    <${Progress} share=${share} label=${title} />
    ${kept.length > 0 && html`<p class="quiet">Made before and unchanged: ${kept.map((one) => one.name).join(", ")}.</p>`}
    <ol class="stages">${project.run.stages.filter((one) => !kept.includes(one)).map((one) => html`<li key=${one.name} class=${`stage stage-${one.state}`}>
      <span>${one.name}</span><span class="quiet">${one.state === "waiting" ? "" : one.note || one.state}</span></li>`)}</ol>
    ${!project.run.stages.length && html`<p class="quiet">Starting …</p>`}
  </${Card}>`;
}

// Pages of the run, each in a frame as tall as the window leaves.
function Look({ project, pages }) {
  const [page, setPage] = useState(null);
  return html`<${Card} title="Look at it" tools=${pages.map(([id, title]) => html`
      <${Button} key=${id} aria-pressed=${String(page === id)} onClick=${() => setPage(page === id ? null : id)}>${title}</${Button}>`)}>
    ${page ? html`<${Frame} title=${page} src=${`/api/v1/runs/${part(project.name)}/pages/${page}`} />`
      : html`<${Empty}>Choose what to see.</${Empty}>`}
  </${Card}>`;
}

// --- print -------------------------------------------------------------------------------------

function Print({ project, reload }) {
  const [kept, setKept] = useKept("rehearsal.speed", null);
  const print = useNews("print");
  if (busy(project)) return html`<${Rehearsing} project=${project} reload=${reload} print=${print} />`;
  if (!project.made) return html`<${NotMade} project=${project} reload=${reload} />`;
  const speed = kept ?? project.rehearsal_speed;
  const took = (at) => (at ? span(project.print_time_s / at) : "as fast as it can");
  const choices = [...new Set([1, 10, project.rehearsal_speed, 100, 0])].sort((a, b) => (a || Infinity) - (b || Infinity));
  const rehearse = async () => {
    await send("POST", `/projects/${part(project.name)}/rehearse`, { speed });
    reload();
  };
  const again = Boolean(project.judged) && project.judged !== project.name;
  return html`<div class="columns">
    <${Card} title="Rehearse it">
      <p>The real program prints on a simulated printer, a simulated scanner scans what came out, and the report judges it.
        Nothing needs to be connected, and nothing moves.</p>
      <${Field} label="How fast" kind="choice" value=${String(speed)} onChange=${(value) => setKept(Number(value))}
        options=${choices.map((one) => [String(one), one ? `${one} × real time: the print takes ${took(one)}` : "as fast as it can"])} />
      <${Act} kind="main" work=${rehearse}>${again ? "Rehearse again" : "Rehearse"}</${Act}>
    </${Card}>
    <${Card} title="Print it">
      <p>On a printer of yours: ${span(project.print_time_s)} of print. The page Job lists all that must be ready before the
        start, then follows the print.</p>
      <${Button} href=${`/job?job=${part(`run~${project.name}`)}`}>Prepare the print</${Button}>
      ${project.print_state === "done" && html`<${Button} onClick=${() => to(project, "judge")}>Next: judge the print</${Button}>`}
    </${Card}>
  </div>`;
}

function Rehearsing({ project, reload, print }) {
  const printing = project.run.stages.find((one) => one.name === "print");
  const job = `run~${project.run.name}`;
  const live = print?.job === job && !print.ended;
  return html`<${Making} project=${project} reload=${reload} title=${printing ? "Rehearsing" : "Making it"} />
    ${printing?.state === "running" && html`<${Note}><p>It prints now${live && Number.isFinite(print.share) ? `: ${(100 * print.share).toFixed(0)} %` : ""}.
      ${" "}The page Job shows it as it would show a real one.</p>
      <${Button} kind="main" href=${`/job?job=${part(job)}`}>Watch it print</${Button}></${Note}>`}`;
}

// --- judge -------------------------------------------------------------------------------------

function Judge({ project, reload }) {
  if (busy(project)) return html`<${Rehearsing} project=${project} reload=${reload} />`;
  if (project.has_report) return html`<${Report} project=${project} />`;
  const printed = project.print_state === "done";
  const judge = async () => {
    await send("POST", `/runs/${part(project.name)}/continue`);
    reload();
  };
  return html`<${Card} title=${printed ? "Printed; now scan it" : "Nothing to judge yet"}>
    ${printed ? html`<p>Scan the part and drop the scan on the page Scan, or have the scan made that the recipe names.</p>
      <div class="row"><${Button} kind="main" href=${`/scan?run=${part(project.name)}`}>Take in a scan</${Button}>
        <${Act} work=${judge}>Take the recipe's own scan</${Act}></div>`
      : html`<p>First it is printed or rehearsed.</p><div class="row"><${Button} kind="main" onClick=${() => to(project, "print")}>Back to Print</${Button}></div>`}
  </${Card}>`;
}

function Report({ project }) {
  const address = `/api/v1/runs/${part(project.judged)}/pages/report`;
  const what = project.judged === project.name ? "print" : "rehearsal";
  return html`
    <${Card} title=${`The ${what} ${project.passed ? "is" : "isn't"} as designed`} tone=${project.passed ? undefined : "bad"}
      tools=${html`<${Button} href=${address} target="_blank">Open the report in a tab of its own</${Button}>`}>
      <ul class="reasons">${project.reasons.slice(0, 5).map((one) => html`<li>${one}</li>`)}</ul>
      <${Fold} title="What next">
        <div class="row"><${Button} onClick=${() => to(project, "shape")}>Change the shape</${Button}>
          <${Button} onClick=${() => to(project, "print")}>Print it again</${Button}>
          <${Button} href="/history">All prints</${Button}></div></${Fold}>
    </${Card}>
    <${Frame} title="Report" whole src=${address} />`;
}
