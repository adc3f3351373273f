// The form of a recipe, made from its JSON Schema (GET /recipes/schema; printctl/recipe/schema.py).
import {
  Badge, Button, Field, Fold, Note, html, number, useEffect, useMemo, useRef, useState, useTyped,
} from "./ui.js";

const FOUND = 12;
const AXES = { 2: ["1st", "2nd"], 3: ["x", "y", "z"] };

// --- schema ----------------------------------------------------------------------------------------

// A node without references and without the null beside what else may stand there, then `optional`.
function resolve(root, node) {
  const { $ref, anyOf, ...more } = node;
  if ($ref) return resolve(root, { ...root.$defs[$ref.replace("#/$defs/", "")], ...more });
  const rest = anyOf?.filter((one) => one.type !== "null") ?? [];
  if (rest.length === 1) {
    const { title, ...inner } = rest[0];
    return resolve(root, { ...inner, ...more, optional: rest.length < anyOf.length });
  }
  return node;
}

function kindOf(root, node) {
  if (node.tags) return "choice";
  if (node.properties) return "section";
  if (node.prefixItems) return "row";
  if (node.items) return isPlain(root, resolve(root, node.items)) ? "plain list" : "list";
  if (node.profile || node.file || node.enum || "const" in node || node.type === "boolean") return "one of";
  return { integer: "number", number: "number", string: "text" }[node.type] ?? "free";
}

const PARTS = ["choice", "section", "list"];
const isPlain = (root, node) => ![...PARTS, "row"].includes(kindOf(root, node));

// Which section of a choice a value is: the one whose keys it has, the most of them.
function optionAt(root, node, value) {
  const fits = node.begins.map((begin, at) => {
    const { properties } = resolve(root, node.oneOf[at]);
    const keys = Object.keys(begin);
    return value && keys.every((key) => key in value && (properties[key].const ?? value[key]) === value[key])
      ? keys.length : -1;
  });
  const most = Math.max(...fits);
  return most < 0 ? -1 : fits.indexOf(most);
}

const valueAt = (data, path) => path.reduce((inside, key) => inside?.[key] ?? undefined, data);

// The node at a path, `needed` if its key must be there.
function nodeAt(root, data, path) {
  let node = root;
  path.forEach((key, depth) => {
    if (!node) return;
    if (node.tags) {
      const there = valueAt(data, path.slice(0, depth)) ?? node.default;
      const at = optionAt(root, node, there);
      node = at < 0 ? {} : resolve(root, node.oneOf[at]);
    }
    const next = typeof key === "number" ? node.prefixItems?.[key] ?? node.items : node.properties?.[key];
    const needed = typeof key === "number" || Boolean(node.required?.includes(key));
    node = next && { ...resolve(root, next), needed };
  });
  return node;
}

// What is to be written so that a value stands at a path: with it the sections that aren't there yet.
function toWrite({ root, data }, path, value) {
  const missing = path.findIndex((_, k) => k > 0 && valueAt(data, path.slice(0, k)) === undefined);
  if (missing < 0) return { path, value };
  const first = path.slice(0, missing);
  const inner = path.slice(missing)
    .reduceRight((one, key) => (typeof key === "number" ? [one] : { [key]: one }), value);
  const node = nodeAt(root, data, first);
  const at = node?.tags && node.default ? optionAt(root, node, node.default) : -1;
  return { path: first, value: at < 0 ? inner : { ...node.begins[at], ...inner } };
}

// What is to be removed so that nothing stands at a path: with it a section that is left empty, but
// one that means something by being there.
function toRemove({ root, data }, path) {
  let whole = path;
  while (whole.length > 1) {
    const above = whole.slice(0, -1);
    const node = nodeAt(root, data, above);
    if (Object.keys(valueAt(data, above) ?? {}).length > 1 || node?.optional || node?.needed) break;
    whole = above;
  }
  return whole;
}

// Every field that the recipe as it is can have: [{ path, words, help }].
function fieldsOf(form, node, path = []) {
  const { root, data } = form;
  let at = node;
  if (at.tags) at = at.oneOf[optionAt(root, at, valueAt(data, path) ?? at.default)] ?? {};
  return Object.entries(resolve(root, at).properties ?? {}).flatMap(([key, one]) => {
    const here = [...path, key];
    const inner = resolve(root, one);
    const words = [...path, labelOf(inner)].join(" › ");
    return [{ path: here, words, help: inner.description ?? "" }, ...fieldsOf(form, inner, here)];
  });
}

// --- words -----------------------------------------------------------------------------------------

