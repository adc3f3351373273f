// Set up a printer: the steps of `printctl commission`, one question at a time. The server keeps how far it has come.
import { part, send } from "../api.js";
import {
  Badge, Bullets, Button, Card, Field, Fold, Loaded, Loading, Note, Page, Refused, go, html, useAction, useEffect,
  useGet, useState, useStyle,
} from "../ui.js";

const WORDS = { done: ["good", "done"], failed: ["bad", "to be done again"], open: ["info", "open"] };
const NAME = /^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$/;

export default function Commission({ printer = "" }) {
  useStyle("pages/commission.css");
  return html`<${Page} title="Set up a printer" tools=${html`<${Button} href="/printer">To the Printer page</${Button}>`}>
    ${printer ? html`<${Way} key=${printer} name=${printer} />` : html`<${Choose} />`}
  </${Page}>`;
}

function Choose() {
  const own = useGet("/commissioning");
  const [name, setName] = useState("my_printer");
  const open = (one) => go(`/commission?printer=${part(one)}`);
  return html`<${Card} title="Which printer?" class="card commission-narrow">
    <p>Nine steps, each ended by a check: profile, connection, plunger steps, mounted parts, touch-off, first lines,
      first part, first scan, correction. What moves, pushes or writes asks first. You can stop at any time and go on
      later, here or by <code>printctl commission</code>.</p>
    <${Field} label="Name of the printer" value=${name} onChange=${setName}
      problem=${name && !NAME.test(name) ? "Use letters, digits, “.”, “_” or “-”." : ""} />
    <div><${Button} kind="main" disabled=${!NAME.test(name)} onClick=${() => open(name)}>Begin</${Button}></div>
    <${Loaded} of=${own} what="Reading printers">${(names) => names.length > 0 && html`
      <p>Go on with: ${names.map((one) => html`<${Button} key=${one} onClick=${() => open(one)}>${one}</${Button}> `)}</p>`}
    </${Loaded}>
  </${Card}>`;
}

function Way({ name }) {
  const path = `/commissioning/${part(name)}`;
  const got = useGet(path, { every: (state) => state?.working && 700 });
  return html`<${Loaded} of=${got} what="Reading the steps">${(state) => html`<div class="commission">
    <${Card} title=${`Steps of ${name}`}><ol class="commission-steps">${state.steps.map((one) => html`
      <${Step} key=${one.key} step=${one} next=${one.key === state.next} path=${path} reload=${got.reload}
        locked=${state.working} />`)}</ol></${Card}>
    <${Now} state=${state} path=${path} reload=${got.reload} />
  </div>`}</${Loaded}>`;
}

function Step({ step, next, path, reload, locked }) {
  const [tone, word] = WORDS[step.state];
  const [again, { problem }] = useAction(() => send("POST", path, { begin: step.key }).then(reload));
  return html`<li aria-current=${next ? "step" : undefined}>
    <div class="row"><strong class="grow">${step.title}</strong><${Badge} tone=${tone}>${word}</${Badge}></div>
    <p class="quiet">${step.message || `Check: ${step.check}.`}</p>
    ${step.state === "done" && html`<${Fold} title="Do it again">
      <p>This step and those after it are opened again.</p>
      <${Button} disabled=${locked} onClick=${again} aria-label=${`Begin again: ${step.title}`}>Begin again here</${Button}>
      <${Refused} problem=${problem} /></${Fold}>`}
  </li>`;
}

function Now({ state, path, reload }) {
  const step = state.steps.find((one) => one.key === state.next);
  const [run, { busy, problem }] = useAction((answers) => send("POST", path, { answers }).then(reload));
  if (!step) {
    return html`<${Card} title="The printer is set up"><p>Profile, ink and correction are in ${state.folder}.</p>
      <${Button} kind="main" href="/printer">Connect it</${Button}></${Card}>`;
  }
  const { question } = state;
  return html`<${Card} title=${step.title} aria-label="What to do next">
    <p>To do: ${step.how}. Needs ${step.needs}. Check: ${step.check}.</p>
    ${state.problem && html`<${Note} tone="bad">${state.problem}</${Note}>`}
    ${state.working ? html`<${Loading} what="At work; EMERGENCY STOP above halts the printer" />`
      : question ? html`<${Answer} key=${question.key + question.text} question=${question} run=${run} busy=${busy} />`
        : html`<div><${Button} kind="main" busy=${busy} onClick=${() => run({})}>
          ${step.state === "failed" || state.problem ? "Try again" : "Go on"}</${Button}></div>`}
    ${step.key === "touch-off" && !state.working && html`<p class="hint">You may also touch the floor off by the
      <a href="/printer?tab=needle">tab Touch off</a>; its height is then proposed here.</p>`}
    <${Refused} problem=${problem} />
    ${state.said.length > 0 && html`<${Bullets} rows=${state.said} />`}
  </${Card}>`;
}

// A confirmation has buttons, and none is chosen beforehand; all else a field with what is usual.
function Answer({ question, run, busy }) {
  const { key, text, choices, acts } = question;
  const [value, setValue] = useState(question.default);
  useEffect(() => setValue(question.default), [question.default]);
  const give = (answer) => run({ [key]: answer });
  if (acts) {
    return html`<${Note} tone="warn">${text}</${Note}>
      <div><${Button} kind="main" busy=${busy} onClick=${() => give("yes")}>Yes, do it</${Button}></div>`;
  }
  const options = choices.map((one) => [one, one]);
  const field = options.length ? { kind: "choice", options: value ? options : [["", "choose"], ...options] } : {};
  const submit = (event) => {
    event.preventDefault();
    give(value);
  };
  return html`<form class="stack" onSubmit=${submit}>
    <${Field} label=${text} value=${value} onChange=${setValue} ...${field} />
    <div><button type="submit" class="button button-main" disabled=${busy || !value}>Next</button></div>
  </form>`;
}
