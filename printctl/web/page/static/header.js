// The header: state of printer and print, who holds the controls, whether the server is there.
import { last, listen, send } from "./api.js";

const SURE_MS = 4000;
const LONGEST_NAME = 24;
const at = (id) => document.getElementById(id);
let sureUntil = 0;

function put(id, text) {
  const place = at(id);
  if (place.textContent !== text) place.textContent = text;
}

// --- state in words --------------------------------------------------------------------------

const PRINTER = {
  connecting: "connecting", ready: "ready", busy: "moving", printing: "printing",
  halted: "HALTED", lost: "CONNECTION LOST", closed: "not connected",
};

function left(seconds) {
  const minutes = Math.ceil(seconds / 60);
  return minutes < 90 ? `${minutes} min left` : `${(minutes / 60).toFixed(1)} h left`;
}

function shortName(job) {
  const name = job.replace(/^(run|file)~/, "");
  return name.length > LONGEST_NAME ? `${name.slice(0, LONGEST_NAME - 1)}…` : name;
}

let pageTitle = "printctl";
let printTitle = "";

export function setTitle(text) {
  pageTitle = text === "Home" ? "printctl" : `${text} · printctl`;
  document.title = [printTitle, pageTitle].filter(Boolean).join(" · ");
}

function onPrint(message) {
  const state = (message.state ?? "").replaceAll("_", " ");
  const job = shortName(message.job ?? "");
  printTitle = state ? [job, state].filter(Boolean).join(" ") : "";
  document.title = [printTitle, pageTitle].filter(Boolean).join(" · ");
  if (!state) return put("pc-print", "Print: none");
  const words = [`Print: ${state}`];
  if (Number.isFinite(message.share)) words.push(`${(100 * message.share).toFixed(1)} %`);
  if (Number.isFinite(message.time_left_s)) words.push(left(message.time_left_s));
  if (message.simulated) words.push("simulated");
  if (job) words.push(job); // last, where a narrow screen cuts
  return put("pc-print", words.join(", "));
}

// --- the controls ----------------------------------------------------------------------------

const holder = () => last("controls")?.holder ?? null;
const you = () => last("alive")?.you ?? null;
const mine = () => Boolean(holder() && holder().id === you()?.id);

function showControls() {
  if (!you()) return;
  const sure = performance.now() < sureUntil;
  put("pc-holder", mine() ? "You hold the controls" : `Controls: ${holder()?.name ?? "nobody"}`);
  at("pc-holder").title = at("pc-holder").textContent;
  at("pc-take").hidden = false;
  put("pc-take", mine() ? "Release" : !holder() ? "Take controls" : sure ? "Sure?" : "Take over");
  if (mine()) at("pc-take").setAttribute("aria-label", "Release the controls");
  else at("pc-take").removeAttribute("aria-label");
}

async function pressTake() {
  if (holder() && !mine() && performance.now() >= sureUntil) {
    sureUntil = performance.now() + SURE_MS;
    setTimeout(showControls, SURE_MS + 50);
    return showControls();
  }
  sureUntil = 0;
  return mine() ? send("DELETE", "/controls") : send("POST", "/controls", { force: Boolean(holder()) });
}

// --- whether the server is there ---------------------------------------------------------------

function showLost() {
  const noDoor = document.documentElement.hasAttribute("data-no-stop-door");
  const said = [];
  if (last("lost")?.lost) {
    said.push("The connection to the server is lost: what you see is old. A print goes on by itself.");
    said.push(noDoor
      ? "STOP has no way to the printer from here: to halt it, cut its power."
      : "STOP still works, by a way of its own.");
  } else if (noDoor) {
    said.push("The stop process doesn't answer: STOP depends on the server alone.");
  }
  put("pc-lost", said.join(" "));
  at("pc-lost").hidden = !said.length;
}

export function beginHeader() {
  at("pc-take").addEventListener("click", () => pressTake().catch(() => null));
  listen((message) => {
    if (message.event === "station") {
      put("pc-printer", `Printer: ${PRINTER[message.state] ?? message.state ?? "not connected"}`);
    }
    if (message.event === "print") onPrint(message);
    if (message.event === "lost") showLost();
    showControls();
  });
  setInterval(showLost, 1000);
}

export function markCurrent(path) {
  for (const link of document.querySelectorAll(".nav a")) {
    const here = link.getAttribute("href") === path;
    if (here) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
}
