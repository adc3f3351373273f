// The parts that all pages are made of: one of each kind. Preact and htm; see vendor/README.md.
import { h, render, Fragment } from "./vendor/preact.js";
import { useCallback, useEffect, useErrorBoundary, useId, useLayoutEffect, useMemo, useRef, useState } from "./vendor/hooks.js";
import htm from "./vendor/htm.js";
import { get, last, listen, send, upload } from "./api.js";

export const html = htm.bind(h);
export { Fragment, render, useCallback, useEffect, useId, useLayoutEffect, useMemo, useRef, useState };

const classes = (...names) => names.filter(Boolean).join(" ");

// Go to another address of the page.
export function go(address, replace = false) {
  history[replace ? "replaceState" : "pushState"](null, "", address);
  window.dispatchEvent(new PopStateEvent("popstate"));
}

// --- values of the server ----------------------------------------------------------------------

// The value at a path of the API: { value, problem, loading, reload }. Asked for again after any of
// the events `on`, every `every` ms (or what it gives of the value) and with another `key`; what was there stays
// shown meanwhile, with `keep` of another path, too. No path, no question. `reload` resolves with the answer.
export function useGet(path, { on = [], every = 0, key = "", keep = false } = {}) {
  const [state, setState] = useState({ value: null, problem: null, loading: true });
  const turn = useRef(0);
  const reload = useCallback(() => {
    const mine = (turn.current += 1); // an answer that is older than the last question is let go
    const set = (change) => mine === turn.current
      && setState((old) => ({ ...old, loading: false, problem: null, ...change }));
    return path ? get(path).then((value) => set({ value }), (problem) => set({ problem })) : Promise.resolve();
  }, [path]);
  useEffect(() => {
    setState((old) => ({ value: keep ? old.value : null, problem: null, loading: true }));
    return () => { turn.current += 1; };
  }, [path]);
  useEffect(() => { reload(); }, [reload, key]);
  useEffect(() => (on.length ? listen((one) => on.includes(one.event) && reload()) : undefined), [on.join(), reload]);
  const pause = typeof every === "function" ? every(state.value) : every;
  useEffect(() => {
    if (!pause) return undefined;
    const timer = setInterval(() => document.hidden || reload(), pause);
    return () => clearInterval(timer);
  }, [pause, reload]);
  return { ...state, reload };
}

// The last message of an event, null before the first.
export function useNews(event) {
  const [message, setMessage] = useState(() => last(event));
  useEffect(() => {
    setMessage(last(event));
    return listen((one) => one.event === event && setMessage(one));
  }, [event]);
  return message;
}

// Run `work` (async): [run, { busy, problem }]. Pressed twice, it runs once.
export function useAction(work) {
  const [state, setState] = useState({ busy: false, problem: null });
  const running = useRef(false);
  const run = async (...values) => {
    if (running.current) return;
    running.current = true;
    setState({ busy: true, problem: null });
    const problem = await Promise.resolve().then(() => work(...values)).then(() => null, (why) => why);
    running.current = false;
    setState({ busy: false, problem });
  };
  return [run, state];
}

// A style sheet of one page's own, by its path below this folder.
export function useStyle(path) {
  useEffect(() => {
    const href = new URL(path, import.meta.url).pathname;
    if (document.querySelector(`link[href="${href}"]`)) return;
    document.head.append(Object.assign(document.createElement("link"), { rel: "stylesheet", href }));
  }, [path]);
}

// Keep what is shown in the address, without what is empty.
export function useAddress(path, values, known = true) {
  const words = new URLSearchParams(Object.entries(values).filter(([, value]) => value)).toString();
  useEffect(() => {
    if (known && location.pathname === path) history.replaceState(history.state, "", words ? `${path}?${words}` : path);
  }, [words, known]);
}

// A value kept in this browser under a name.
export function useKept(name, first) {
  const key = `printctl.${name}`;
  const [value, setValue] = useState(() => {
    try {
      return JSON.parse(localStorage.getItem(key)) ?? first;
    } catch {
      return first;
    }
  });
  const keep = (next) => {
    setValue(next);
    try {
      localStorage.setItem(key, JSON.stringify(next));
    } catch {
      // A browser that keeps nothing: shown until the page is left.
    }
  };
  return [value, keep];
}

