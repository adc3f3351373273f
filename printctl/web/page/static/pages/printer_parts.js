// What is mounted, the plunger, and changes of needle and syringe step by step.
import {
  Act, Button, Card, Dialog, Facts, Field, Loaded, Progress, html, number, useEffect, useGet, useState,
} from "../ui.js";
import { mm, post } from "./printer_move.js";

const SORTS = ["needle", "syringe", "ink", "dish", "bath"];
const capital = (word) => word[0].toUpperCase() + word.slice(1);
const choices = (list) => list.map((one) => [one.name, `${one.name} · ${one.about}`]);

export function Mounted({ status, onOpen, locked }) {
  const centre = status.mounted.dish_centre_mm;
  const place = centre ? ` at X ${number(centre[0])}, Y ${number(centre[1])}` : ", place not said";
  const said = (sort) => (status.parts[sort] ? status.parts[sort] + (sort === "dish" ? place : "") : "not said");
  return html`<${Card} title="What is mounted" aria-label="What is mounted">
    <${Facts} rows=${SORTS.map((sort) => [capital(sort), said(sort)])} />
    ${!locked && html`
      <p class="hint">Limits and µL follow from this; only you can check it.</p>
      <div class="row">
        <${Button} onClick=${() => onOpen("mount")}>Name the parts …</${Button}>
        <${Button} onClick=${() => onOpen("needle")}>New needle …</${Button}>
      </div>`}
  </${Card}>`;
}

export function Plunger({ status, onOpen, locked }) {
  const { syringe, ink } = status.parts;
  const { ul_left: left, full_ul: full, fastest_ul_s: fastest, plunger_mm: at, plunger_left_mm: rest } = status;
  const [ul, setUl] = useState(1);
  const [rate, setRate] = useState(1);
  useEffect(() => { if (fastest !== null) setRate(Number(fastest.toFixed(3))); }, [syringe, ink, fastest]);
  const push = (sign) => () => {
    if (!ul || !rate) throw new Error("Give a volume and a rate above 0.");
    return post("plunger", { ul: sign * ul, ul_s: rate });
  };
  const fresh = html`<${Button} onClick=${() => onOpen("syringe")}>New syringe …</${Button}>`;
  return html`<${Card} title="Ink in the syringe" aria-label="Ink in the syringe">
    <p>${left === null ? "µL left: not known" : html`<span class="big">${left.toFixed(1)}</span> µL left`}</p>
    ${left !== null && full && html`
      <${Progress} share=${Math.min(1, Math.max(0, left / full))} label="Ink left in the syringe" />`}
    <p class="hint">${!syringe ? "No syringe is named: put in a new one, or say what is mounted."
      : at === null ? "Where the plunger stands isn't known: a new syringe sets its zero."
        : `Plunger at ${at.toFixed(2)} mm of travel${rest === null ? "" : `, ${rest.toFixed(1)} mm to its end`}.`}</p>
    ${syringe && !locked && html`
      <div class="printer-two">
        <${Field} kind="number" label="Volume" unit="µL" min=${0} max=${1000} value=${ul} onChange=${setUl} />
        <${Field} kind="number" label=${`Rate, ≤ ${number(fastest, 3)}`} unit="µL/s" min=${0} value=${rate}
          onChange=${setRate} />
      </div>
      <div class="row row-top">
        <${Act} work=${push(1)}>Push</${Act}>
        <${Act} work=${push(-1)}>Draw back</${Act}>
        ${fresh}
      </div>`}
    ${!syringe && !locked && html`<div>${fresh}</div>`}
  </${Card}>`;
}

