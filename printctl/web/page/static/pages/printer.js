// The printer's page: connect it, move it, heat it, say what is mounted; the rest in tabs.
import {
  Act, Button, Card, Field, Fold, Loaded, Loading, Note, Page, Segments, Tabs, html, useAction, useAddress, useGet,
  nameOf, useKept, useNews, useState, useStyle,
} from "../ui.js";
import { part } from "../api.js";
import { Calibration } from "./printer_calibrate.js";
import { Console, Log, Macros } from "./printer_console.js";
import { Temperatures } from "./printer_heat.js";
import { HomeDialog, Move, PlaceDialog, TouchOff, post } from "./printer_move.js";
import { MountDialog, Mounted, NeedleDialog, Plunger, SyringeDialog } from "./printer_parts.js";

const DIALOGS = {
  mount: MountDialog, syringe: SyringeDialog, needle: NeedleDialog, home: HomeDialog, place: PlaceDialog,
};
const standsBy = ({ state }) => state === "ready" || state === "busy";
// A printer that was never reached is lost, too, and its station has ended: there is nothing to reconnect.
const none = ({ state, firmware }) => state === "closed" || state === "connecting" || (state === "lost" && !firmware);

// `tab` and `open` of the address name a tab or a dialog that another page sends people to.
// `job` is the one that was being set up: there it goes on once a printer is connected.
export default function Printer({ tab = "daily", open = null, job = null }) {
  useStyle("pages/printer.css");
  const first = useGet("/printer/status");
  const status = useNews("station") ?? first.value;
  const [shown, setShown] = useState(tab);
  const [dialog, setDialog] = useState(open);
  const Which = status && standsBy(status) ? DIALOGS[dialog] : null;
  const close = () => setDialog(null);
  useAddress("/printer", { tab: shown !== "daily" && shown, job });
  return html`<${Page} title="Printer" tools=${status && !none(status) && html`<${Connection} status=${status} />`}>
    ${job && status && standsBy(status) && html`<${Note} tone="good">
      <${Button} kind="main" href=${`/job?job=${part(job)}`}>Back to ${nameOf(job)}</${Button}></${Note}>`}
    <${Loaded} of=${{ ...first, value: status }} what="Asking how the printer is">${() =>
      html`<${Body} status=${status} tab=${shown} onTab=${setShown} onOpen=${setDialog} />`}</${Loaded}>
    ${Which && html`<${Which} status=${status} onClose=${close}
      onTouchOff=${() => { close(); setShown("needle"); }} />`}
  </${Page}>`;
}

function Body({ status, tab, onTab, onOpen }) {
  if (none(status)) return html`<${Connect} status=${status} />`;
  if (status.state === "halting") return html`<${Note} tone="warn">${status.state_words}. ${status.message}</${Note}>`;
  if (status.state === "printing") return html`<${WhilePrinting} status=${status} />`;
  if (!standsBy(status)) return html`<${Down} status=${status} />`;
  const props = { status, onOpen };
  const tabs = [
    { id: "daily", name: "Heat and ink", body: () => html`<${Daily} ...${props} />` },
    { id: "needle", name: "Touch off", body: () => html`<${TouchOff} ...${props} />` },
    { id: "console", name: "Console", body: () => html`<div class="columns printer-console">
      <${Console} /><${Macros} status=${status} /></div>` },
    { id: "calibration", name: "Calibration", body: () => html`<${Calibration} status=${status} />` },
  ];
  return html`
    ${status.state === "ready" && status.message !== "ready" && html`<${Note}>${status.message}</${Note}>`}
    <div class="printer">
      <${Move} ...${props} />
      <div class="stack"><${Tabs} label="What to do" tabs=${tabs} at=${tab} onChange=${onTab} /></div>
    </div>`;
}

const Daily = (props) => html`<div class="columns"><${Temperatures} ...${props} />
  <div class="stack"><${Mounted} ...${props} /><${Plunger} ...${props} /></div></div>`;

// How the connection stands, in one line, and the way out of it.
const Connection = ({ status }) => html`
  <p class="quiet printer-state" role="status"><strong>${status.state_words}</strong>
    ${(standsBy(status) || status.state === "printing") && html`<span> · ${status.printer}, ${status.port}</span>
      <span class="printer-firmware"> · ${status.firmware}</span>`}</p>
  ${standsBy(status) && html`<${Act} post="/printer/disconnect">Disconnect</${Act}>`}`;

const WAYS = [["simulated", "Simulated printer"], ["real", "A printer at this computer"]];
const NONE = "no printer is connected"; // as the server says before the first one
const BAUDS = [["", "the profile's"], ["auto", "auto: try each"]];