// "light" or "dark", as the page is now.
export function useTheme() {
  const root = document.documentElement;
  const [theme, setTheme] = useState(root.dataset.theme);
  useEffect(() => {
    const watch = new MutationObserver(() => setTheme(root.dataset.theme));
    watch.observe(root, { attributeFilter: ["data-theme"] });
    return () => watch.disconnect();
  }, []);
  return theme;
}

// A typed value that is told when nothing was typed for `pause_ms` (0: however long), or the field is left.
export function useTyped(shown, tell, pause_ms = 500, again = null) {
  const [text, setText] = useState(shown);
  const waiting = useRef(null);
  const now = useRef({});
  Object.assign(now.current, { text, tell });
  const end = () => {
    if (waiting.current === null) return;
    clearTimeout(waiting.current);
    waiting.current = null;
    now.current.tell(now.current.text);
  };
  useEffect(() => { if (waiting.current === null) setText(shown); }, [shown, again]);
  useEffect(() => end, []);
  const type = (next) => {
    setText(next);
    now.current.text = next;
    clearTimeout(waiting.current);
    waiting.current = pause_ms ? setTimeout(end, pause_ms) : -1;
  };
  return { value: text, onChange: type, onBlur: end };
}

// Call `work` when something that went on goes on no more.
export function useEnd(going, work) {
  const before = useRef(false);
  useEffect(() => {
    if (before.current && !going) work();
    before.current = going;
  }, [going]);
}

// The first `count` of a list, and the button that shows the rest.
export function useFew(rows, count) {
  const [all, setAll] = useState(false);
  const more = !all && rows.length > count && html`
    <div><${Button} onClick=${() => setAll(true)}>Show all ${rows.length}</${Button}></div>`;
  return [all ? rows : rows.slice(0, count), more];
}

// --- states --------------------------------------------------------------------------------------

export const Loading = ({ what = "" }) =>
  html`<p class="loading" role="status"><span class="spinner" aria-hidden="true"></span>${what || "Loading"} …</p>`;

export const Failed = ({ problem, again }) => html`<${Note} tone="bad"><p>${problem.message}</p>
  ${again && html`<${Button} onClick=${again}>Try again</${Button}>`}</${Note}>`;

// Why an action was refused, beside its button.
export const Refused = ({ problem }) => problem && html`<p class="problem" role="alert">${problem.message}</p>`;

// A value, or what is left of one that isn't known: grey and struck through, with the reason as the server gives it.
export function Known({ why, children }) {
  const lost = useNews("lost")?.lost && "the server doesn't answer";
  const reason = why || lost;
  if (!reason) return children;
  return html`<span class="unknown" title=${reason}>${children ? html`<s>${children}</s>` : "unknown"}</span>`;
}

export const Empty = ({ children }) => html`<p class="empty">${children}</p>`;

// Shows `children(value)` of what useGet gave, or that it loads or failed.
export function Loaded({ of, what, children }) {
  if (of.problem && of.value === null) return html`<${Failed} problem=${of.problem} again=${of.reload} />`;
  if (of.loading && of.value === null) return html`<${Loading} what=${what} />`;
  return (Array.isArray(children) ? children[0] : children)(of.value);
}

// Names in the workspace that can't be used.
export const Unusable = ({ names }) => names?.length > 0 && html`<${Note} tone="warn">Not shown: ${names.join(", ")}.
  Rename each: 1 to 64 letters a to z, digits, ".", "_" or "-", beginning with a letter or digit.</${Note}>`;

// A sentence that matters: tone is "info", "good", "warn" or "bad".
export const Note = ({ tone = "info", children }) =>
  html`<div class=${`note note-${tone}`} role=${tone === "bad" ? "alert" : undefined}>${children}</div>`;

export const Badge = ({ tone = "info", children }) => html`<span class=${`badge badge-${tone}`}>${children}</span>`;

export const Progress = ({ share, label }) => html`
  <progress class="progress" max="1" value=${share ?? undefined} aria-label=${label}></progress>`;

// --- frames --------------------------------------------------------------------------------------

// The page's name is its h1; cards begin with h2.
export const Page = ({ title, tools, wide, children }) => html`
  <div class=${classes("page", wide && "page-wide")}>
    <div class="page-head"><h1>${title}</h1>${tools && html`<div class="row">${tools}</div>`}</div>
    ${children}
  </div>`;