export function MountDialog({ status, onClose }) {
  const parts = useGet("/printer/parts");
  const [said, setSaid] = useState(status.parts);
  const [centre, setCentre] = useState(status.mounted.dish_centre_mm ?? [null, null]);
  const say = async () => {
    const others = SORTS.filter((sort) => said[sort] !== status.parts[sort]);
    const changed = Object.fromEntries(others.map((sort) => [sort, said[sort]]));
    const was = status.mounted.dish_centre_mm ?? [null, null];
    if (centre.every(Number.isFinite) && centre.some((one, at) => one !== was[at])) changed.dish_centre_mm = centre;
    await post("mount", changed);
    onClose();
  };
  return html`<${Dialog} title="What is mounted" onClose=${onClose}>
    <${Loaded} of=${parts} what="Reading profiles">${(lists) => html`
      ${SORTS.map((sort) => html`<${Field} key=${sort} kind="choice" label=${capital(sort)} value=${said[sort]}
        options=${[["", "nothing, or not known"], ...choices(lists[sort])]}
        onChange=${(name) => setSaid({ ...said, [sort]: name })} />`)}
      <div class="row row-end">${["X", "Y"].map((axis, at) => html`<div class="grow" key=${axis}>
        <${Field} kind="number" label=${`Dish's middle ${axis}`} unit="mm" min=${-1000} max=${1000} value=${centre[at]}
          onChange=${(value) => setCentre(centre.map((one, which) => (which === at ? value : one)))} /></div>`)}
        ${status.position_mm && html`
          <${Button} onClick=${() => setCentre(status.position_mm.slice(0, 2).map((one) => Number(one.toFixed(3))))}>
            Where the tip is</${Button}>`}
      </div>
      <${Act} kind="main" work=${say}>That is mounted</${Act}>`}</${Loaded}>
  </${Dialog}>`;
}

// --- changes, step by step -------------------------------------------------------------------------

// Steps as [title, body]; the body of the one that is due is shown.
const Steps = ({ steps, at }) => html`<ol class="printer-steps">${steps.map(([title, body], index) => html`
  <li key=${title} aria-current=${index === at ? "step" : undefined}><h3>${title}</h3>
    ${index === at && html`<div class="stack">${body}</div>`}</li>`)}</ol>`;

const raise = (status, next) => ["Raise the needle", html`
  <p>Straight up, out of the bath and above the rim of the dish. The tip is at Z ${mm(status.position_mm?.[2])} mm.</p>
  <div class="row row-top"><${Act} kind="main" work=${() => post("lift-out")}>Raise</${Act}>
    <${Button} onClick=${next}>It is up: next</${Button}></div>`];

export function SyringeDialog({ status, onClose }) {
  const parts = useGet("/printer/parts");
  const [step, setStep] = useState(0);
  const [syringe, setSyringe] = useState(status.parts.syringe);
  const [ink, setInk] = useState(status.parts.ink);
  const [filled, setFilled] = useState(null);
  const [pushed, setPushed] = useState(0);
  const [wiped, setWiped] = useState(false);
  const next = () => setStep(step + 1);
  const purge = (ul) => async () => {
    await post("change/purge", { ul });
    setPushed((sum) => sum + ul);
  };
  const body = (lists) => {
    const chosen = lists.syringe.find((one) => one.name === syringe) ?? lists.syringe[0];
    const volume = filled ?? chosen.volume_ul;
    const putIn = async () => {
      await post("change/syringe", { syringe: chosen.name, ink, filled_ul: volume });
      next();
    };
    const steps = [
      raise(status, next),
      ["Put the syringe in", html`
        <${Field} kind="choice" label="Syringe" value=${chosen.name} options=${choices(lists.syringe)}
          onChange=${(name) => { setSyringe(name); setFilled(null); }} />
        <${Field} kind="choice" label="Ink" value=${ink} options=${[["", "not named"], ...choices(lists.ink)]}
          onChange=${setInk} />
        <${Field} kind="number" label="Filled with" unit="µL" min=${0.1} max=${chosen.volume_ul} value=${volume}
          onChange=${setFilled} />
        <p>Bring the plunger drive down until it touches the syringe's plunger.</p>
        <${Act} kind="main" work=${putIn}>It is in, the plunger touched: zero</${Act}>`],
      ["Push the bubbles out", html`
        <p>Until ink without bubbles comes: at most 5 µL at a time, slowly, 50 µL in all.</p>
        <p role="status">${pushed} µL pushed out</p>
        <div class="row row-top"><${Act} work=${purge(1)}>Push 1 µL</${Act}><${Act} work=${purge(5)}>Push 5 µL</${Act}>
          <${Button} kind="main" onClick=${next}>It comes clean: next</${Button}></div>`],
      ["Wipe the needle", html`
        <p>With a lint-free swab, downwards: its drop would go into the bath.</p>
        <${Field} kind="flag" label="Wiped" value=${wiped} onChange=${setWiped} />
        ${wiped && html`<div><${Button} kind="main" onClick=${onClose}>Done</${Button}></div>`}`],
    ];
    return html`<${Steps} steps=${steps} at=${step} />`;
  };
  return html`<${Dialog} title="Change of syringe" onClose=${onClose}>
    <${Loaded} of=${parts} what="Reading profiles">${body}</${Loaded}></${Dialog}>`;
}

export function NeedleDialog({ status, onClose, onTouchOff }) {
  const parts = useGet("/printer/parts");
  const [step, setStep] = useState(0);
  const [needle, setNeedle] = useState(status.parts.needle);
  const next = () => setStep(step + 1);
  const body = (lists) => {
    const chosen = needle || lists.needle[0].name;
    const putIn = async () => {
      await post("change/needle", { needle: chosen });
      next();
    };
    const steps = [
      raise(status, next),
      ["Put the needle in", html`
        <${Field} kind="choice" label="Needle" value=${chosen} options=${choices(lists.needle)} onChange=${setNeedle} />
        <p>Tighten it: one that turns later stands elsewhere.</p>
        <${Act} kind="main" work=${putIn}>It is in and tight</${Act}>`],
      ["Touch off", html`
        <p>The floor's and the bath's height are forgotten: this needle's tip stands elsewhere. Touch off the floor
          before the next print.</p>
        <div><${Button} kind="main" onClick=${onTouchOff}>To the touch-off</${Button}></div>`],
    ];
    return html`<${Steps} steps=${steps} at=${step} />`;
  };
  return html`<${Dialog} title="Change of needle" onClose=${onClose}>
    <${Loaded} of=${parts} what="Reading profiles">${body}</${Loaded}></${Dialog}>`;
}