function Connect({ status, again }) {
  const profiles = useGet("/printer/profiles");
  const ports = useGet("/printer/ports");
  const [kept, keep] = useKept("printer.connect", { profile: "generic_marlin", way: "simulated" });
  const [port, setPort] = useState(null);
  const [baud, setBaud] = useState("");
  // Here and not in a button: the form goes while it connects, and what was refused must stay.
  const [connect, { busy, problem }] = useAction((body) => post("connect", body));
  const change = (next) => {
    setBaud("");
    keep({ ...kept, ...next });
  };
  const form = (list) => {
    const chosen = list.find((one) => one.name === kept.profile) ?? list[0];
    const found = ports.value ?? [];
    const fitting = found.filter((one) => one.profiles.includes(chosen.name));
    const at = port ?? (fitting.length === 1 ? fitting[0].device : "auto");
    const real = kept.way === "real";
    const body = { profile: chosen.name, port: real ? at : "simulated", baud: real && baud !== "" ? baud : null };
    return html`
      <${Segments} label="Which printer" options=${WAYS} value=${kept.way} onChange=${(way) => change({ way })} />
      <${Field} label="Printer profile" kind="choice" value=${chosen.name} options=${list.map((one) => one.name)}
        hint=${chosen.summary} onChange=${(profile) => change({ profile })} />
      ${real && html`
        ${chosen.starting_values.length > 0 && html`<p class="hint">Starting values, to be measured or compared with
          the machine: ${chosen.starting_values.join(", ")}</p>`}
        <div class="row row-end">
          <div class="grow"><${Field} label="Port" kind="choice" value=${at} options=${portOptions(found)}
            hint=${found.length ? "" : "No serial port is seen here: plug the printer in, then look again."}
            problem=${ports.problem?.message} onChange=${setPort} /></div>
          <${Button} onClick=${ports.reload} busy=${ports.loading}>Look again</${Button}>
        </div>
        <${Fold} title="Baud rate">
          <${Field} label="Baud rate" kind="choice" value=${baud} onChange=${setBaud}
            options=${[...BAUDS, ...chosen.bauds.map((one) => [one, `${one} Bd`])]} />
        </${Fold}>`}
      <div><${Button} kind="main" onClick=${() => connect(body)}>Connect</${Button}></div>`;
  };
  const connecting = busy || status.state === "connecting";
  const said = problem ? problem.message : !(connecting || again || status.message === NONE) && status.message;
  return html`<${Card} title=${again ? "Connect anew" : "First connect a printer"} class="card printer-connect">
    <p>All else on this page moves, heats or measures with the printer that is connected. You have none at hand?
      The simulated one answers as a real one does, and nothing can break.</p>
    ${!again && html`<p>A printer that was never used here? <a href="/commission">Set up a printer</a> step by step.</p>`}
    ${connecting
      ? html`<${Loading} what="Connecting; a board that resets takes some seconds" />`
      : html`<${Loaded} of=${profiles} what="Reading printer profiles">${form}</${Loaded}>`}
    ${said && html`<${Note} tone=${problem || status.state === "lost" ? "bad" : "info"}>${said}</${Note}>`}
  </${Card}>`;
}

function portOptions(found) {
  const names = ({ device, usb_id: id, profiles }) =>
    [device, id || "not USB", profiles.join(", ") || "no profile matches"].join(" · ");
  return [["auto", "auto: the one with the profile's USB id"], ...found.map((one) => [one.device, names(one)])];
}

const Down = ({ status }) => html`
  <${Card} title=${status.state === "lost" ? "The connection is lost" : "The printer has halted"} tone="bad">
    <p>${status.message}</p>
    <p class="quiet">Where the tip stands isn't known any more, and the heaters may be off. Look at the printer first:
      lift the needle by hand, straight up, if it stands in the bath. Then reset the board if it has halted, and
      reconnect.</p>
    <div class="row">
      <${Act} kind="main" post="/printer/reconnect">Reconnect</${Act}>
      <${Act} post="/printer/disconnect">Disconnect</${Act}>
      ${status.print_folder && html`<a href="/job">Its print, on the Job page</a>`}
    </div>
  </${Card}>
  ${status.state === "lost" && html`<${Fold} title="Another printer, or another port">
    <${Connect} status=${status} again /></${Fold}>`}
  <${Card} title="Console" fold="printer.console" folded><${Log} /></${Card}>`;

function WhilePrinting({ status }) {
  const errors = useNews("print")?.line_errors;
  const resent = errors ? ` · ${errors} line errors, each sent again` : "";
  return html`
    <${Note}>
      <p><strong>A print goes on:</strong> ${status.message.replace(/^printing: /, "")}${resent}</p>
      <p>Until it ends, the tip, the heaters and what is mounted belong to it: pause it, cancel it or change the syringe
        on the Job page.</p>
      <${Button} kind="main" href="/job">To the Job page</${Button}>
    </${Note}>
    <${Daily} status=${status} locked />
    <${Console} fold />`;
}
