// Move the tip by hand: the pad, homing, saying where it stands, touching off.
import { send } from "../api.js";
import { Act, Button, Card, Dialog, Facts, Field, Segments, html, useAction, useGet, useState } from "../ui.js";

const AXES = ["X", "Y", "Z"];
const STEPS = [0.01, 0.1, 1, 10].map((mm) => [mm, `${mm} mm`]);
const KEYS = { ArrowLeft: ["x", -1], ArrowRight: ["x", 1], ArrowDown: ["y", -1], ArrowUp: ["y", 1],
  PageDown: ["z", -1], PageUp: ["z", 1] };
const PAD = [["y", 1], ["z", 1], ["x", -1], ["x", 1], ["y", -1], ["z", -1]];

export const mm = (value) => (value === null || value === undefined ? "–" : value.toFixed(2).replace("-", "\u2212"));
export const post = (path, body) => send("POST", `/printer/${path}`, body);
const ends = (low, high) => `${Math.round(10 * low) / 10}…${Math.round(10 * high) / 10}`.replaceAll("-", "\u2212");

export function Move({ status, onOpen }) {
  const [step, setStep] = useState(1);
  const [jog, { problem }] = useAction((axis, sign) => post("jog", { axis, mm: sign * step }));
  // A key that is held repeats; only the first press moves, so that nothing piles up behind it. On a
  // button inside, the keys do what they always do: arrows move the printer on the pad itself alone.
  const press = (event) => {
    if (event.target !== event.currentTarget || !(event.key in KEYS)) return;
    event.preventDefault();
    if (!event.repeat) jog(...KEYS[event.key]);
  };
  const { mounted, soft_low_mm: low, soft_high_mm: high } = status;
  const heights = [["floor", mounted.floor_mm], ["bath", mounted.bath_level_mm], ["rim", status.rim_mm]]
    .filter(([, value]) => value !== null).map(([name, value]) => `${name} ${mm(value)}`).join(", ");
  return html`<${Card} title="Move by hand" aria-label="Move by hand" class="card printer-move">
    <dl class="printer-place">${AXES.map((axis, at) => html`
      <div key=${axis}><dt>${axis}, mm</dt><dd class="big">${mm(status.position_mm?.[at])}</dd></div>`)}</dl>
    <${Segments} label="Step size" options=${STEPS} value=${step} onChange=${setStep} />
    <div class="printer-pad" tabindex="0" role="group" onKeyDown=${press}
      aria-label="Jog pad: arrow keys move X and Y, Page Up and Page Down move Z, by the step chosen">
      ${PAD.map(([axis, sign]) => html`
        <${Button} key=${axis + sign} class=${`button jog-${axis}${sign > 0 ? "up" : "down"}`}
          onClick=${() => jog(axis, sign)}>${axis.toUpperCase()} ${sign > 0 ? "+" : "−"}</${Button}>`)}
    </div>
    ${problem ? html`<p class="problem" role="alert">${problem.message}</p>`
      : html`<p class="hint">Keys on the pad: arrows, Page Up, Page Down.</p>`}
    <div class="row">
      <${Act} work=${() => post("lift-out")}>Up, out of the bath</${Act}>
      <${Button} onClick=${() => onOpen("home")}>Home …</${Button}>
      <${Button} onClick=${() => onOpen("place")}>Where the tip is …</${Button}>
      <${Act} kind="danger" work=${() => post("stop-motion")}>Stop this move</${Act}>
    </div>
    <${Facts} rows=${[
      ["Position", status.position_words.replace(/^position /, "")],
      low.length > 0 && ["May reach", `${AXES.map((axis, at) => `${axis} ${ends(low[at], high[at])}`).join(", ")} mm`],
      ["Heights", heights ? `${heights} mm` : "floor, bath, rim not known yet"],
    ]} />
  </${Card}>`;
}

export function HomeDialog({ onClose }) {
  const [chosen, setChosen] = useState({ x: true, y: true, z: true });
  const [off, setOff] = useState(false);
  const home = async () => {
    const list = Object.keys(chosen).filter((axis) => chosen[axis]);
    if (!list.length) throw new Error("Choose an axis.");
    await post("home", { axes: list, needle_off: off });
    onClose();
  };
  return html`<${Dialog} title="Home" onClose=${onClose}>
    <p>Homing drives an axis to its switch, through whatever is in the way. With a needle above a dish it is refused:
      raise Z and take the needle off first. X and Y home at the height where the tip is now.</p>
    ${Object.keys(chosen).map((axis) => html`<${Field} key=${axis} kind="flag" label=${`${axis.toUpperCase()} axis`}
      value=${chosen[axis]} onChange=${(on) => setChosen({ ...chosen, [axis]: on })} />`)}
    <${Field} kind="flag" label="The needle is taken off" value=${off} onChange=${setOff} />
    <${Act} kind="main" work=${home}>Home these axes</${Act}>
  </${Dialog}>`;
}