// A card; with `fold` (a name) it can be folded, which this browser remembers.
export function Card({ title, tools, fold, folded = false, tone, children, ...more }) {
  const [broken] = useErrorBoundary(console.error); // what fails in a card takes nothing else from the page
  const [closed, setClosed] = fold ? useKept(`fold.${fold}`, folded) : [false];
  const id = useId();
  const head = fold ? html`<button type="button" class="fold" aria-expanded=${String(!closed)} aria-controls=${id}
    onClick=${() => setClosed(!closed)}>${title}</button>` : title;
  return html`<section class=${classes("card", tone && `card-${tone}`)} ...${more}>
    ${(title || tools) && html`<div class="card-head">${title && html`<h2>${head}</h2>`}
      ${tools && html`<div class="row">${tools}</div>`}</div>`}
    <div class="card-body" id=${id} hidden=${closed}>${broken
      ? html`<${Failed} problem=${{ message: `This part can't be shown (${broken.message}). EMERGENCY STOP above works; reload the page.` }} />`
      : children}</div>
  </section>`;
}

// Details that most people don't need; what is folded isn't drawn.
export function Fold({ title, open = false, children, ...more }) {
  const [now, setNow] = useState(open);
  useEffect(() => { if (open) setNow(true); }, [open]);
  return html`<details class="details" open=${now} onToggle=${(event) => setNow(event.currentTarget.open)} ...${more}>
    <summary>${title}</summary>${now && html`<div class="stack">${children}</div>`}</details>`;
}

// Names and values: rows of [name, value]; a value of null is left out.
export const Facts = ({ rows }) => html`
  <dl class="facts">${rows.filter((row) => row && row[1] !== null && row[1] !== undefined && row[1] !== "").map(([name, value]) => html`
    <div key=${name}><dt>${name}</dt><dd>${value}</dd></div>`)}</dl>`;

// Sentences below each other.
export const Bullets = ({ rows, list = "ul" }) => html`
  <${list} class="bullets">${rows.map((row, at) => html`<li key=${at}>${row}</li>`)}</${list}>`;

// Figures in boxes beside each other: [name, value, more, tone].
export const Tiles = ({ rows }) => html`<dl class="tiles">${rows.filter(Boolean).map(([name, value, more, tone]) => html`
  <div key=${name} class=${classes("tile", tone && `note-${tone}`)}><dt class="name">${name}</dt>
    <dd class="value">${value}</dd>${more && html`<dd class="more">${more}</dd>`}</div>`)}</dl>`;

// A table; columns: [{ name, of: row => value, number }]. A `tall` one is scrolled.
export const Table = ({ columns, rows, caption, keyOf, tall }) => html`
  <div class=${classes("table", tall && "table-tall")} tabindex="0" role="region" aria-label=${caption}>
    <table>
      <thead><tr>${columns.map((one) => html`<th scope="col" class=${one.number ? "number" : ""}>${one.name}</th>`)}</tr></thead>
      <tbody>${rows.map((row, at) => html`<tr key=${keyOf ? keyOf(row) : at}>${columns.map((one) => html`
        <td class=${one.number ? "number" : ""}>${one.of(row)}</td>`)}</tr>`)}</tbody>
    </table>
  </div>`;

// What can be chosen, each a link: { href, name, about, badge, current }. With `choose` it stays on this page.
export const Links = ({ rows, choose }) => html`<ul class="links">${rows.map(({ href, name, about, badge, current }) => html`
  <li key=${href}><a class="link-row" href=${href} aria-current=${current ? "true" : undefined}
    onClick=${choose && ((event) => { event.preventDefault(); choose(name); })}>
    <strong>${name}</strong><span class="quiet">${about}</span>${badge}</a></li>`)}</ul>`;

// What was checked, as { check or what, value, limit, unit, place, remedy }. `mend(one)` gives what helps.
export const Findings = ({ rows, label, refuses, mend = () => null }) => html`
  <ul class=${classes("findings", refuses && "findings-bad")} aria-label=${label}>${rows.map((one) => html`
    <li key=${`${one.check ?? one.what} ${one.about} ${one.place}`}>
      ${one.check !== "" && html`<div class="grow"><strong>${sentence(one.check ?? one.what)}</strong>${measured(one)}</div>`}
      ${mend(one)}
      ${reason(one) && html`<p class="quiet">${reason(one)}</p>`}</li>`)}</ul>`;

