// Past prints: a list that is searched and narrowed, and one print with all that there is of it.
import { url } from "../api.js";
import {
  Button, Card, Drop, Empty, Failed, Field, Fields, Fold, Loaded, Note, Page, Segments, Table,
  html, span, stateOf, useAddress, useEffect, useGet, useState, useStyle, useTyped, when,
} from "../ui.js";
import OnePrint, { End, titleOf } from "./history_print.js";

const PER_PAGE = 10; // a screen of them
const TYPING_MS = 300;
const AGAIN = { every: 10_000, keep: true }; // a print that goes on changes its line
const USUAL = {
  words: "", state: "", profile: "", who: "", since: "", until: "",
  sort: "started", descending: "true", page: "1", of: "",
};
const ORDERS = [
  ["started", "Begun"], ["ended", "Ended"], ["file", "File"],
  ["profile", "Printer"], ["who", "Operator"], ["state", "End"],
];

export default function History({ print = "", ...query }) {
  useStyle("pages/history.css");
  return print ? html`<${OnePrint} id=${print} />` : html`<${List} query=${query} />`;
}

const set = (filter) => Object.entries(filter).filter(([name, value]) => value !== USUAL[name]);

// The filter in the API's words, without which page.
function asked(filter) {
  const words = new URLSearchParams(set(filter).filter(([name]) => name !== "page" && name !== "of"));
  if (filter.of !== "all") words.set("here", "true");
  return words;
}

function List({ query }) {
  // What stands in the address, so that a list can be shared.
  const [filter, setFilter] = useState({ ...USUAL, ...query });
  const change = (more) => setFilter((old) => ({ ...old, page: "1", ...more }));
  useAddress("/history", Object.fromEntries(set(filter)));
  const words = asked(filter);
  const found = useGet(`/history?${words}&limit=${PER_PAGE}&offset=${PER_PAGE * (filter.page - 1)}`, AGAIN);
  const total = found.value?.total ?? 0;
  const pages = Math.max(1, Math.ceil(total / PER_PAGE));
  useEffect(() => {
    if (found.value && filter.page > pages) change({ page: String(pages) }); // an address of old
  }, [found.value]);
  const turn = (by) => change({ page: String(Number(filter.page) + by) });
  const scope = html`<${Segments} label="Whose prints" value=${filter.of === "all" ? "all" : ""}
    onChange=${(of) => change({ of })} options=${[["", "This workspace"], ["all", "All of this account"]]} />`;
  return html`<${Page} title="History" tools=${scope}>
    <${Card}>
      <${Filters} filter=${filter} change=${change} />
      ${found.value && found.problem && html`<${Failed} problem=${found.problem} again=${found.reload} />`}
      <${Loaded} of=${found} what="Looking through the prints">${(page) => html`
        <${Prints} page=${page} filter=${filter} />`}</${Loaded}>
      ${total > 0 && html`<div class="row history-foot">
        <span role="status">${total === 1 ? "1 print" : `${total} prints`}</span>
        ${pages > 1 && html`<nav class="row" aria-label="Pages of the list">
          <${Button} disabled=${filter.page <= 1} onClick=${() => turn(-1)}>Earlier page</${Button}>
          <span>page ${filter.page} of ${pages}</span>
          <${Button} disabled=${filter.page >= pages} onClick=${() => turn(1)}>Next page</${Button}>
        </nav>`}
        <${Button} href=${url(`/history/csv?${words}`)} download>Export as CSV</${Button}></div>`}
    </${Card}>
    <${Card} title="Verify a record, get the lab's key" fold="history.verify" folded><${Verify} /></${Card}>
  </${Page}>`;
}