const labelOf = ({ title, unit }) => (unit ? `${title} (${unit})` : title);

function bounds(node) {
  const words = Object.entries({ exclusiveMinimum: "above", minimum: "from", exclusiveMaximum: "below", maximum: "to" })
    .filter(([key]) => node[key] !== undefined)
    .map(([key, word]) => `${word} ${number(node[key], Number.isInteger(node[key]) ? 12 : 6)}`);
  return words.length ? [...words, node.unit].filter(Boolean).join(" ") : "";
}

const hintOf = (node) => [node.description?.replace(/\.$/, ""), bounds(node)].filter(Boolean).join(" · ");

// A value as YAML in one line; of a list of plain values what stands between its brackets.
function written(value, kind) {
  if (value === undefined || value === null) return "";
  if (typeof value === "number") return String(Number(value.toPrecision(12)));
  if (typeof value === "string") return value;
  const text = JSON.stringify(value).replaceAll(/([,:])(?=[^,:]*)/g, "$1 ");
  return kind === "plain list" ? value.map((one) => written(one)).join(", ") : text;
}

function defaultOf(node, kind) {
  const has = node.default !== null && node.default !== undefined && written(node.default, kind) !== "";
  if (has && typeof node.default === "boolean") return node.default ? "yes" : "no";
  if (has && JSON.stringify(node.default) !== "{}") return written(node.default, kind);
  return node.needed ? "to be given" : "not given";
}

// --- fields ----------------------------------------------------------------------------------------

function problemAt(form, path) {
  const place = path.join(".");
  return form.problems.filter((one) => one.path.join(".") === place)
    .map((one) => one.message.replace(`${place}: `, "")).join("; ");
}

const below = (form, path) => form.problems.filter((one) => path.every((key, k) => one.path[k] === key)).length;

function Typed({ form, node, path, kind, value, label, hint, say }) {
  const field = useTyped(written(value, kind), (text) => {
    const trimmed = text.trim();
    const plain = trimmed.replace("\u2212", "-");
    if (!trimmed) say(undefined);
    else if (kind === "text") say(trimmed);
    else if (kind === "number") say(Number.isFinite(Number(plain)) ? Number(plain) : trimmed);
    else say(undefined, kind === "plain list" && !trimmed.startsWith("[") ? `[${trimmed}]` : trimmed);
  });
  return html`<${Field} ...${field} label=${label} hint=${hint} problem=${problemAt(form, path)}
    inputmode=${kind === "number" ? "decimal" : undefined} placeholder=${defaultOf(node, kind)} spellcheck=${false} />`;
}

function Chosen({ form, node, path, value, label, hint, say }) {
  const options = node.profile ? Object.entries(form.choices.profiles[node.profile] ?? {})
    : node.file ? form.choices.files.map((one) => [one, one])
      : node.type === "boolean" ? [[true, "yes"], [false, "no"]]
        : (node.enum ?? [node.const]).map((one) => [one, String(one).replaceAll("_", " ")]);
  const given = value !== undefined;
  if (given && !options.some(([one]) => one === value)) options.push([value, written(value)]);
  if (!node.needed || !given) options.unshift(["", node.needed ? "to be given" : `${defaultOf(node)} (default)`]);
  return html`<${Field} kind="choice" label=${label} hint=${hint} value=${value} options=${options}
    problem=${problemAt(form, path)} onChange=${(one) => say(one === "" ? undefined : one)} />`;
}

function Leaf({ form, node, path, label = labelOf(node), hint = hintOf(node), value = valueAt(form.data, path), say }) {
  const kind = kindOf(form.root, node);
  const tell = say ?? ((next, yaml) => {
    const same = !node.needed && !yaml && next === node.default;
    form.change(path, same ? undefined : next, yaml);
  });
  const Input = kind === "one of" ? Chosen : Typed;
  return html`<div data-path=${path.join(".")}>
    <${Input} ...${{ form, node, path, kind, value, label, hint, say: tell }} /></div>`;
}