// "3.2 mm, limit 0.05 mm"; nothing for a question to a person.
function measured({ value, limit, unit }) {
  const [found, allowed] = [value, limit].map((one) => `${number(one)}${unit ? ` ${unit}` : ""}`);
  return value === null && limit === null ? "" : `: ${found}, limit ${allowed}`;
}

const reason = ({ place, remedy, passed }) =>
  sentence([!remedy?.includes(place) && place, !passed && remedy].filter(Boolean).join(": "));

export const Photos = ({ rows }) => html`<div class="photos">${rows.map(({ href, alt }) => html`
  <a key=${href} href=${href} target="_blank" rel="noopener">
    <img src=${href} alt=${alt} loading="lazy" /></a>`)}</div>`;

const OUTCOMES = {
  pass: ["good", "Passed"], fail: ["bad", "Not passed"],
  undecided: ["warn", "Undecided: neither pass nor fail is proven"], "": ["info", "Measured; no verdict yet"],
};
export const toneOf = (outcome) => OUTCOMES[outcome.split(":")[0]]?.[0] ?? "info";
export const Verdict = ({ outcome }) => html`<div class="grow" role="status"><${Note} tone=${toneOf(outcome)}>
  <strong>${OUTCOMES[outcome][1]}</strong></${Note}></div>`;

// Tabs: [{ id, name, body: () => vnode }].
export function Tabs({ tabs, at, onChange, label }) {
  const chosen = tabs.find((one) => one.id === at) ?? tabs[0];
  const id = useId();
  const press = (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const next = tabs[(tabs.indexOf(chosen) + step + tabs.length) % tabs.length];
    onChange(next.id);
    event.currentTarget.querySelector(`[data-tab="${next.id}"]`)?.focus();
  };
  return html`
    <div class="tabs" role="tablist" aria-label=${label} onKeyDown=${press}>${tabs.map((one) => html`
      <button type="button" role="tab" key=${one.id} data-tab=${one.id} id=${`${id}-${one.id}`}
        aria-controls=${`${id}-panel`} aria-selected=${String(one === chosen)}
        tabindex=${one === chosen ? 0 : -1} onClick=${() => onChange(one.id)}>${one.name}</button>`)}</div>
    <div role="tabpanel" id=${`${id}-panel`} aria-labelledby=${`${id}-${chosen.id}`} class="stack">${chosen.body()}</div>`;
}

// --- buttons ---------------------------------------------------------------------------------------

// A button: kind is "quiet", "main" or "danger". `why` says why it can't be pressed.
export function Button({ kind = "quiet", href, busy, disabled, why, onClick, children, ...more }) {
  const look = classes("button", kind !== "quiet" && `button-${kind}`);
  if (href) return html`<a class=${look} href=${href} ...${more}>${children}</a>`;
  const off = disabled || busy || Boolean(why);
  return html`<button type="button" class=${look} disabled=${off} aria-busy=${busy ? "true" : undefined}
    title=${why || undefined} onClick=${onClick} ...${more}>${busy && html`<span class="spinner" aria-hidden="true"></span>`}${children}</button>`;
}

// A button that posts `body` to the path `post`, then runs `work` (async), or that alone; while it runs it can't be
// pressed, and below it stands what was refused. With `ask` ({ title, text, yes, no, danger }) it asks once more.
export function Act({ post, body, work: then, ask, children, ...more }) {
  const work = post ? () => send("POST", post, body).then(then) : then;
  const [run, { busy, problem }] = useAction(work);
  const [asking, setAsking] = useState(false);
  return html`<div class="act">
    <${Button} ...${more} busy=${busy} onClick=${ask ? () => setAsking(true) : () => run()}>${children}</${Button}>
    <${Refused} problem=${problem} />
    ${asking && html`<${Ask} no="No" ...${ask} work=${work} onClose=${() => setAsking(false)} />`}
  </div>`;
}

// A dialog with a form: its button or Enter runs `work` (async), then `onClose`. What is refused stays in it,
// with what was typed.
export function Ask({ title, text, yes = "Yes", no = "Cancel", danger, why, work, onClose, tools, children }) {
  const [run, { busy, problem }] = useAction(async () => {
    await work();
    onClose();
  });
  const send = (event) => {
    event.preventDefault();
    if (!why) run();
  };
  // Enter on a tick would send the form, which may move the printer.
  const press = (event) => event.key === "Enter" && event.target.type === "checkbox" && event.preventDefault();
  return html`<${Dialog} title=${title} onClose=${onClose}><form class="stack" onSubmit=${send} onKeyDown=${press} novalidate>
    ${text && html`<p>${text}</p>`}${children}
    <${Refused} problem=${problem} />
    <div class="row row-top">
      <${Button} type="submit" kind=${danger ? "danger" : "main"} busy=${busy} why=${why}>${yes}</${Button}>
      <${Button} onClick=${onClose}>${no}</${Button}>${tools}</div>
  </form></${Dialog}>`;
}

