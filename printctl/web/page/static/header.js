// The header: state of printer and print, who holds the controls, whether the server is there.
import { last, listen, send } from "./api.js";
import { nameOf, span, stateOf } from "./ui.js";

const SURE_MS = 4000;
const LONGEST_NAME = 24;
const at = (id) => document.getElementById(id);
let sureUntil = 0;

function put(id, text) {
  if (at(id).textContent !== text) at(id).textContent = text;
}

const PRINTER = {
  connecting: "connecting", ready: "ready", busy: "moving", printing: "printing",
  halted: "HALTED", lost: "CONNECTION LOST", closed: "not connected",
};

// State, share and time left of a print, each in words; "" for a state of none.
export const progressOf = ({ state, share, time_left_s: left }) => [stateOf(state ?? ""),
  Number.isFinite(share) && `${(100 * share).toFixed(1)} %`, Number.isFinite(left) && `${span(left)} left`];

const shortName = (name) => (name.length > LONGEST_NAME ? `${name.slice(0, LONGEST_NAME - 1)}…` : name);

const titles = { print: "", page: "printctl" };

function showTitle(change) {
  Object.assign(titles, change);
  document.title = [titles.print, titles.page].filter(Boolean).join(" · ");
}

export const setTitle = (text) => showTitle({ page: text === "Home" ? "printctl" : `${text} · printctl` });

function onPrint(message) {
  const [state, ...progress] = progressOf(message);
  const job = shortName(nameOf(message.job ?? ""));
  showTitle({ print: state && [job, state].filter(Boolean).join(" ") });
  if (!state) return put("pc-print", "Print: none");
  const words = [`Print: ${state}`, ...progress, message.simulated && "simulated", job]; // last what a phone cuts
  return put("pc-print", words.filter(Boolean).join(", "));
}

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
  at("pc-take").ariaLabel = mine() ? "Release the controls" : null;
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

function showLost() {
  const noDoor = document.documentElement.hasAttribute("data-no-stop-door");
  const said = [];
  if (last("lost")?.lost) {
    said.push("The connection to the server is lost: what you see is old. A print goes on by itself.",
      noDoor ? "EMERGENCY STOP can't reach the printer from here: to halt it, cut its power."
        : "EMERGENCY STOP still works: it has a connection of its own.");
  } else if (noDoor) {
    said.push("The stop process doesn't answer: EMERGENCY STOP depends on the server alone.");
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
    if (link.getAttribute("href") === path) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
}