// A few numbers beside each other, written together.
function Row({ form, node, path }) {
  const value = valueAt(form.data, path);
  const items = node.prefixItems;
  const say = (k) => (next) => {
    const begin = value ?? node.default ?? [];
    const row = items.map((_, i) => (i === k ? next : begin[i]) ?? null);
    form.change(path, row.every((one) => one === null) ? undefined : row);
  };
  const itemAt = (k) => ({ ...resolve(form.root, items[k]), default: node.default?.[k], needed: node.needed });
  return html`<fieldset class="form-row" data-path=${path.join(".")}>
    <legend>${labelOf(node)}</legend>
    ${items.map((_, k) => html`<${Leaf} key=${k} form=${form} node=${itemAt(k)} path=${[...path, k]} hint=""
      label=${AXES[items.length]?.[k] ?? String(k + 1)} value=${value?.[k] ?? undefined} say=${say(k)} />`)}
    ${hintOf(node) && html`<p class="hint">${hintOf(node)}</p>`}
    ${problemAt(form, path) && html`<p class="problem">${problemAt(form, path)}</p>`}
  </fieldset>`;
}

// --- sections --------------------------------------------------------------------------------------

// Fields of a section, behind `lead`: first those that the recipe says or needs, then, folded, those left to
// their defaults.
function FieldsOf({ form, node, path, without = [], lead = null }) {
  const all = Object.keys(node.properties).filter((key) => !without.includes(key))
    .map((key) => ({ key, node: nodeOf(form, node, key), path: [...path, key] }))
    .filter((one) => !("const" in one.node && one.node.needed));
  const top = !path.length;
  const isShown = (one) => top || one.node.needed || valueAt(form.data, one.path) !== undefined
    || form.opened.has(one.path.join("."));
  const rest = all.filter((one) => !isShown(one));
  return html`<${FieldList} form=${form} fields=${all.filter(isShown)} lead=${lead} />
    ${rest.length > 0 && html`
    <${Fold} title=${`${rest.length} more ${rest.length > 1 ? "fields" : "field"}, at their defaults`}>
      <${FieldList} form=${form} fields=${rest} />
    </${Fold}>`}`;
}

const nodeOf = (form, node, key) =>
  ({ ...resolve(form.root, node.properties[key]), needed: Boolean(node.required?.includes(key)) });
const isLeaf = (form, one) => !PARTS.includes(kindOf(form.root, one.node));

const FieldList = ({ form, fields, lead = null }) => html`
  <div class="form-fields">${lead}${fields.filter((one) => isLeaf(form, one)).map((one) => html`
    <${Inside} key=${one.key} form=${form} node=${one.node} path=${one.path} />`)}</div>
  ${fields.filter((one) => !isLeaf(form, one)).map((one) => html`
    <${Part} key=${one.key} form=${form} node=${one.node} path=${one.path} />`)}`;

function Part({ form, node, path }) {
  const wrong = below(form, path);
  const place = path.join(".");
  const open = valueAt(form.data, path) !== undefined || form.opened.has(place);
  const title = html`<span class="form-title">${node.title}</span>
    ${wrong > 0 && html`<${Badge} tone="bad">${wrong} to mend</${Badge}>`}`;
  return html`<${Fold} class="details form-part" key=${`${place} ${form.turn}`} title=${title} open=${open}
      data-path=${place}>
    ${node.description && html`<p class="hint">${node.description}</p>`}
    ${problemAt(form, path) && html`<p class="problem">${problemAt(form, path)}</p>`}
    <${Inside} form=${form} node=${node} path=${path} />
  </${Fold}>`;
}

function Inside(of) {
  const { form, node } = of;
  const Which = { list: List, choice: Choice, section: Section, row: Row }[kindOf(form.root, node)] ?? Leaf;
  return html`<${Which} ...${of} />`;
}

function Section(of) {
  const { form, node, path } = of;
  const on = valueAt(form.data, path) !== undefined;
  const lead = node.optional && html`<${Field} kind="flag" label=${`with ${node.title}`} value=${on}
    onChange=${(yes) => form.change(path, yes ? {} : undefined)} />`;
  return on || !node.optional ? html`<${FieldsOf} ...${of} lead=${lead} />` : lead;
}

// One of several sorts of section.
function Choice({ form, node, path }) {
  const value = valueAt(form.data, path);
  const now = value === undefined ? -1 : optionAt(form.root, node, value);
  const at = value === undefined && node.default ? optionAt(form.root, node, node.default) : now;
  const shown = at < 0 ? null : resolve(form.root, node.oneOf[at]);
  const options = node.tags.map((tag, k) => [k, tag.replaceAll("_", " ")]);
  const none = node.needed ? "to be chosen" : node.default ? "default" : "none";
  if (!node.needed || now < 0) options.unshift([-1, none]);
  const fixed = at < 0 ? [] : Object.keys(node.begins[at]).filter((key) => "const" in shown.properties[key]);
  const lead = html`<${Field} kind="choice" label=${`kind of ${node.title}`} value=${now} options=${options}
    hint=${shown?.description} onChange=${(k) => form.change(path, node.begins[k])} />`;
  return shown
    ? html`<${FieldsOf} key=${at} form=${form} node=${shown} path=${path} without=${fixed} lead=${lead} />` : lead;
}

