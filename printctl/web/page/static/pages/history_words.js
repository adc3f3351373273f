// Words of past prints, for the list and for one print.

import { RECORD } from "../record.js";
import { nameOf, when } from "../ui.js";

// A print is known by its design; G-code that was brought by its file.
export const titleOf = (print) => nameOf(print.job) || print.file || "(no name)";
export const stateOf = (state) => state.replaceAll("_", " ");

// --- what the operator noted ---------------------------------------------------------------------

const NAMES = {
  ...Object.fromEntries(RECORD.map(({ name, label, unit }) => [name, unit ? `${label} (${unit})` : label])),
  mixed_at: "Mixed", sterility: "Sterility", ticked: "Checklist",
};
const UNNAMED = ["text", "note", "step", "name"];
const isRecord = (value) => value !== null && typeof value === "object" && !Array.isArray(value);

function textOf(key, value) {
  if (key === "ticked" && isRecord(value)) {
    const ticks = Object.values(value);
    return `${ticks.filter((one) => one === true).length} of ${ticks.length} points ticked before the start`;
  }
  if (key === "mixed_at" && typeof value === "number") return when(value);
  if (typeof value === "number") return value.toLocaleString([], { maximumFractionDigits: 6 });
  return isRecord(value) || Array.isArray(value) ? JSON.stringify(value) : String(value);
}

const isEmpty = (value) =>
  value === null || value === "" || (typeof value === "object" && Object.keys(value).length === 0);

// Names and values; those that nobody filled in are left out.
export const notedValues = (note) =>
  Object.entries(isRecord(note.values) ? note.values : {})
    .filter(([, value]) => !isEmpty(value))
    .map(([key, value]) => [NAMES[key] ?? key.replaceAll("_", " "), textOf(key, value)]);

// Steps after the print, or notes, each in a line: when, who, what.
export const notedLines = (note, list) => (Array.isArray(note[list]) ? note[list] : []).slice(0, 500).map(lineOf);

function lineOf(entry) {
  if (!isRecord(entry)) return String(entry);
  const { at, who, ...rest } = entry;
  const words = Object.entries(rest).filter(([, value]) => value !== null && value !== "").map(([key, value]) => {
    if (typeof value === "boolean") return value ? `(${key})` : `(not ${key})`;
    return UNNAMED.includes(key) ? textOf(key, value) : `${key}: ${textOf(key, value)}`;
  });
  return [typeof at === "number" ? when(at) : "", who ?? "", ...words].filter(Boolean).join("  ");
}
