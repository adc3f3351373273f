// Move the tip by hand: the pad, homing, saying where it stands, touching off.
import { send } from "../api.js";
import {
  Act, Ask, Button, Card, Facts, Field, Fields, Known, Refused, Segments, html, useAction, useGet, useRef,
  useState,
} from "../ui.js";

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
  const [go, { problem }] = useAction((axis, sign) => post("jog", { axis, mm: sign * step }));
  // A second click on what stood here before, as Connect did, isn't meant for the needle.
  const shown = useRef(performance.now());
  const jog = (...way) => performance.now() - shown.current > 700 && go(...way);
  // A key that is held repeats; only the first press moves, so that nothing piles up behind it. On a
  // button inside, the keys do what they always do: arrows move the printer on the pad itself alone.
  const press = (event) => {
    if (event.target !== event.currentTarget || !(event.key in KEYS)) return;
    event.preventDefault();
    if (!event.repeat) jog(...KEYS[event.key]);
  };
  const { mounted, soft_low_mm: low, soft_high_mm: high } = status;
  const unknown = status.unknown.position;
  const heights = [["floor", mounted.floor_mm], ["bath", mounted.bath_level_mm], ["rim", status.rim_mm]]
    .filter(([, value]) => value !== null).map(([name, value]) => `${name} ${mm(value)}`).join(", ");
  return html`<${Card} title="Move by hand" aria-label="Move by hand" class="card printer-move">
    <dl class="printer-place">${AXES.map((axis, at) => html`
      <div key=${axis}><dt>${axis}, mm</dt><dd class="big"><${Known} why=${unknown}>${
        status.position_mm && mm(status.position_mm[at])}</${Known}></dd></div>`)}</dl>
    ${unknown && html`<p class="hint">Position unknown: ${unknown}.</p>`}
    <${Segments} label="Step size" options=${STEPS} value=${step} onChange=${setStep} />
    <div class="printer-pad" tabindex="0" role="group" onKeyDown=${press}
      aria-label="Jog pad: arrow keys move X and Y, Page Up and Page Down move Z, by the step chosen">
      ${PAD.map(([axis, sign]) => html`
        <${Button} key=${axis + sign} style=${{ gridArea: `${axis}${sign > 0 ? "up" : "down"}` }}
          onClick=${() => jog(axis, sign)}>${axis.toUpperCase()} ${sign > 0 ? "+" : "−"}</${Button}>`)}
    </div>
    ${problem ? html`<${Refused} problem=${problem} />`
      : html`<p class="hint">Keys on the pad: arrows, Page Up, Page Down.</p>`}
    <div class="row">
      <${Act} post="/printer/lift-out">Up, out of the bath</${Act}>
      <${Button} onClick=${() => onOpen("home")}>Home …</${Button}>
      <${Button} onClick=${() => onOpen("place")}>Where the tip is …</${Button}>
      <${Act} kind="danger" post="/printer/stop-motion">Stop this move</${Act}>
    </div>
    <${Facts} rows=${[
      ["Position", status.position_words.replace(/^position /, "")],
      low.length > 0 && ["May reach", `${AXES.map((axis, at) => `${axis} ${ends(low[at], high[at])}`).join(", ")} mm`],
      ["Heights", heights ? `${heights} mm` : "floor, bath, rim not known yet"],
    ]} />
  </${Card}>`;
}

const HOMED = [
  ...AXES.map((axis) => ({ name: axis.toLowerCase(), kind: "flag", label: `${axis} axis` })),
  { name: "off", kind: "flag", label: "The needle is taken off" },
];

export function HomeDialog({ onClose }) {
  const [chosen, setChosen] = useState({ x: true, y: true, z: true, off: false });
  const home = async () => {
    const axes = ["x", "y", "z"].filter((axis) => chosen[axis]);
    if (!axes.length) throw new Error("Choose an axis.");
    await post("home", { axes, needle_off: chosen.off });
  };
  return html`<${Ask} title="Home" yes="Home these axes" work=${home} onClose=${onClose}
      text=${"Homing drives an axis to its switch, through whatever is in the way. With a needle above a dish it is "
        + "refused: raise Z and take the needle off first. X and Y home at the height where the tip is now."}>
    <${Fields} fields=${HOMED} of=${chosen} onChange=${setChosen} />
  </${Ask}>`;
}

