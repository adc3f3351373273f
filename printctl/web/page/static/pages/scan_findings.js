// What a registration found: the verdict first, then alignment and vessels.
import {
  Badge, Bullets, Button, Empty, Facts, Fold, Table, Verdict, html, number, toneOf, useFew, useState,
} from "../ui.js";

const RANK = { fail: 0, undecided: 1, pass: 3 };
const MOST = 200;

export default function Findings({ found, report }) {
  return html`
    <div class="row"><${Verdict} outcome=${found.outcome} />
      <${Button} kind="main" href=${report}>Show the report</${Button}></div>
    <div class="columns">
      <div class="stack"><h3>Why</h3>
        ${found.reasons.length ? html`<${Bullets} rows=${found.reasons} />`
          : html`<${Empty}>The registration gave no reasons.</${Empty}>`}</div>
      <${Fold} title="Alignment" open=${window.innerWidth > 760}>
        <${Facts} rows=${found.alignment.map((one) => [one.name, one.value])} /></${Fold}>
    </div>`;
}

// Decided worst first: not passed, undecided, not seen, passed; of each the farthest off.
const worst = (row) => (RANK[row.verdict.split(":")[0]] ?? 2) * 1e6 - Math.abs(row.error_percent ?? 0);

const figure = (name, key, digits = 2) => ({ name, key, number: true, of: (row) => number(row[key], digits) });
const COLUMNS = [
  { name: "Vessel", key: "vessel", of: (row) => row.vessel },
  { name: "Kind", key: "kind", of: (row) => row.kind },
  figure("Designed (µm)", "designed_um", 4), figure("Measured (µm)", "measured_um", 4),
  figure("Error (%)", "error_percent"), figure("RMS (µm)", "rms_um"), figure("Axis off by (µm)", "offset_um"),
  { name: "Verdict", key: "verdict",
    of: ({ verdict }) => html`<${Badge} tone=${toneOf(verdict)}>${verdict}</${Badge}>` },
];

function compare(a, b) {
  if (a === null || b === null) return (a === null) - (b === null); // what wasn't seen stands last
  return typeof a === "number" ? a - b : String(a).localeCompare(String(b), undefined, { numeric: true });
}

export function Vessels({ rows }) {
  const [order, setOrder] = useState({ key: "", down: false });
  const sorted = [...rows].sort((a, b) =>
    order.key ? (order.down ? -1 : 1) * compare(a[order.key], b[order.key]) : worst(a) - worst(b));
  const [few, more] = useFew(sorted, MOST);
  if (!rows.length) return html`<${Empty}>No vessel was measured.</${Empty}>`;
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
    <div class="scan-vessels"><${Table} caption="Vessels" columns=${columns} keyOf=${(row) => row.vessel} rows=${few}
      tall /></div>${more}`;
}
