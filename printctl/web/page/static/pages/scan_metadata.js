// What a scan's file doesn't say and a person must: voxel size and kin. Only what is missing is asked for.
import { part, send } from "../api.js";
import { Act, Field, Fold, Note, html, useState } from "../ui.js";

const choice = (label, name, options) => ({ label, name, kind: "choice", options: [["", "–"], ...options] });
const flag = (label, name, yes, no) => choice(label, name, [[true, yes], [false, no]]);
const FIELDS = {
  voxel_um: { label: "the voxel size", parts: ["Voxel along x", "along y", "along z"], unit: "µm" },
  modality: choice("what scanned", "Scanned by", [["oct", "OCT"], ["microct", "micro-CT"], "confocal"]),
  scale: choice("what its grey values are", "Grey values", [["linear", "linear intensity"], ["db", "dB"]]),
  refractive_index: {
    label: "the refractive index", name: "Refractive index (hydrogels near 1.34)", kind: "number", min: 1, max: 2,
  },
  optical_depth: flag("what its depth counts", "Depth voxel counts", "optical path", "length"),
  depth_down: flag("which way depth grows", "Depth index grows", "down", "up"),
  axes: { label: "the order of its axes", name: "Order of axes, slowest first", kind: "text", placeholder: "zyx" },
  mirrored: flag("whether it is mirrored", "Axes are mirrored", "yes (left-handed)", "no"),
  db_range: { label: "dB of its counts", parts: ["dB of the lowest and the highest count", "to"] },
  count_range: { label: "the counts of those dB", parts: ["Counts that mean them", "to"] },
  counts_per_db: { label: "counts per dB", name: "or counts per dB", kind: "number", min: 0 },
  db_at_zero: { label: "dB of count 0", name: "dB of count 0", kind: "number" },
};
const LIGHT = ["refractive_index", "optical_depth", "depth_down", "axes"]; // only OCT must say them
const DECIBELS = ["db_range", "count_range", "counts_per_db", "db_at_zero"];

// The form with a sentence before it, for a scan that can't be shown yet.
export function Missing({ needs, uploaded, ...more }) {
  const names = needs.missing.map((name) => FIELDS[name]?.label ?? name);
  return html`
    <${Note} tone=${names.length ? "warn" : "bad"}>
      <p>${names.length ? html`The file can be read, but doesn't say <strong>${listed(names)}</strong>. The device's
        manual or its export window does.` : needs.problem}</p></${Note}>
    ${uploaded && html`<${Metadata} needs=${needs} ...${more} />`}`;
}

const listed = (names) => (names.length < 2 ? names.join("") : `${names.slice(0, -1).join(", ")} and ${names.at(-1)}`);

export function Metadata({ scan, needs, onSaid }) {
  const [said, setSaid] = useState(needs.said);
  const set = (name) => (value) => setSaid((old) => ({ ...old, [name]: value }));
  const asked = needs.missing.filter((name) => !(LIGHT.includes(name) && said.modality && said.modality !== "oct"));
  const added = [
    ...(said.modality === "oct" ? LIGHT.filter((name) => name !== "axes" || asked.length) : []),
    ...(said.scale === "db" ? DECIBELS : []),
  ];
  const plain = Object.keys(FIELDS).filter((name) => !DECIBELS.includes(name));
  const due = [...new Set([...(needs.missing.length ? asked : plain), ...added])];
  const rest = Object.keys(FIELDS).filter((name) => !due.includes(name));
  const draw = (name) => html`<${One} key=${name} name=${name} value=${said[name]} onChange=${set(name)} />`;
  const keep = async () => {
    await send("PUT", `/scans/${part(scan)}/said`, said);
    onSaid();
  };
  return html`
    ${!needs.missing.length && html`<p class="hint">What is filled in here stands above what the file says; the rest is as
      in the file.</p>`}
    <div class="fields">${due.map(draw)}</div>
    ${rest.length > 0 && html`<${Fold} title="More that can be said">
      <div class="fields">${rest.map(draw)}</div></${Fold}>`}
    <div class="row"><${Act} kind="main" work=${keep}>Keep and show the scan</${Act}></div>`;
}

function One({ name, value, onChange }) {
  const { label, name: words, parts, unit, ...field } = FIELDS[name];
  if (parts) return html`<${Numbers} names=${parts} unit=${unit} value=${value} onChange=${onChange} />`;
  return html`<${Field} ...${field} label=${words} value=${value}
    onChange=${(one) => onChange(one === "" ? null : one)} />`;
}

// Numbers that belong together; none of them given is none.
function Numbers({ names, unit, value, onChange }) {
  const at = value ?? names.map(() => null);
  const set = (k) => (one) => {
    const next = at.map((old, j) => (j === k ? one : old));
    onChange(next.every((each) => each === null) ? null : next);
  };
  return html`<div class="scan-numbers">${names.map((label, k) => html`
    <${Field} key=${label} kind="number" label=${label} unit=${unit} value=${at[k]} onChange=${set(k)} />`)}</div>`;
}