export const coordinate = (name, label = name.toUpperCase()) =>
  ({ name, label, kind: "number", unit: "mm", min: -1000, max: 1000 });
export const rounded = (place) => place.map((one) => (one === null ? null : Number(one.toFixed(3))));

export function PlaceDialog({ status, onClose }) {
  const [x, y, z] = rounded(status.unknown.position ? [null, null, null] : status.position_mm);
  const [place, setPlace] = useState({ x, y, z });
  return html`<${Ask} title="Where the tip is" yes="The tip stands there" work=${() => post("set-position", place)}
      onClose=${onClose} text=${"Nothing moves. The printer calls the place where its tip stands now by these numbers, "
        + "and trusts them: measure, don't guess. What was touched off moves along. Needed after a needle was put on, "
        + "for no axis homes with one above a dish."}>
    <${Fields} fields=${["x", "y", "z"].map((axis) => coordinate(axis))} of=${place} onChange=${setPlace} />
  </${Ask}>`;
}

const HOW = {
  floor: "Bring the tip down until the foil just begins to drag under it (without foil: until it just touches), then "
    + "take the reading; go up, and do it again.",
  bath: "Bring the tip down until it just dimples the bath's surface, then take the reading; go up, and do it again.",
};
const FINE_MM = [-0.1, 0.1, -0.02, 0.02, null, 1];

function heightsOf({ parts, mounted, needs_touch_off: due }) {
  const { floor_mm: floor, bath_level_mm: bath } = mounted;
  if (!parts.needle) return "No needle is named; say first what is mounted.";
  if (due) return `Needle ${parts.needle}: to be touched off before the next print.`;
  return `Needle ${parts.needle}: floor ${floor === null ? "not touched off" : `Z ${mm(floor)} mm`}, bath ${
    bath === null ? "not known" : `Z ${mm(bath)} mm`}.`;
}

export function TouchOff({ status, onOpen }) {
  const asked = useGet("/printer/touch-off", { every: 2000 });
  const [foil, setFoil] = useState(0);
  const after = (path, body) => () => post(path, body).then(asked.reload);
  const begin = (surface) => after("touch-off", { surface, foil_mm: foil ?? 0 });
  const now = asked.value?.touching;
  const { needle, dish } = status.parts;
  const both = needle && dish;
  return html`<${Card} title="Needle offset and bath level" aria-label="Needle offset and bath level">
    <p role="status"><strong>${heightsOf(status)}</strong></p>
    ${!now && html`
      <p>Tells the printer where the dish's floor is for the needle mounted, and how high the bath stands: three
        readings within 0.05 mm each.</p>
      ${both
        ? html`<div class="printer-fine"><${Field} kind="number" label="Foil under the tip" unit="mm" min=${0} max=${2}
            step=${0.01} value=${foil} hint="0 for none" onChange=${setFoil} /></div>`
        : html`<p>The floor needs a needle and a dish.</p>`}
      <div class="row">
        ${both && html`<${Act} kind="main" work=${begin("floor")}>Touch off the floor</${Act}>`}
        ${needle && html`<${Act} work=${begin("bath")}>Find the bath's surface</${Act}>`}
        ${!both && html`<${Button} kind=${needle ? "quiet" : "main"} onClick=${() => onOpen("mount")}>
            Name the parts …</${Button}>`}
      </div>`}
    ${now && html`
      <p>${HOW[now.surface]}</p>
      <div class="printer-fine">${FINE_MM.map((step) => (step === null ? html`<span></span>` : html`
        <${Act} key=${step} post="/printer/jog" body=${{ axis: "z", mm: step }}>
          ${step > 0 ? "Up" : "Down"} ${Math.abs(step)} mm</${Act}>`))}</div>
      <${Act} kind=${now.agrees ? "quiet" : "main"} work=${after("touch-off/reading")}>
        Touched at Z ${mm(status.position_mm?.[2])}: take this reading</${Act}>
      <p>Readings: ${now.readings_mm.length ? `${now.readings_mm.map(mm).join(", ")} mm` : "none yet"}</p>
      <p role="status">${now.said}</p>
      <div class="row">
        ${now.agrees && html`<${Act} kind="main" work=${after("touch-off/use")}>Use this height</${Act}>`}
        <${Act} work=${() => send("DELETE", "/printer/touch-off").then(asked.reload)}>Give up</${Act}>
      </div>`}
  </${Card}>`;
}
