// What is mounted, the plunger, and changes of needle and syringe step by step.
import {
  Act, Ask, Button, Card, Dialog, Facts, Field, Fields, Known, Loaded, Progress, html, number, sentence, useEffect,
  useGet, useState,
} from "../ui.js";
import { coordinate, mm, post, rounded } from "./printer_move.js";

const SORTS = ["needle", "syringe", "ink", "dish", "bath"];
const choices = (list) => list.map((one) => [one.name, `${one.name} · ${one.about}`]);

export function Mounted({ status, onOpen, locked }) {
  const centre = status.mounted.dish_centre_mm;
  const place = centre ? ` at X ${number(centre[0])}, Y ${number(centre[1])}` : ", place not said";
  const said = (sort) => (status.parts[sort] ? status.parts[sort] + (sort === "dish" ? place : "") : "not said");
  return html`<${Card} title="What is mounted" aria-label="What is mounted">
    <${Facts} rows=${SORTS.map((sort) => [sentence(sort), said(sort)])} />
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
  const [push, setPush] = useState({ ul: 1, ul_s: 1 });
  useEffect(() => {
    if (fastest !== null) setPush((old) => ({ ...old, ul_s: Number(fastest.toFixed(3)) }));
  }, [syringe, ink, fastest]);
  const pushed = (sign) => () => {
    if (!push.ul || !push.ul_s) throw new Error("Give a volume and a rate above 0.");
    return post("plunger", { ...push, ul: sign * push.ul });
  };
  return html`<${Card} title="Ink in the syringe" aria-label="Ink in the syringe">
    <p><${Known} why=${status.unknown.ink}>${
      left !== null && html`<span class="big">${left.toFixed(1)}</span>`}</${Known}> µL left</p>
    ${left !== null && full && html`
      <${Progress} share=${Math.min(1, Math.max(0, left / full))} label="Ink left in the syringe" />`}
    <p class="hint">${status.unknown.ink ? `Ink left unknown: ${status.unknown.ink}; put in a new syringe.`
        : `Plunger at ${at.toFixed(2)} mm of travel${rest === null ? "" : `, ${rest.toFixed(1)} mm to its end`}.`}</p>
    ${!locked && html`
      ${syringe && html`<${Fields} of=${push} onChange=${setPush} fields=${[
        { name: "ul", label: "Volume", unit: "µL", kind: "number", min: 0, max: 1000 },
        { name: "ul_s", label: `Rate, ≤ ${number(fastest, 3)}`, unit: "µL/s", kind: "number", min: 0 },
      ]} />`}
      <div class="row row-top">
        ${syringe && html`<${Act} work=${pushed(1)}>Push</${Act}><${Act} work=${pushed(-1)}>Draw back</${Act}>`}
        <${Button} onClick=${() => onOpen("syringe")}>New syringe …</${Button}>
      </div>`}
  </${Card}>`;
}

export function MountDialog({ status, onClose }) {
  const parts = useGet("/printer/parts");
  const [x, y] = status.mounted.dish_centre_mm ?? [null, null];
  const before = { ...status.parts, x, y };
  const [said, setSaid] = useState(before);
  const say = () => {
    const changed = SORTS.filter((sort) => said[sort] !== before[sort]).map((sort) => [sort, said[sort]]);
    const centre = [said.x, said.y];
    if (centre.every(Number.isFinite) && (said.x !== x || said.y !== y)) changed.push(["dish_centre_mm", centre]);
    return post("mount", Object.fromEntries(changed));
  };
  const tip = () => {
    const [here, there] = rounded(status.position_mm);
    setSaid({ ...said, x: here, y: there });
  };
  const fields = (lists) => [
    ...SORTS.map((sort) => ({ name: sort, kind: "choice", label: sentence(sort),
      options: [["", "nothing, or not known"], ...choices(lists[sort])] })),
    coordinate("x", "Dish's middle X"), coordinate("y", "Dish's middle Y"),
  ];
  return html`<${Ask} title="What is mounted" yes="That is mounted" work=${say} onClose=${onClose}
      tools=${status.position_mm && html`<${Button} onClick=${tip}>The dish's middle is where the tip is</${Button}>`}>
    <${Loaded} of=${parts} what="Reading profiles">${(lists) => html`
      <${Fields} fields=${fields(lists)} of=${said} onChange=${setSaid} />`}</${Loaded}>
  </${Ask}>`;
}

// Steps of a change: `steps(profiles, next)` gives them after the first, which raises the needle, as [title, body].
function Change({ title, status, steps, onClose }) {
  const parts = useGet("/printer/parts");
  const [step, setStep] = useState(0);
  const next = () => setStep((old) => old + 1);
  const raise = ["Raise the needle", html`
    <p>Straight up, out of the bath and above the rim of the dish. The tip is at
      Z <${Known} why=${status.unknown.position}>${mm(status.position_mm?.[2])}</${Known}> mm.</p>
    <div class="row row-top"><${Act} kind="main" post="/printer/lift-out">Raise</${Act}>
      <${Button} onClick=${next}>It is up: next</${Button}></div>`];
  return html`<${Dialog} title=${title} onClose=${onClose}>
    <${Loaded} of=${parts} what="Reading profiles">${(lists) => html`
      <ol class="todo">${[raise, ...steps(lists, next)].map(([name, body], at) => html`
      <li key=${name} aria-current=${at === step ? "step" : undefined}><h3>${name}</h3>
        ${at === step && html`<div class="stack">${body}</div>`}</li>`)}</ol>`}</${Loaded}></${Dialog}>`;
}

export function SyringeDialog({ status, onClose }) {
  const [put, setPut] = useState({ syringe: status.parts.syringe, ink: status.parts.ink, filled_ul: null });
  const [pushed, setPushed] = useState(0);
  const [wiped, setWiped] = useState(false);
  const purge = (ul) => html`<${Act} post="/printer/change/purge" body=${{ ul }}
    work=${() => setPushed((sum) => sum + ul)}>Push ${ul} µL</${Act}>`;
  const steps = (lists, next) => {
    const chosen = lists.syringe.find((one) => one.name === put.syringe) ?? lists.syringe[0];
    const now = { syringe: chosen.name, ink: put.ink, filled_ul: put.filled_ul ?? chosen.volume_ul };
    const change = (to) => setPut(to.syringe === chosen.name ? to : { ...to, filled_ul: null });
    return [
      ["Put the syringe in", html`
        <${Fields} of=${now} onChange=${change} fields=${[
          { name: "syringe", kind: "choice", label: "Syringe", options: choices(lists.syringe) },
          { name: "ink", kind: "choice", label: "Ink", options: [["", "not named"], ...choices(lists.ink)] },
          { name: "filled_ul", kind: "number", label: "Filled with", unit: "µL", min: 0.1, max: chosen.volume_ul },
        ]} />
        <p>Bring the plunger drive down until it touches the syringe's plunger.</p>
        <${Act} kind="main" work=${() => post("change/syringe", now).then(next)}>
          It is in, the plunger touched: zero</${Act}>`],
      ["Push the bubbles out", html`
        <p>Until ink without bubbles comes: at most 5 µL at a time, slowly, 50 µL in all.</p>
        <p role="status">${pushed} µL pushed out</p>
        <div class="row row-top">${purge(1)}${purge(5)}
          <${Button} kind="main" onClick=${next}>It comes clean: next</${Button}></div>`],
      ["Wipe the needle", html`
        <p>With a lint-free swab, downwards: its drop would go into the bath.</p>
        <${Field} kind="flag" label="Wiped" value=${wiped} onChange=${setWiped} />
        ${wiped && html`<div><${Button} kind="main" onClick=${onClose}>Done</${Button}></div>`}`],
    ];
  };
  return html`<${Change} title="Change of syringe" status=${status} steps=${steps} onClose=${onClose} />`;
}

export function NeedleDialog({ status, onClose, onTouchOff }) {
  const [needle, setNeedle] = useState(status.parts.needle);
  const steps = (lists, next) => {
    const chosen = needle || lists.needle[0].name;
    return [
      ["Put the needle in", html`
        <${Field} kind="choice" label="Needle" value=${chosen} options=${choices(lists.needle)} onChange=${setNeedle} />
        <p>Tighten it: one that turns later stands elsewhere.</p>
        <${Act} kind="main" work=${() => post("change/needle", { needle: chosen }).then(next)}>
          It is in and tight</${Act}>`],
      ["Touch off", html`
        <p>The floor's and the bath's height are forgotten: this needle's tip stands elsewhere. Touch off the floor
          before the next print.</p>
        <div><${Button} kind="main" onClick=${onTouchOff}>To the touch-off</${Button}></div>`],
    ];
  };
  return html`<${Change} title="Change of needle" status=${status} steps=${steps} onClose=${onClose} />`;
}
