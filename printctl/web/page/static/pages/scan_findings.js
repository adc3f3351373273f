// What a registration found: the verdict first, then alignment and vessels.
import { Badge, Button, Empty, Facts, Fold, Note, Table, html, number, useState } from "../ui.js";

const OUTCOMES = {
  pass: ["good", "Passed"],
  fail: ["bad", "Not passed"],
  undecided: ["warn", "Undecided: neither pass nor fail is proven"],
  "": ["info", "Measured; no verdict yet"],
};
const RANK = { fail: 0, undecided: 1, pass: 3 };
const MOST = 200;

export default function Findings({ found, report }) {
  const [tone, words] = OUTCOMES[found.outcome];
  return html`
    <div class="row">
      <div class="grow" role="status"><${Note} tone=${tone}><strong>${words}</strong></${Note}></div>
      <${Button} kind="main" href=${report}>Show the report</${Button}></div>
    <div class="columns">
      <div class="stack"><h3>Why</h3>
        ${found.reasons.length
          ? html`<ul class="scan-reasons">${found.reasons.map((one) => html`<li>${one}</li>`)}</ul>`
          : html`<${Empty}>The registration gave no reasons.</${Empty}>`}</div>
      <${Fold} title="Alignment" open=${window.innerWidth > 760}>
        <${Facts} rows=${found.alignment.map((one) => [one.name, one.value])} /></${Fold}>
    </div>`;
}

// Decided worst first: not passed, undecided, not seen, passed; of each the farthest off.
const worst = (row) => (RANK[row.verdict.split(":")[0]] ?? 2) * 1e6 - Math.abs(row.error_percent ?? 0);

const um = (name, key) => ({ name, key, number: true, of: (row) => number(row[key], 4) });
const COLUMNS = [
  { name: "Vessel", key: "vessel", of: (row) => row.vessel },
  { name: "Kind", key: "kind", of: (row) => row.kind },
  um("Designed (µm)", "designed_um"),
  um("Measured (µm)", "measured_um"),
  { name: "Error (%)", key: "error_percent", number: true, of: (row) => number(row.error_percent, 2) },
  { name: "RMS (µm)", key: "rms_um", number: true, of: (row) => number(row.rms_um, 2) },
  { name: "Axis off by (µm)", key: "offset_um", number: true, of: (row) => number(row.offset_um, 2) },
  {
    name: "Verdict", key: "verdict",
    of: (row) => html`<${Badge} tone=${toneOf(row.verdict)}>${row.verdict}</${Badge}>`,
  },
];
const toneOf = (verdict) => ({ pass: "good", fail: "bad", undecided: "warn" })[verdict.split(":")[0]] ?? "info";

function compare(a, b) {
  if (a === null || b === null) return (a === null) - (b === null); // what wasn't seen stands last
  return typeof a === "number" ? a - b : String(a).localeCompare(String(b), undefined, { numeric: true });
}

export function Vessels({ rows }) {
  const [order, setOrder] = useState({ key: "", down: false });
  const [all, setAll] = useState(false);
  if (!rows.length) return html`<${Empty}>No vessel was measured.</${Empty}>`;
  const sorted = [...rows].sort((a, b) =>
    order.key ? (order.down ? -1 : 1) * compare(a[order.key], b[order.key]) : worst(a) - worst(b));
  const sort = (key) => setOrder((old) => ({ key, down: old.key === key && !old.down }));
  const mark = html`<span role="img" aria-label=${order.down ? "largest first" : "smallest first"}>${
    order.down ? " ▾" : " ▴"}</span>`;
  const columns = COLUMNS.map((one) => ({
    ...one,
    name: html`<button type="button" class="scan-sort" onClick=${() => sort(one.key)}>${one.name}${
      order.key === one.key && mark}</button>`,
  }));
  const good = rows.filter((one) => one.verdict.startsWith("pass")).length;
  return html`
    <p class="quiet">${good} of ${rows.length} pass${order.key ? "" : "; the worst stand first"}. Press a column's name
      to put them in its order.</p>
    <div class="scan-vessels"><${Table} caption="Vessels" columns=${columns} keyOf=${(row) => row.vessel}
      rows=${all ? sorted : sorted.slice(0, MOST)} /></div>
    ${!all && rows.length > MOST && html`
      <div><${Button} onClick=${() => setAll(true)}>Show all ${rows.length}</${Button}></div>`}`;
}