// A dialog below the header, so that EMERGENCY STOP is always in reach. Escape closes it; what had the focus
// gets it back.
export function Dialog({ title, onClose, children }) {
  const box = useRef(null);
  const close = useRef(onClose);
  close.current = onClose;
  useLayoutEffect(() => { // at once: a frame later one may be typing
    const before = document.activeElement;
    const first = box.current.querySelector("[autofocus], input:not([type=hidden]), select, textarea, button:not(.dialog-close)");
    (first ?? box.current).focus();
    const press = (event) => event.key === "Escape" && close.current();
    document.addEventListener("keydown", press);
    return () => {
      document.removeEventListener("keydown", press);
      before?.focus?.();
    };
  }, []);
  const id = useId();
  return html`<div class="scrim" onClick=${(event) => event.target === event.currentTarget && onClose()}>
    <div class="dialog" role="dialog" aria-modal="true" aria-labelledby=${id} tabindex="-1" ref=${box}>
      <div class="card-head"><h2 id=${id}>${title}</h2>
        <button type="button" class="dialog-close" aria-label="Close" onClick=${onClose}>×</button></div>
      <div class="stack">${children}</div>
    </div>
  </div>`;
}

// --- fields ----------------------------------------------------------------------------------------

// One value. kind: "text", "number", "choice" (options: values of any kind, or [value, name]), "flag", "slider",
// "long" or "password"; a slider's value may be `shown` in words. `onChange` is told the value as it is typed: a
// number or null for numbers.
export function Field({
  label, kind = "text", value, onChange, unit, hint, problem, options = [], min, max, step, shown = value, ...more
}) {
  const id = useId();
  const said = [hint && `${id}-hint`, problem && `${id}-problem`].filter(Boolean).join(" ") || undefined;
  const common = { id, "aria-describedby": said, "aria-invalid": problem ? "true" : undefined, ...more };
  const told = (event) => onChange(event.target.value);
  const numeric = ["number", "slider"].includes(kind);
  const number = (event) => onChange(event.target.value === "" ? null : Number(event.target.value));
  let input;
  if (kind === "choice") {
    const text = (one) => (typeof one === "string" ? one : JSON.stringify(one));
    const known = options.map((one) => (Array.isArray(one) ? one : [one, one])); // a value alone is its name
    const choose = (event) => onChange(known.find(([one]) => text(one) === event.target.value)[0]);
    const now = text(value ?? "");
    input = html`<select ...${common} value=${now} onChange=${choose}>${known.map(([one, name]) => html`
      <option key=${text(one)} value=${text(one)} selected=${text(one) === now}>${name}</option>`)}</select>`;
  } else if (kind === "flag") {
    input = html`<input type="checkbox" ...${common} checked=${Boolean(value)} onChange=${(event) => onChange(event.target.checked)} />`;
  } else if (kind === "long") {
    input = html`<textarea ...${common} rows="4" value=${value ?? ""} onInput=${told}></textarea>`;
  } else {
    input = html`<input type=${kind === "slider" ? "range" : kind} inputmode=${kind === "number" && "decimal"}
      ...${common} min=${min} max=${max} step=${step ?? (numeric ? "any" : undefined)} value=${value ?? ""}
      onInput=${numeric ? number : told} />`;
  }
  return html`<div class=${classes("field", `field-${kind}`)}>
    <label for=${id}>${label}</label>
    <div class="field-input">${input}${unit && html`<span class="unit">${unit}</span>`}${
      kind === "slider" && html`<output for=${id}>${shown}</output>`}</div>
    ${hint && html`<p class="hint" id=${`${id}-hint`}>${hint}</p>`}
    ${problem && html`<p class="problem" id=${`${id}-problem`}>${problem}</p>`}
  </div>`;
}