function List({ form, node, path }) {
  const value = valueAt(form.data, path);
  const count = Array.isArray(value) ? value.length : 0;
  const item = { title: node.title, ...resolve(form.root, node.items), needed: true };
  const begin = item.begins?.[0] ?? item.prefixItems?.map(() => 0) ?? {};
  return html`${Array.from({ length: count }, (_, k) => html`
    <div class="form-item stack" key=${k} data-path=${[...path, k].join(".")}>
      <div class="row"><h3 class="grow">${node.title} ${k + 1}</h3>
        <${Button} onClick=${() => form.change([...path, k], undefined)}
          aria-label=${`Remove ${node.title} ${k + 1}`}>Remove</${Button}></div>
      <${Inside} form=${form} node=${item} path=${[...path, k]} />
    </div>`)}
    <div><${Button} onClick=${() => form.change([...path, count], begin)}>Add to ${node.title}</${Button}></div>`;
}

// --- the whole -------------------------------------------------------------------------------------

// The form of `doc` (GET /recipes/NAME). `change(path, value, yaml)` writes; undefined removes.
export function RecipeForm({ schema, choices, doc, change }) {
  const [opened, setOpened] = useState(() => new Set());
  const [target, setTarget] = useState(null);
  const [turn, setTurn] = useState(0);
  const [query, setQuery] = useState("");
  const box = useRef(null);
  const data = doc.data ?? {};
  const form = {
    root: schema, choices, data, problems: doc.problems, opened, turn,
    change: (path, value, yaml) => change(yaml !== undefined ? { path, yaml }
      : value === undefined ? { path: toRemove(form, path), value: null } : toWrite(form, path, value)),
  };
  const show = (path) => {
    setOpened((old) => new Set([...old, ...path.map((_, k) => path.slice(0, k + 1).join("."))]));
    setTurn((old) => old + 1);
    setTarget([...path]);
    setQuery("");
  };
  useEffect(() => {
    if (!target) return undefined;
    const timer = setTimeout(() => {
      const places = target.map((_, k) => target.slice(0, target.length - k).join("."));
      const found = places.map((one) => box.current?.querySelector(`[data-path="${CSS.escape(one)}"]`)).find(Boolean);
      found?.scrollIntoView({ block: "center" });
      found?.querySelector("input, select, summary")?.focus({ preventScroll: true });
    }, 50);
    return () => clearTimeout(timer);
  }, [target]);
  return html`<div class="stack" ref=${box}>
    <${Problems} problems=${doc.problems} show=${(path) => nodeAt(schema, data, path) && (() => show(path))} />
    <${FieldsOf} form=${form} node=${schema} path=${[]} lead=${html`
      <${Field} kind="search" label="Find a field" value=${query} onChange=${setQuery} autocomplete="off" />
      <${Found} form=${form} query=${query} show=${show} />`} />
  </div>`;
}

function Found({ form, query, show }) {
  const fields = useMemo(() => fieldsOf(form, form.root), [form.data, form.root]);
  const words = query.trim().toLowerCase().split(/\s+/).filter(Boolean);
  const fits = (text) => words.every((one) => text.toLowerCase().includes(one));
  const found = words.length ? [...fields.filter((one) => fits(one.words)),
    ...fields.filter((one) => !fits(one.words) && fits(`${one.words} ${one.help}`))] : [];
  return words.length > 0 && html`<ul class="list form-finds" aria-label="Fields found">
    ${found.slice(0, FOUND).map((one) => html`
    <li key=${one.path.join(".")}><button type="button" class="link-row" onClick=${() => show(one.path)}>
      ${one.words} <span class="quiet">${one.help}</span></button></li>`)}
    ${found.length === 0 && html`<li class="quiet">No field has this in its name or help.</li>`}</ul>`;
}

// What is wrong; `show(path)` gives what pressing one does, if there is its field.
export const Problems = ({ problems, show = () => null }) => problems.length > 0 && html`
  <${Note} tone="warn"><ul class="form-problems" aria-label="To mend">${problems.map((one, k) => {
    const press = one.path.length > 0 && show(one.path);
    return html`<li key=${k}>${press ? html`<button type="button" onClick=${press}>${one.message}</button>`
      : one.message}</li>`;
  })}</ul></${Note}>`;
