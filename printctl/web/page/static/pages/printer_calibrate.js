// Calibrations: what each needs; a test to print, a sheet to fill in, what the readings say.
import { part } from "../api.js";
import {
  Act, Bullets, Button, Card, Facts, Field, Fields, Fold, Loaded, Note, Table, html, span, useGet, useKept, useState,
} from "../ui.js";
import { mm, post } from "./printer_move.js";

export function Calibration({ status }) {
  const all = useGet("/printer/calibrations");
  const [name, setName] = useState(null);
  return html`<${Loaded} of=${all} what="Reading calibrations">${(list) => {
    const wizard = list.find((one) => one.name === name);
    if (wizard) return html`<${Wizard} key=${name} wizard=${wizard} status=${status} onBack=${() => setName(null)} />`;
    const here = list.filter((one) => one.columns.length);
    const elsewhere = list.filter((one) => !one.columns.length);
    return html`<${Card} title="Calibration" aria-label="Calibration">
      <p class="hint">The same tests and fits as <code>printctl calibrate</code>; every number with its interval.</p>
      <ul class="list">${here.map((one) => html`<li key=${one.name} class="row printer-line">
        <div class="grow"><strong>${one.title}</strong>
          <p class="quiet">Needs ${one.needs}; gives ${one.gives}.</p></div>
        <${Button} aria-label=${`Start: ${one.title}`} onClick=${() => setName(one.name)}>Start …</${Button}>
      </li>`)}</ul>
      <${Fold} title="By the command line">
        <${Facts} rows=${elsewhere.map((one) => [one.title, html`<code>printctl calibrate ${one.name}</code>
          <span class="quiet"> needs ${one.needs}; gives ${one.gives}</span>`])} />
      </${Fold}>
    </${Card}>`;
  }}</${Loaded}>`;
}

const names = (list, name) => (list ?? [{ name }]).map((one) => one.name);

// The sheet stays in this browser: a weighing takes an hour, and is done at the balance.
function Wizard({ wizard, status, onBack }) {
  const profiles = useGet(wizard.printed ? "/printer/profiles" : null);
  const parts = useGet(wizard.printed ? "/printer/parts" : null);
  const [{ rows, made, tested }, keep] = useKept(`calibration.${wizard.name}`, { rows: [], made: null, tested: null });
  const [used, setUsed] = useState(tested ?? { printer: status.printer, syringe: status.parts.syringe });
  const [density, setDensity] = useState(0.998);
  const [result, setResult] = useState(null);
  const weighs = wizard.name === "weigh";
  const { printer, syringe } = used;
  const fit = async () => setResult(await post(`calibrations/${wizard.name}/fit`, read()));
  const make = async () => {
    if (!syringe) throw new Error("Choose the syringe that is mounted.");
    if (!status.position_mm) throw new Error("Where the tip stands isn't known: home it, or say where it is.");
    const test = await post(`calibrations/${wizard.name}/job`, { ...used, at_mm: status.position_mm });
    keep({ rows: test.rows, made: test, tested: used });
  };
  const read = () => {
    const filled = rows.map((row) => row.map((cell) => cell.trim())).filter((row) => row.at(-1));
    if (!filled.length) throw new Error(`Fill in the last column, ${wizard.columns.at(-1)}.`);
    return { rows: filled, ...used, ...(made ? { job: made.job } : {}), ...(weighs && density ? { density_g_cm3: density } : {}) };
  };
  const again = () => {
    keep({ rows: [], made: null, tested: null });
    setResult(null);
  };
  return html`<${Card} title=${wizard.title} aria-label=${wizard.title}
      tools=${html`<${Button} onClick=${onBack}>Back to the list</${Button}>`}>
    <p>Needs ${wizard.needs}.</p>
    ${wizard.printed && html`
      <${Fields} of=${used} onChange=${setUsed} fields=${[
        { name: "printer", kind: "choice", label: "Printer profile", options: names(profiles.value, printer) },
        { name: "syringe", kind: "choice", label: "Syringe", options: [
          ...(syringe ? [] : [["", "not known: choose one"]]), ...names(parts.value?.syringe, syringe)] },
      ]} />
      <${Act} kind=${made ? "quiet" : "main"} work=${make}>Make the test's G-code</${Act}>
      ${made && html`<${Note} tone="good">
        <p>${made.job}: ${made.lines} lines, ${span(made.duration_s)}, from X, Y, Z
          ${" "}${made.start_mm.map(mm).join(", ")} mm.${" "}
          <a href=${`/job?job=${part(made.job)}`}>Print it on the Job page</a>, then fill in the last column.</p>
        <${Bullets} rows=${made.notes} />
      </${Note}>`}`}
    <div class="columns">
      <${Sheet} wizard=${wizard} rows=${rows} tip=${status.position_mm}
        onRows=${(next) => keep({ rows: next, made, tested })} />
      <div class="stack">
        ${weighs && html`<${Field} kind="number" label="Density" unit="g/cm³" min=${0.1} max=${20} value=${density}
          onChange=${setDensity} />`}
        ${rows.length > 0 && html`<div class="row row-top">
          <${Act} kind="main" work=${fit}>What do they say?</${Act}>
          <${Button} onClick=${again}>Empty the sheet</${Button}></div>`}
        ${result && html`<div class="stack" role="status">
          <${Facts} rows=${Object.entries(result.estimates).map(([name, one]) => [name, estimate(one)])} />
          <p class="hint">In brackets: 95 % intervals. ${result.notes.join("; ")}.</p>
        </div>`}
        ${result && wizard.writes.length > 0 && html`<${Fold} title="Write it into a copy of a profile">
          <${Copy} printer=${printer} syringe=${syringe} read=${read} /></${Fold}>`}
      </div>
    </div>
  </${Card}>`;
}

