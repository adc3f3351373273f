// Temperatures, and what forces and pressures the profile watches: the last ten minutes, and targets.
import { Act, Button, Card, Empty, Field, Refused, html, useAction, useGet, useState } from "../ui.js";
import { post } from "./printer_move.js";

const SPAN_MIN = 10;
const [WIDE, HIGH] = [400, 170];
const [LEFT, RIGHT, TOP, BOTTOM] = [40, 8, 10, 24];

export function Temperatures({ status, locked }) {
  const kept = useGet("/printer/temperatures", { every: 3000 });
  const { temperatures, readings } = status;
  const columns = kept.value;
  const lines = columns ? Object.keys(columns.now_c) : [];
  return html`<${Card} title="Temperatures" aria-label="Temperatures">
    ${status.unknown.temperatures && html`<${Empty}>Temperatures unknown: ${status.unknown.temperatures}.</${Empty}>`}
    ${lines.length > 0 && html`<${Chart} at=${columns.at_s} values=${columns.now_c} marks=${columns.target_c} unit="°C"
      label="Temperatures of the last ten minutes, targets dotted; numbers below" />`}
    ${temperatures.map((one) => html`
      <${Heater} key=${one.name} ...${one} look=${lines.indexOf(one.name)} locked=${locked} />`)}
    ${!locked && temperatures.filter((one) => one.target_c).length > 1 && html`
      <${Act} post="/printer/heaters-off">All heaters off</${Act}>`}
    ${columns && Object.keys(columns.readings).length > 0 && html`
      <${Chart} at=${columns.at_s} values=${columns.readings} marks=${columns.limits} unit=""
        label="Forces and pressures of the last ten minutes, limits dotted; numbers below" />`}
    ${readings.map((text, at) => html`<p key=${text} class="row">
      <${Sample} look=${at} />${text}</p>`)}
  </${Card}>`;
}

function Heater({ name, now_c: now, target_c: target, look, locked }) {
  const [wanted, setWanted] = useState(null);
  const [set, { busy, problem }] = useAction(async (celsius) => {
    if (celsius === null) throw new Error("Type the target first, °C.");
    await post("heat", { name, celsius });
    setWanted(null);
  });
  const off = wanted === null && target > 0;
  return html`<form class="printer-heater" onSubmit=${(event) => { event.preventDefault(); set(wanted); }}>
    <p class="grow"><${Sample} look=${look} /> ${name} <strong>${now.toFixed(1)} °C</strong>
      <span class="quiet">${target ? ` → ${target.toFixed(1)} °C` : target === 0 ? " off" : ""}</span></p>
    ${target !== null && !locked && html`
      <${Field} kind="number" label=${`Target, ${name}, °C`} placeholder="°C" min=${0} max=${300} value=${wanted}
        onChange=${setWanted} />
      <${Button} busy=${busy} onClick=${() => set(off ? 0 : wanted)}
        aria-label=${off ? `Switch the ${name} off` : `Set the target of the ${name}`}>
        ${off ? "Off" : "Set"}</${Button}>`}
    <${Refused} problem=${problem} />
  </form>`;
}

const Sample = ({ look }) => look < 0 ? null : html`<svg class="printer-sample" viewBox="0 0 24 8" aria-hidden="true">
  <path class=${`line-${look % 4}`} d="M0 4H24" /></svg>`;

// Lines over time, each with a dash of its own; `marks` (targets, limits) are dotted.
function Chart({ at, values, marks, unit, label }) {
  const end = at.at(-1);
  const all = [...Object.values(values), ...Object.values(marks)].flat().filter(Number.isFinite);
  if (!all.length) return null;
  const { low, high, step } = scale(Math.min(...all), Math.max(...all));
  const x = (seconds) => WIDE - RIGHT - ((end - seconds) / 60 / SPAN_MIN) * (WIDE - LEFT - RIGHT);
  const y = (value) => HIGH - BOTTOM - ((value - low) / (high - low)) * (HIGH - TOP - BOTTOM);
  const path = (column) => column.map((value, index) => (value === null ? ""
    : `${index && column[index - 1] !== null ? "L" : "M"}${x(at[index]).toFixed(1)} ${y(value).toFixed(1)}`)).join("");
  const levels = Array.from({ length: Math.round((high - low) / step) + 1 }, (_, index) => low + index * step);
  return html`<svg class="printer-chart" viewBox=${`0 0 ${WIDE} ${HIGH}`} role="img" aria-label=${label}>
    ${levels.map((level) => html`<g key=${level}>
      <path class="level" d=${`M${LEFT} ${y(level).toFixed(1)}H${WIDE - RIGHT}`} />
      <text x=${LEFT - 6} y=${y(level) + 4} text-anchor="end">${Number(level.toPrecision(6))}</text></g>`)}
    <text x="4" y=${HIGH - 6}>${unit}</text>
    ${[[-10, "start", "−10 min"], [-5, "middle", "−5 min"], [0, "end", "now"]].map(([minute, anchor, text]) => html`
      <text key=${minute} x=${x(end + 60 * minute)} y=${HIGH - 6} text-anchor=${anchor}>${text}</text>`)}
    ${Object.entries(values).map(([name, column], look) => html`<g key=${name}>
      ${marks[name] && html`<path class=${`line-${look % 4} mark`} d=${path(marks[name])} />`}
      <path class=${`line-${look % 4}`} d=${path(column)} /></g>`)}
  </svg>`;
}

// Round ends and a round step, with about five levels and at least two units between the ends.
function scale(least, most) {
  const wide = 1.1 * Math.max(most - least, 2);
  const bottom = (least + most - wide) / 2;
  const power = 10 ** Math.floor(Math.log10(wide / 4));
  const step = [1, 2, 5, 10].map((one) => one * power).find((one) => wide / one <= 4);
  const low = Math.floor(bottom / step) * step;
  return { low, high: Math.ceil((bottom + wide) / step) * step, step };
}
