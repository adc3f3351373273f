// The printer's page: connect it, move it, heat it, say what is mounted; the rest in tabs.
import { send } from "../api.js";
import { Act, Button, Card, Field, Fold, Loaded, Loading, Note, Page, Segments, Tabs, html, useEffect, useGet, useKept,
  useNews, useState, useStyle } from "../ui.js";
import { Calibration } from "./printer_calibrate.js";
import { Console, Log, Macros } from "./printer_console.js";
import { Temperatures } from "./printer_heat.js";
import { HomeDialog, Move, PlaceDialog, TouchOff } from "./printer_move.js";
import { MountDialog, Mounted, NeedleDialog, Plunger, SyringeDialog } from "./printer_parts.js";

const DIALOGS = { mount: MountDialog, syringe: SyringeDialog, needle: NeedleDialog, home: HomeDialog, place: PlaceDialog };

// `tab` and `open` of the address name a tab or a dialog that another page sends people to.
export default function Printer({ tab = "daily", open = null }) {
  useStyle("pages/printer.css");
  const first = useGet("/printer/status");
  const status = useNews("station") ?? first.value;
  const [shown, setShown] = useState(tab);
  const [dialog, setDialog] = useState(open);
  const Which = status?.state === "ready" || status?.state === "busy" ? DIALOGS[dialog] : null;
  const close = () => setDialog(null);
  const goTo = (id) => {
    setShown(id);
    history.replaceState(null, "", id === "daily" ? "/printer" : `/printer?tab=${id}`);
  };
  return html`<${Page} title="Printer" tools=${status && html`<${Connection} status=${status} />`}>
    <${Loaded} of=${{ ...first, value: status }} what="Asking how the printer is">${() =>
      html`<${Body} status=${status} tab=${shown} onTab=${goTo} onOpen=${setDialog} />`}</${Loaded}>
    ${Which && html`<${Which} status=${status} onClose=${close} onTouchOff=${() => { close(); goTo("needle"); }} />`}
  </${Page}>`;
}

function Body({ status, tab, onTab, onOpen }) {
  if (status.state === "closed") return html`<${Connect} message=${status.message} />`;
  if (status.state === "connecting") return html`<${Loading} what="Connecting; a board that resets takes some seconds" />`;
  if (status.state === "halting") return html`<${Note} tone="warn">${status.state_words}. ${status.message}</${Note}>`;
  if (status.state === "printing") return html`<${WhilePrinting} status=${status} />`;
  if (status.state === "halted" || status.state === "lost") return html`<${Down} status=${status} />`;
  const props = { status, onOpen, onTab };
  const tabs = [
    { id: "daily", name: "Heat and ink", body: () => html`<div class="printer-two">
      <${Temperatures} status=${status} />
      <div class="stack"><${Mounted} ...${props} /><${Plunger} ...${props} /></div></div>` },
    { id: "needle", name: "Touch off", body: () => html`<${TouchOff} ...${props} />` },
    { id: "console", name: "Console", body: () => html`<div class="printer-two printer-console">
      <${Console} /><${Macros} status=${status} /></div>` },
    { id: "calibration", name: "Calibration", body: () => html`<${Calibration} status=${status} />` },
  ];
  return html`<div class="printer">
    <${Move} ...${props} />
    <div class="stack"><${Tabs} label="What to do" tabs=${tabs} at=${tab} onChange=${onTab} /></div>
  </div>`;
}

// How the connection stands, in one line, and the way out of it.
function Connection({ status }) {
  const open = ["ready", "busy", "printing"].includes(status.state);
  return html`
    <p class="quiet printer-state" role="status"><strong>${status.state_words}</strong>
      ${open && html`<span> · ${status.printer}, ${status.port}</span><span class="printer-firmware"> · ${status.firmware}</span>`}</p>
    ${(status.state === "ready" || status.state === "busy") && html`
      <${Act} work=${() => send("POST", "/printer/disconnect")}>Disconnect</${Act}>`}`;
}

const WAYS = [["simulated", "Simulated printer"], ["real", "A printer at this computer"]];