function Sheet({ wizard, rows, tip, onRows }) {
  const [word, setWord] = useState(wizard.name === "level" ? "bed" : "");
  const add = (cells) => onRows([...rows, cells]);
  const write = (row, column, text) => onRows(rows.with(row, rows[row].with(column, text)));
  const columns = wizard.columns.map((name, column) => ({ name, of: ({ cells, row }) => html`<div class="field">
    <input value=${cells[column]} aria-label=${`${name}, row ${row + 1}`} maxlength="24"
      onInput=${(event) => write(row, column, event.target.value)} /></div>` }));
  const remove = { name: "", of: ({ row }) => html`<${Button} aria-label=${`Remove row ${row + 1}`}
    onClick=${() => onRows(rows.toSpliced(row, 1))}>×</${Button}>` };
  return html`<div class="stack">
    ${rows.length > 0 && html`<div class="printer-sheet"><${Table} caption="Readings" tall
      columns=${[...columns, remove]} rows=${rows.map((cells, row) => ({ cells, row }))} /></div>`}
    ${wizard.placed
      ? html`<div class="row row-end">
          <div class="grow">${wizard.name === "level"
            ? html`<${Field} kind="choice" label="Surface" value=${word} onChange=${setWord}
                options=${[["bed", "bed (dry floor)"], "bath"]} />`
            : html`<${Field} label="Needle" value=${word} onChange=${setWord} maxlength="24" />`}</div>
          ${tip && html`<${Button} kind="main" onClick=${() => add([word, ...tip.map((one) => one.toFixed(3))])}>
            Take where the tip is</${Button}>`}</div>`
      : html`<div><${Button} onClick=${() => add(wizard.columns.map(() => ""))}>Add a row</${Button}></div>`}
  </div>`;
}

function Copy({ printer, syringe, read }) {
  const [mend, setMend] = useState("printer");
  const [name, setName] = useState(null);
  const [written, setWritten] = useState("");
  const [accept, setAccept] = useState(false);
  const copy = name ?? `${mend === "printer" ? printer : syringe}_measured`;
  const save = async () => {
    const { message } = await post("calibrations/weigh/profile", {
      read: read(), mend, copy_name: copy, accept_change: accept });
    setWritten(`written: ${message}. Choose it when you connect or say what is mounted from now on.`);
  };
  return html`
    <${Field} kind="choice" label="What is measured" value=${mend} options=${[
      ["printer", `steps/mm of ${printer}, where the bore is right`],
      ["syringe", `bore of ${syringe}, where the steps are right`]]}
      onChange=${(next) => { setMend(next); setName(null); }} />
    <${Field} label="Name of the copy" value=${copy} onChange=${setName} maxlength="64" />
    <${Field} kind="flag" label="Accept a change of more than 20 %" value=${accept} onChange=${setAccept} />
    <${Act} work=${save}>Write the copy</${Act}>
    <p role="status">${written}</p>`;
}

// ``12.3 (12.1 to 12.5) mm``, with digits that the interval deserves.
function estimate({ value, low, high, unit }) {
  const wide = (high - low) / 2;
  const digits = Number.isFinite(wide) && wide > 0 ? Math.max(0, Math.min(8, 1 - Math.floor(Math.log10(wide)))) : 6;
  const [best, least, most] = [value, low, high].map((one) => (one ?? NaN).toFixed(digits));
  return `${best} (${least} to ${most}) ${unit}`.trim();
}