export function PlaceDialog({ status, onClose }) {
  const now = status.position_mm ?? [null, null, null];
  const [place, setPlace] = useState(now.map((one) => (one === null ? null : Number(one.toFixed(3)))));
  const say = async () => {
    await post("set-position", { x: place[0], y: place[1], z: place[2] });
    onClose();
  };
  return html`<${Dialog} title="Where the tip is" onClose=${onClose}>
    <p>Nothing moves. The printer calls the place where its tip stands now by these numbers, and trusts them: measure,
      don't guess. What was touched off moves along. Needed after a needle was put on, for no axis homes with one above
      a dish.</p>
    <div class="printer-three">${AXES.map((axis, at) => html`
      <${Field} key=${axis} kind="number" label=${axis} unit="mm" min=${-1000} max=${1000} value=${place[at]}
        onChange=${(value) => setPlace(place.map((one, which) => (which === at ? value : one)))} />`)}</div>
    <${Act} kind="main" work=${say}>The tip stands there</${Act}>
  </${Dialog}>`;
}

// --- touching off ------------------------------------------------------------------------------------

const HOW = {
  floor: "Bring the tip down until the foil just begins to drag under it (without foil: until it just touches), then "
    + "take the reading; go up, and do it again.",
  bath: "Bring the tip down until it just dimples the bath's surface, then take the reading; go up, and do it again.",
};
const FINE_MM = [0.1, 0.02];

export function TouchOff({ status, onOpen }) {
  const asked = useGet("/printer/touch-off", { every: 2000 });
  const [foil, setFoil] = useState(0);
  const after = (work) => async () => {
    await work();
    asked.reload();
  };
  const begin = (surface) => after(() => post("touch-off", { surface, foil_mm: foil ?? 0 }));
  const now = asked.value?.touching;
  const { parts } = status;
  const { floor_mm: floor, bath_level_mm: bath } = status.mounted;
  let stands = `Needle ${parts.needle}: floor ${floor === null ? "not touched off" : `Z ${mm(floor)} mm`}, bath ${
    bath === null ? "not known" : `Z ${mm(bath)} mm`}.`;
  if (status.needs_touch_off) stands = `Needle ${parts.needle}: to be touched off before the next print.`;
  if (!parts.needle) stands = "No needle is named; say first what is mounted.";
  return html`<${Card} title="Needle offset and bath level" aria-label="Needle offset and bath level">
    <p role="status"><strong>${stands}</strong></p>
    ${!now && html`
      <p>Tells the printer where the dish's floor is for the needle mounted, and how high the bath stands: three
        readings within 0.05 mm each.</p>
      ${parts.needle && parts.dish
        ? html`<div class="printer-fine"><${Field} kind="number" label="Foil under the tip" unit="mm" min=${0} max=${2}
            step=${0.01} value=${foil} hint="0 for none" onChange=${setFoil} /></div>`
        : html`<p>The floor needs a needle and a dish.</p>`}
      <div class="row">
        ${parts.needle && parts.dish && html`<${Act} kind="main" work=${begin("floor")}>Touch off the floor</${Act}>`}
        ${parts.needle && html`<${Act} work=${begin("bath")}>Find the bath's surface</${Act}>`}
        ${!(parts.needle && parts.dish) && html`
          <${Button} kind=${parts.needle ? "quiet" : "main"} onClick=${() => onOpen("mount")}>
            Name the parts …</${Button}>`}
      </div>`}
    ${now && html`
      <p>${HOW[now.surface]}</p>
      <div class="printer-fine">
        ${FINE_MM.map((step) => html`
          <${Act} key=${`down${step}`} work=${() => post("jog", { axis: "z", mm: -step })}>Down ${step} mm</${Act}>
          <${Act} key=${`up${step}`} work=${() => post("jog", { axis: "z", mm: step })}>Up ${step} mm</${Act}>`)}
        <span></span><${Act} work=${() => post("jog", { axis: "z", mm: 1 })}>Up 1 mm</${Act}>
      </div>
      <${Act} kind=${now.agrees ? "quiet" : "main"} work=${after(() => post("touch-off/reading"))}>
        Touched at Z ${mm(status.position_mm?.[2])}: take this reading</${Act}>
      <p>Readings: ${now.readings_mm.length ? `${now.readings_mm.map(mm).join(", ")} mm` : "none yet"}</p>
      <p role="status">${now.said}</p>
      <div class="row">
        ${now.agrees && html`<${Act} kind="main" work=${after(() => post("touch-off/use"))}>Use this height</${Act}>`}
        <${Act} work=${after(() => send("DELETE", "/printer/touch-off"))}>Give up</${Act}>
      </div>`}
  </${Card}>`;
}
