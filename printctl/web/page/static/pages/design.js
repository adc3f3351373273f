// Recipes at the left, the chosen one at the right: its form and text, what is made of it, and two runs compared.
import { get, part, send } from "../api.js";
import { Problems, RecipeForm } from "../form.js";
import { Frame } from "../frame.js";
import { Stages, isGoing } from "../runs.js";
import {
  Act, Ask, Badge, Button, Card, Dialog, Drop, Empty, Field, Fields, Fold, Links, Loaded, Loading, Note, Page, Tabs,
  Unusable, html, useAddress, useEffect, useGet, useRef, useState, useStyle, useTyped,
} from "../ui.js";
import { Compare, Figures, Look } from "./design_runs.js";

const STATES = {
  never: "Not made yet", starting: "Starting", running: "Being made", done: "Made", failed: "Failed",
  interrupted: "Broken off",
};
const TYPING_MS = 600;

// { doc, loads, problem, unread, typed, load, change }. Changes are sent one after the other, each with the version
// that it changes. `typed` is its text, `unread` why what was typed isn't in the file.
function useRecipe(name) {
  const path = `/recipes/${part(name)}`;
  const [state, setState] = useState({ doc: null, loads: 0, problem: null, unread: null });
  const set = (change) => setState((old) => ({ ...old, ...change }));
  const version = useRef(0);
  const queue = useRef(Promise.resolve());
  const keep = (doc) => {
    version.current = doc.version;
    set({ doc, problem: null, unread: null });
  };
  const load = async () => {
    await get(path).then(keep, (problem) => set({ problem }));
    setState((old) => ({ ...old, loads: old.loads + 1 }));
  };
  useEffect(() => { if (name) load(); }, []);
  const write = (method, body) => {
    queue.current = queue.current.then(() => send(method, path, { ...body, version: version.current })).then(keep,
      (why) => set(method === "PUT" && why.status === 422 ? { unread: why } : { problem: why }));
  };
  const typed = useTyped(state.doc?.text ?? "", (text) => write("PUT", { text }), TYPING_MS, state.loads);
  return { ...state, typed, load, change: (body) => write("PATCH", body) };
}

export default function Design({ recipe = "", tab = "recipe" }) {
  useStyle("pages/design.css");
  const recipes = useGet("/recipes");
  const runs = useGet("/runs");
  const choices = useGet("/recipes/choices");
  const [name, setName] = useState(recipe);
  const [at, setAt] = useState(tab);
  const [dialog, setDialog] = useState("");
  const [said, setSaid] = useState(null);
  const rows = recipes.value ?? [];
  const chosen = rows.some((one) => one.name === name) ? name : rows[0]?.name ?? "";
  useAddress("/design", { recipe: chosen, tab: at }, recipes.value !== null);
  const choose = (next) => {
    setSaid(null);
    setName(next);
  };
  const done = (made, words) => {
    setDialog("");
    if (made?.name) setName(made.name);
    setSaid(words ?? null);
    recipes.reload();
    choices.reload();
  };
  const remove = async () => {
    await send("DELETE", `/recipes/${part(chosen)}`);
    done(null, html`<${Note}>${chosen} is in the bin. <${Act} work=${async () =>
      done(await send("POST", `/recipes/${part(chosen)}/restore`))}>Take back ${chosen}</${Act}></${Note}>`);
  };
  const names = (runs.value ?? []).filter((one) => one.state !== "never").map((one) => one.name);
  const made = (runs.value ?? []).filter((one) => one.state === "done").map((one) => one.name);
  const dialogs = { choices, chosen, done, close: () => setDialog("") };
  const tools = html`<${Button} onClick=${() => setDialog("duplicate")}>Duplicate</${Button}>
    <${Button} onClick=${() => setDialog("rename")}>Rename</${Button}><${Act} work=${remove}>Delete</${Act}>`;
  return html`<${Page} title="Design" wide tools=${html`
      <${Button} kind="main" onClick=${() => setDialog("new")}>New</${Button}>
      <${Button} onClick=${() => setDialog("import")}>Import</${Button}>`}>
    ${said}
    <${Unusable} names=${choices.value?.unusable} />
    <${Loaded} of=${recipes} what="Reading the recipes">${() => (rows.length || names.length ? html`<div class="design">
      <${Recipes} rows=${rows} made=${made} chosen=${chosen} choose=${choose} />
      <${Recipe} key=${chosen} name=${chosen} row=${rows.find((one) => one.name === chosen)} choices=${choices}
        names=${names} tools=${tools} at=${at} setAt=${setAt} recipes=${recipes} runs=${runs} /></div>`
    : html`<${Card}><${Empty}>A recipe says what is printed and how: tissue, vessels, toolpath, printer. Begin one from
        an example, or import a file. Step by step it goes on <a href="/">Home</a>.</${Empty}></${Card}>`)}</${Loaded}>
    ${dialog === "import" && html`<${ImportDialog} ...${dialogs} />`}
    ${dialog in NAMED && html`<${NameDialog} ...${dialogs} act=${dialog} />`}
  </${Page}>`;
}

