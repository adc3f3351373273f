// Slices of a scan in three planes, each moved by its slider, drawn to scale.
import { part, url } from "../api.js";
import { Field, Fold, html, number, useEffect, useId, useState } from "../ui.js";

const SETTLED_MS = 60;
const PLANES = [
  { axis: "z", at: 2, name: "From above (along z)", width: 0, height: 1 },
  { axis: "y", at: 1, name: "Along y", width: 0, height: 2 },
  { axis: "x", at: 0, name: "Along x", width: 1, height: 2 },
];

// A value once it has stood still for a moment.
function useSettled(value) {
  const [settled, setSettled] = useState(value);
  useEffect(() => {
    const timer = setTimeout(() => setSettled(value), SETTLED_MS);
    return () => clearTimeout(timer);
  }, [value]);
  return settled;
}

const short = (value) => Number(value.toPrecision(4));

export default function Slices({ scan, volume }) {
  const [low, setLow] = useState(short(volume.low));
  const [high, setHigh] = useState(short(volume.high));
  const [tinted, setTinted] = useState(false);
  const [threshold, setThreshold] = useState(short(volume.threshold));
  const span = volume.high - volume.low;
  const step = short(span / 400);
  const level = (label, value, set, from, to) => html`<${Field} kind="slider" label=${label} value=${value}
    min=${short(from)} max=${short(to)} step=${step} onChange=${(one) => set(short(one))} />`;
  const asked = new URLSearchParams({ low, high, ...(tinted && { threshold }) }).toString();
  const [look, setLook] = useState(asked);
  useEffect(() => low < high && setLook(asked), [asked]); // an empty window has no picture
  const settled = useSettled(look);
  return html`
    <div class="scan-planes">${PLANES.map((plane) => html`
      <${Plane} key=${plane.axis} scan=${scan} volume=${volume} plane=${plane} look=${settled} />`)}</div>
    <${Fold} title="Contrast and threshold"><div class="fields">
      ${level("Black at", low, setLow, volume.low - span / 2, volume.high)}
      ${level("White at", high, setHigh, volume.low, volume.high + span / 2)}
      <${Field} kind="flag" label="Tint what is brighter than" value=${tinted} onChange=${setTinted} />
      ${level("Threshold", threshold, (one) => { setThreshold(one); setTinted(true); }, volume.low, volume.high)}
    </div>
    ${low >= high && html`<p class="problem" role="alert">Black must lie below white.</p>`}
    <p class="hint">The threshold is for looking (it begins at Otsu's); registering finds the surfaces in its own way.
      On the keyboard: arrows move by one slice, Page Up and Page Down by more.</p></${Fold}>`;
}

function Plane({ scan, volume, plane, look }) {
  const count = volume.shape[plane.at];
  const [index, setIndex] = useState(Math.floor(count / 2));
  const settled = useSettled(index);
  const address = url(`/scans/${part(scan)}/slices/${plane.axis}/${settled}?${look}`);
  const [width, height] = [volume.size_mm[plane.width], volume.size_mm[plane.height]];
  const place = `slice ${index + 1} of ${count}, ${number(((index + 0.5) * volume.voxel_um[plane.at]) / 1000, 3)} mm`;
  const id = useId();
  return html`<figure class="scan-plane">
    <figcaption><label for=${id}>${plane.name}</label><span class="quiet">${place}</span></figcaption>
    <img src=${address} alt=${`${plane.name}: ${place}`} style=${{ aspectRatio: `${width} / ${height}` }} />
    <input id=${id} type="range" min="0" max=${count - 1} step="1" value=${index} aria-valuetext=${place}
      onInput=${(event) => setIndex(Number(event.target.value))} />
  </figure>`;
}