function Connect({ message }) {
  const profiles = useGet("/printer/profiles");
  const ports = useGet("/printer/ports");
  const [kept, keep] = useKept("printer.connect", { profile: "generic_marlin", way: "simulated" });
  const [port, setPort] = useState(null);
  const [baud, setBaud] = useState("");
  const change = (next) => {
    setBaud("");
    keep({ ...kept, ...next });
  };
  return html`<${Card} title="First connect a printer" class="card printer-connect">
    <p>All else on this page moves, heats or measures with the printer that is connected. You have none at hand?
      The simulated one answers as a real one does, and nothing can break.</p>
    ${message && message !== "no printer is connected" && html`<${Note}>${message}</${Note}>`}
    <${Loaded} of=${profiles} what="Reading printer profiles">${(list) => {
      const chosen = list.find((one) => one.name === kept.profile) ?? list[0];
      const found = ports.value ?? [];
      const fitting = found.filter((one) => one.profiles.includes(chosen.name));
      const at = port ?? (fitting.length === 1 ? fitting[0].device : "auto");
      const real = kept.way === "real";
      const connect = () => send("POST", "/printer/connect", {
        profile: chosen.name,
        port: real ? at : "simulated",
        baud: !real || baud === "" ? null : baud === "auto" ? "auto" : Number(baud),
      });
      return html`
        <${Segments} label="Which printer" options=${WAYS} value=${kept.way} onChange=${(way) => change({ way })} />
        <${Field} label="Printer profile" kind="choice" value=${chosen.name} options=${list.map((one) => [one.name])}
          hint=${chosen.summary} onChange=${(profile) => change({ profile })} />
        ${real && html`
          ${chosen.starting_values.length > 0 && html`<p class="hint">Starting values, to be measured or compared with the
            machine: ${chosen.starting_values.join(", ")}</p>`}
          <div class="row row-end">
            <div class="grow"><${Field} label="Port" kind="choice" value=${at} options=${portOptions(found)}
              hint=${found.length ? "" : "No serial port is seen here: plug the printer in, then look again."}
              problem=${ports.problem?.message} onChange=${setPort} /></div>
            <${Button} onClick=${ports.reload} busy=${ports.loading}>Look again</${Button}>
          </div>
          <${Fold} title="Baud rate">
            <${Field} label="Baud rate" kind="choice" value=${baud} onChange=${setBaud}
              options=${[["", "the profile's"], ["auto", "auto: try each"], ...chosen.bauds.map((one) => [String(one), `${one} Bd`])]} />
          </${Fold}>`}
        <${Act} kind="main" work=${connect}>Connect</${Act}>`;
    }}</${Loaded}>
  </${Card}>`;
}

const portOptions = (found) => [["auto", "auto: the one with the profile's USB id"], ...found.map((one) => [one.device, [
  one.device,
  one.usb_id || "not USB",
  one.profiles.join(", ") || "no profile matches",
].join(" · ")])];

// Halted or lost: what happened, and the way back.
function Down({ status }) {
  return html`
    <${Card} title=${status.state === "lost" ? "The connection is lost" : "The printer has halted"} tone="bad">
      <p>${status.message}</p>
      <p class="quiet">Where the tip stands isn't known any more, and the heaters may be off. Look at the printer first: lift
        the needle by hand, straight up, if it stands in the bath. Then reset the board if it has halted, and reconnect.</p>
      <div class="row">
        <${Act} kind="main" work=${() => send("POST", "/printer/reconnect")}>Reconnect</${Act}>
        <${Act} work=${() => send("POST", "/printer/disconnect")}>Disconnect</${Act}>
        ${status.print_folder && html`<a href="/job">Its print, on the page Job</a>`}
      </div>
    </${Card}>
    <${Card} title="Console" fold="printer.console" folded><${Log} /></${Card}>`;
}

function WhilePrinting({ status }) {
  const errors = useNews("print")?.line_errors;
  return html`
    <${Note}>
      <p><strong>A print goes on:</strong> ${status.message.replace(/^printing: /, "")}${errors ? ` · ${errors} line errors, each sent again` : ""}</p>
      <p>Until it ends, the tip, the heaters and what is mounted belong to it: pause it, cancel it or change the syringe on
        the page Job.</p>
      <${Button} kind="main" href="/job">To the page Job</${Button}>
    </${Note}>
    <div class="printer-two">
      <${Temperatures} status=${status} locked />
      <div class="stack"><${Mounted} status=${status} locked /><${Plunger} status=${status} locked /></div>
    </div>
    <${Console} fold />`;
}