// The recipe that is chosen, and the runs; without one only what runs have made.
function Recipe({ name, row, choices, names, tools, at, setAt, recipes, runs }) {
  const editor = useRecipe(name);
  const { doc, problem, load } = editor;
  const count = doc?.problems.length;
  useEffect(() => {
    if (count !== undefined && count !== row?.problems) recipes.reload();
  }, [count]);
  const ofRuns = { names, first: name };
  const tabs = [
    { id: "recipe", name: "Recipe",
      body: () => html`<${RecipeTab} editor=${editor} choices=${choices} toText=${() => setAt("text")} />` },
    { id: "text", name: "Text", body: () => html`<${TextTab} editor=${editor} />` },
    { id: "make", name: "Make", body: () => html`<${MakeTab} name=${name} made=${runs.reload}
      stages=${choices.value?.stages ?? []} problems=${doc?.problems ?? []} look=${() => setAt("look")} />` },
    { id: "look", name: "Look", body: () => html`<${Look} ...${ofRuns} />` },
    { id: "figures", name: "Figures and files", body: () => html`<${Figures} ...${ofRuns} />` },
    { id: "compare", name: "Compare", body: () => html`<${Compare} ...${ofRuns} />` },
  ];
  return html`<${Card} title=${name || "No recipe"} tools=${name && html`<${State} editor=${editor} />${tools}`}>
    ${name && problem && html`<${Note} tone="bad"><p>${problem.message}</p>
      <${Button} onClick=${load}>Load it again${problem.status === 409 && "; my last change is lost"}</${Button}>
    </${Note}>`}
    <${Tabs} label="Parts of the design" tabs=${tabs} at=${at} onChange=${setAt} />
  </${Card}>`;
}

function State({ editor: { doc, typed, unread } }) {
  if (!doc) return null;
  const count = doc.problems.length;
  const kept = unread ? "not saved: this can't be read" : typed.value === doc.text ? "saved" : "saving …";
  return html`<span role="status" class="row">${count ? html`<${Badge} tone="warn">${count} to mend</${Badge}>`
    : html`<${Badge} tone="good">ready to be made</${Badge}>`} <span class="quiet">${kept}</span></span>`;
}

// On a phone a choice; else a list.
const Recipes = ({ rows, made, chosen, choose }) => html`<nav class="design-recipes" aria-label="Recipes">
  <div class="design-choice"><${Field} kind="choice" label="Recipe" value=${chosen} onChange=${choose}
    options=${rows.map((one) => one.name)} /></div>
  <div class="card"><${Links} choose=${choose} rows=${rows.map(({ name, problems }) => ({
    href: `/design?recipe=${part(name)}`, name, current: name === chosen,
    badge: problems > 0 ? html`<${Badge} tone="warn">${problems} to mend</${Badge}>`
      : made.includes(name) && html`<${Badge} tone="good">made</${Badge}>`,
  }))} /></div>
</nav>`;

// Each way to name a recipe: title, button, the field's label and hint.
const NAMED = {
  new: ["New recipe", "Make", "Name", "Letters a to z, digits, '.', '_' and '-'."],
  duplicate: ["Duplicate", "Duplicate", "Name of the copy", ""],
  rename: ["Rename", "Rename", "New name", "A run that was made of it keeps its name."],
};

function NameDialog({ act, choices, chosen, done, close }) {
  const [title, yes, label, hint] = NAMED[act];
  const first = { new: "", duplicate: `${chosen}_2`, rename: chosen }[act];
  const [said, setSaid] = useState({ name: first, source: act === "new" ? "starter" : undefined });
  const path = act === "new" ? "/recipes" : `/recipes/${part(chosen)}/${act}`;
  const work = async () => (act === "rename" && said.name === chosen) || done(await send("POST", path, said));
  return html`<${Ask} title=${title} yes=${yes} onClose=${close} work=${work}>
    <${Fields} of=${said} onChange=${setSaid} fields=${[
      { name: "name", label, hint, autocomplete: "off" },
      act === "new" && { name: "source", label: "Begin from", kind: "choice",
        options: choices.value?.examples ?? [said.source] },
    ]} /></${Ask}>`;
}

function ImportDialog({ choices, done, close }) {
  const suffixes = choices.value?.suffixes ?? [];
  return html`<${Dialog} title="Import" onClose=${close}>
    <p>A recipe:</p>
    <${Drop} label="Choose a recipe" accept=".yaml,.yml" path="/recipes/import" onDone=${(made) => done(made)} />
    <p>A file that recipes name (${suffixes.map((one) => one.slice(1)).join(", ")}; up to 200 MB):</p>
    <${Drop} label="Choose a file" accept=${suffixes.join(",")} path="/recipes/files"
      onDone=${(file) => done(null, html`<${Note} tone="good">${file} can be named in recipes now.</${Note}>`)} />
  </${Dialog}>`;
}

