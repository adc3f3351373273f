// Console and macros.
import { get, listen, part, send } from "../api.js";
import {
  Act, Ask, Button, Card, Empty, Field, Fields, Loaded, Refused, html, useAction, useEffect, useGet, useRef, useState,
} from "../ui.js";
import { post } from "./printer_move.js";

const SHOWN = 100;

// What was typed, answered and refused, of all browsers.
export function Log() {
  const [entries, setEntries] = useState([]);
  const box = useRef(null);
  useEffect(() => {
    let newest = 0;
    let running = Promise.resolve();
    const more = () => {
      running = running.then(async () => {
        const fresh = await get(`/printer/console?after=${newest}`).catch(() => []);
        if (!fresh.length) return;
        newest = fresh[fresh.length - 1].number;
        setEntries((old) => [...old, ...fresh].slice(-SHOWN));
      });
    };
    more();
    return listen((one) => (one.event === "console" || (one.event === "lost" && !one.lost)) && more());
  }, []);
  useEffect(() => { box.current.scrollTop = box.current.scrollHeight; }, [entries]);
  return html`<div class="printer-log mono" role="log" tabindex="0" ref=${box}
      aria-label="Console: commands and replies">
    ${entries.length === 0 && html`<p class="quiet">Nothing was typed yet.</p>`}
    ${entries.map((one) => html`<div key=${one.number}>
      <p><strong>${new Date(1000 * one.at_s).toTimeString().slice(0, 8)} ${one.who} > ${one.text}</strong></p>
      ${one.replies.map((text, at) => html`<p key=${at}>${text}</p>`)}
      ${one.refused && html`<p class="problem">refused: ${one.refused}</p>`}
    </div>`)}
  </div>`;
}

export function Console({ fold }) {
  const [text, setText] = useState("");
  const typed = useRef([]);
  const at = useRef(0);
  const [go, { busy, problem }] = useAction(() => {
    const line = text.trim();
    if (!line) return null;
    if (typed.current.at(-1) !== line) typed.current.push(line);
    at.current = typed.current.length;
    setText("");
    return post("command", { text: line });
  });
  const recall = (event) => {
    const by = { ArrowUp: -1, ArrowDown: 1 }[event.key];
    if (!by) return;
    event.preventDefault();
    at.current = Math.min(typed.current.length, Math.max(0, at.current + by));
    setText(typed.current[at.current] ?? "");
  };
  return html`<${Card} title="Console" fold=${fold && "printer.console"} folded aria-label="Console">
    <${Log} />
    <form class="row row-end" onSubmit=${(event) => { event.preventDefault(); go(); }}>
      <div class="grow"><${Field} label="Command" value=${text} onChange=${setText} onKeyDown=${recall}
        placeholder="M115" class="mono" autocomplete="off" spellcheck="false" maxlength="200" /></div>
      <${Button} busy=${busy} onClick=${go}>Send</${Button}>
    </form>
    <${Refused} problem=${problem} />
    <p class="hint">What would break the count of lines or the position is refused. Arrow Up brings back what you
      typed.</p>
  </${Card}>`;
}

export function Macros({ status: { printer: profile } }) {
  const kept = useGet(`/printer/macros/${part(profile)}`);
  const [edited, setEdited] = useState(null);
  const close = () => {
    setEdited(null);
    kept.reload();
  };
  return html`<${Card} title="Macros" aria-label="Macros">
    <${Loaded} of=${kept} what="Reading macros">${({ macros }) => html`
      ${macros.length === 0
        ? html`<${Empty}>${profile} has none yet. A macro is commands as you would type them, under a name.</${Empty}>`
        : html`<p class="hint">Of ${profile}; sent like typed commands, until one is refused.</p>`}
      ${macros.map((one) => html`<div key=${one.name} class="row row-top">
        <${Act} post=${`/printer/macros/run/${part(one.name)}`}>${one.name}</${Act}>
        <${Button} aria-label=${`Edit ${one.name}`} onClick=${() => setEdited(one)}>Edit</${Button}>
      </div>`)}`}</${Loaded}>
    <div><${Button} onClick=${() => setEdited({ name: "", commands: [] })}>New macro …</${Button}></div>
    ${edited && html`<${MacroDialog} profile=${profile} macro=${edited} onClose=${close} />`}
  </${Card}>`;
}

const MACRO = [
  { name: "name", label: "Name", maxlength: 40 },
  { name: "text", kind: "long", label: "Commands, one a line", class: "mono", spellcheck: "false" },
];

function MacroDialog({ profile, macro, onClose }) {
  const [said, setSaid] = useState({ name: macro.name, text: macro.commands.join("\n") });
  const path = `/printer/macros/${part(profile)}`;
  const remove = () => send("DELETE", `${path}/${part(macro.name)}`);
  const save = async () => {
    const name = said.name.trim();
    const commands = said.text.split("\n").map((one) => one.trim()).filter(Boolean);
    if (!name || !commands.length) throw new Error("A macro has a name and at least one command.");
    await send("PUT", path, { name, commands });
    if (macro.name && macro.name !== name) await remove();
  };
  return html`<${Ask} title="Macro" yes="Save" work=${save} onClose=${onClose} tools=${macro.name && html`
      <${Act} kind="danger" work=${() => remove().then(onClose)}>Remove</${Act}>`}>
    <${Fields} fields=${MACRO} of=${said} onChange=${setSaid} />
  </${Ask}>`;
}