// A field that is kept by `save` (async): at once what is chosen, what is typed when one leaves it.
export function Kept({ save, value, ...more }) {
  const [problem, setProblem] = useState(null);
  const done = (next) => next !== value && save(next).then(() => setProblem(null), setProblem);
  const typed = useTyped(value, done, 0, problem); // what was refused goes back to what was kept
  const change = (next) => {
    typed.onChange(next);
    if (["choice", "flag"].includes(more.kind)) typed.onBlur();
  };
  return html`<${Field} ...${more} ...${typed} onChange=${change} problem=${problem?.message}
    onKeyDown=${(event) => event.key === "Enter" && more.kind !== "long" && typed.onBlur()} />`;
}

// Fields of the values in `of`, each { name, ...what Field takes }. `save(change)` (async) keeps each one; without
// it `onChange` is told all values.
export const Fields = ({ fields, of, save, onChange, children }) => html`<div class="fields">
  ${fields.filter(Boolean).map(({ name, ...field }) => (save
    ? html`<${Kept} key=${name} ...${field} value=${of[name]} save=${(value) => save({ [name]: value })} />`
    : html`<${Field} key=${name} ...${field} value=${of[name]}
        onChange=${(value) => onChange({ ...of, [name]: value })} />`))}${children}</div>`;

// One of a few, all seen: options as [value, name].
export const Segments = ({ label, options, value, onChange }) => html`
  <div class="segments" role="radiogroup" aria-label=${label}>${options.map(([one, name]) => html`
    <button type="button" role="radio" key=${one} aria-checked=${String(one === value)} onClick=${() => onChange(one)}>${name}</button>`)}</div>`;

// A place to drop a file: sent to `path` as `field`, with `more`; `onDone` is told the answer.
export function Drop({ label, accept, path, onDone, field, more }) {
  const [share, setShare] = useState(0);
  const [over, setOver] = useState(false);
  const [run, { busy, problem }] = useAction(async (file) => {
    setShare(0);
    onDone(await upload(path, file, setShare, field, more), file);
  });
  const take = ([file]) => file && run(file);
  const drop = (event) => {
    event.preventDefault();
    setOver(false);
    take(event.dataTransfer.files);
  };
  const choose = ({ target }) => {
    take(target.files);
    target.value = "";
  };
  return html`<div class=${classes("drop", over && "drop-over")} onDragOver=${(event) => { event.preventDefault(); setOver(true); }}
      onDragLeave=${() => setOver(false)} onDrop=${drop}>
    <label class="button">${label}<input class="unseen" type="file" accept=${accept} disabled=${busy}
      onChange=${choose} /></label>
    <span class="quiet">or drop it here</span>
    ${busy && html`<${Progress} share=${share} label="Sending" />`}
    <${Refused} problem=${problem} />
  </div>`;
}

// --- words -----------------------------------------------------------------------------------------

// A number to `digits` significant figures, without a tail of noughts; a dash for none.
export function number(value, digits = 4) {
  if (!Number.isFinite(value)) return "–";
  return String(Number(value.toPrecision(digits))).replace("-", "\u2212");
}

// A job's name for people; the run that it is of, "" for a file that was brought.
const STATE_WORDS = { stopping: "cancelling", stopped: "cancelled", killed: "halted" };
export const stateOf = (state) => (STATE_WORDS[state] ?? state).replaceAll("_", " ");
export const nameOf = (job) => job.replace(/^(run|file)~/, "").replace(/\.gcode$/, "");
export const runOf = (job) => (job.startsWith("run~") ? job.slice(4) : "");

// A text of the program as a sentence: its first letter large, unless a name of a file or key stands there.
export const sentence = (text) => (/^\S*[._/~]\S/.test(text) ? text : text.charAt(0).toUpperCase() + text.slice(1));

// Seconds as people say them.
export function span(seconds) {
  if (!Number.isFinite(seconds)) return "–";
  if (seconds < 90) return `${Math.round(seconds)} s`;
  if (seconds < 5400) return `${Math.round(seconds / 60)} min`;
  return `${Math.floor(seconds / 3600)} h ${Math.round((seconds % 3600) / 60)} min`;
}

// Seconds since 1970 as a date and time of this browser's place.
export const when = (seconds) =>
  new Date(1000 * seconds).toLocaleString([], { dateStyle: "medium", timeStyle: "short" });

export function bytes(count) {
  const units = ["B", "kB", "MB", "GB"];
  const power = Math.min(Math.floor(Math.log10(Math.max(count, 1)) / 3), 3);
  return `${number(count / 1000 ** power, 3)} ${units[power]}`;
}