function Filters({ filter, change }) {
  const choices = useGet(`/history/choices${filter.of === "all" ? "" : "?here=true"}`).value;
  const search = useTyped(filter.words, (words) => change({ words }), TYPING_MS);
  const choice = (name, label, known, text = (one) => one) => {
    const names = [...new Set([filter[name], ...(known ?? [])])].filter(Boolean);
    return { name, label, kind: "choice", options: [["", "all"], ...names.map((one) => [one, text(one)])] };
  };
  const more = set(filter).filter(([name]) => !["words", "page", "of"].includes(name)).length;
  return html`
    <${Field} kind="search" label="Search: name, operator, hash, alarm" ...${search} maxlength="200" />
    <${Fold} title=${more ? `Narrow and order (${more} set)` : "Narrow and order"} open=${more > 0 || undefined}>
      <${Fields} of=${{ ...filter, descending: filter.descending === "true" }} fields=${[
        choice("state", "End", choices?.states, stateOf), choice("profile", "Printer", choices?.profiles),
        choice("who", "Operator", choices?.people),
        { name: "since", label: "From day", kind: "date" }, { name: "until", label: "To day", kind: "date" },
        { name: "sort", label: "Order", kind: "choice", options: ORDERS },
        { name: "descending", label: "Last first", kind: "flag" },
      ]} onChange=${(next) => change({ ...next, page: "1", descending: String(next.descending) })} />
    </${Fold}>`;
}

const alarms = (many) => (many ? html` <span class="quiet">${many === 1 ? "1 alarm" : `${many} alarms`}</span>` : "");

const COLUMNS = [
  { name: "What", of: (one) => html`<a class="history-name" href=${`/history?print=${one.id}`}>${titleOf(one)}</a>` },
  { name: "End", of: (one) => html`<${End} state=${one.state} />${alarms(one.alarms.length)}` },
  { name: "Begun", of: (one) => when(one.started) },
  { name: "Took", number: true, of: (one) => (one.ended ? span(one.ended - one.started) : "") },
  { name: "Lines", number: true, of: (one) => `${one.done} of ${one.total}` },
  { name: "Printer", of: (one) => one.profile },
  { name: "Operator", of: (one) => one.operator || one.who },
  { name: "Port", of: (one) => one.port },
  { name: "SHA-256", of: (one) => html`<code>${one.sha256.slice(0, 8)}</code>` },
];

function Prints({ page, filter }) {
  if (!page.total) {
    return set(filter).some(([name]) => name !== "of" && name !== "page")
      ? html`<${Empty}>No print fits. Search for fewer words, or narrow less.</${Empty}>`
      : html`<${Empty}>Nothing was printed here yet. Begin with a design on the <a href="/">home page</a>;
          each print is kept here, with its record, from its first line on.</${Empty}>`;
  }
  return html`<div class="history-list">
    <${Table} caption="Prints" columns=${COLUMNS} rows=${page.prints} keyOf=${(one) => one.id} /></div>`;
}

function Verify() {
  const [key, setKey] = useState("");
  const [found, setFound] = useState(null);
  return html`
    <p>Is a record's zip as it was filed, and who signed it? Without another key, this lab's own is the one that is
      trusted.</p>
    <${Drop} label="Choose a record (zip)" accept=".zip" path="/history/verify" field="bundle"
      more=${key.trim() ? { key: new Blob([key]) } : {}}
      onDone=${(check, file) => setFound({ check, name: file.name })} />
    ${found && html`<${Checked} ...${found} />`}
    <${Fold} title="Trust another lab's key"><${Field} kind="long" label="Public key (PEM); empty for this lab's own"
      value=${key} onChange=${setKey} maxlength="2000" /></${Fold}>
    <div class="row"><${Button} href=${url("/history/key")} download>This lab's public key</${Button}></div>`;
}

function Checked({ check, name }) {
  const { good } = check;
  return html`<div role="status"><${Note} tone=${good ? "good" : check.whole ? "warn" : "bad"}>
    <strong>${name}</strong>
    ${check.lines.slice(0, 52).map((line) => html`<p class="lines">${line}</p>`)}
    ${check.print_id && html`<p>It is of ${check.file}, print ${check.print_id}.</p>`}
  </${Note}></div>`;
}