function RecipeTab({ editor, choices, toText }) {
  const schema = useGet("/recipes/schema");
  const { doc, unread } = editor;
  if (unread || (doc && !doc.data)) {
    return html`<${Note} tone="warn"><p>${(unread ?? doc.problems[0]).message}</p>
      <p>The form comes back once the text can be read.</p>
      <div class="row"><${Button} onClick=${toText}>Mend the text</${Button}>
        ${unread && html`<${Button} onClick=${editor.load}>Back to what is saved</${Button}>`}</div></${Note}>`;
  }
  if (!doc) return html`<${Loading} what="Reading the recipe" />`;
  return html`<${Pick} key=${`pick ${editor.loads}`} doc=${doc} change=${editor.change} />
    <${Loaded} of=${schema}>${(root) => html`<${Loaded} of=${choices}>${(known) => html`
      <${RecipeForm} key=${editor.loads} schema=${root} choices=${known} doc=${doc} change=${editor.change} />`
    }</${Loaded}>`}</${Loaded}>`;
}

function TextTab({ editor: { doc, typed, unread } }) {
  if (!doc) return html`<${Loading} what="Reading the recipe" />`;
  return html`${unread && html`<${Note} tone="bad">Not saved. ${unread.message}</${Note}>`}
    <${Problems} problems=${doc.problems} />
    <textarea class="design-text mono" aria-label="Recipe as YAML" spellcheck=${false} value=${typed.value}
      onInput=${(event) => typed.onChange(event.target.value)} onBlur=${typed.onBlur}></textarea>`;
}

// A place that is clicked on the tissue is written into the recipe.
function Pick({ doc, change }) {
  const [shown, setShown] = useState(0);
  const [name, setName] = useState("");
  const [said, setSaid] = useState("");
  const target = doc.places.find((one) => one.name === name) ?? doc.places[0];
  const hear = ({ printctl, at }) => {
    if (printctl !== "pick" || !target || !Array.isArray(at) || at.length !== 3 || !at.every(Number.isFinite)) return;
    const place = at.map((one) => Number(one.toFixed(3)));
    change({ path: target.path, value: target.key ? { [target.key]: place } : place });
    setSaid(`${target.name}: ${place.join(", ")} mm`);
  };
  if (!doc.places.length) return null;
  return html`<${Fold} title="Pick places on the tissue"><div class="row row-end">
      <${Field} kind="choice" label="A click on the surface sets" value=${target.name} onChange=${setName}
        options=${doc.places.map((one) => one.name)} />
      <${Button} onClick=${() => setShown(shown + 1)}>${shown ? "Show the tissue anew" : "Show the tissue"}</${Button}>
    </div>
    <p role="status">${said}</p>
    ${shown > 0 && html`<${Frame} key=${shown} src=${`/recipes/${part(doc.name)}/tissue`} hear=${hear}
      title=${`Tissue of ${doc.name}`} />`}</${Fold}>`;
}

function MakeTab({ name, stages, problems, made, look }) {
  const [until, setUntil] = useState("");
  const way = `/runs/${part(name)}`;
  const progress = useGet(name && `${way}/progress`, { every: (one) => (one && !isGoing(one) ? 5000 : 1000) });
  const run = progress.value;
  const busy = isGoing(run);
  useEffect(() => { made(); }, [run?.state]);
  const last = until || stages.at(-1);
  const why = problems.length ? "The recipe has something to mend first." : "";
  return html`<${Loaded} of=${progress}>${() => html`
    <div class="row row-end">
      <${Field} kind="choice" label="As far as" value=${last} onChange=${setUntil} options=${stages} />
      <${Act} kind="main" disabled=${busy} why=${why} post=${`${way}/start`} body=${{ until: last }}
        work=${progress.reload}>Make the design</${Act}>
      ${busy && html`<${Act} post=${`${way}/cancel`} work=${progress.reload}>Cancel</${Act}>`}
    </div>
    ${why && html`<p class="quiet">${why}</p>`}
    <p role="status" class=${busy ? "loading" : ""}>${busy && html`<span class="spinner" aria-hidden="true"></span>`}
      <strong>${STATES[run.state]}${run.state === "done" && run.until && ` as far as ${run.until}`}</strong></p>
    <${Stages} of=${run} />
    ${run.state === "done" && html`<div class="row"><${Button} onClick=${look}>Look at it</${Button}>
      ${stages.indexOf(run.until) >= stages.indexOf("toolpath") && html`
        <${Button} href=${`/job?job=run~${part(name)}`}>Print it</${Button}>`}</div>`}
    ${run.print_state === "done" && !busy && html`<div class="row">
      <${Act} post=${`${way}/continue`} work=${progress.reload}>Continue after the print</${Act}>
      <span class="quiet">Its print is done: scan, registration and report come next.</span></div>`}`}</${Loaded}>`;
}
