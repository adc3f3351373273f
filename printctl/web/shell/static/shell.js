// The header: state of printer and print, who holds the controls, whether the server is there.
(() => {
  "use strict";
  const SILENT_MS = 8000; // the server says something every 3 s
  const AGAIN_MS = 1500;
  const RENEW_MS = 600000;
  const SURE_MS = 4000;
  const LONGEST_NAME = 24;
  const TITLE = document.title;
  const at = (id) => document.getElementById(id);
  const put = (id, text) => {
    const place = at(id);
    if (place && place.textContent !== text) place.textContent = text;
  };

  let you = null;
  let holder = null;
  let lastHeard = performance.now();
  let lost = false;
  let socket = null;
  let sureUntil = 0;

  // --- state in words ----------------------------------------------------------------------

  const STATION = {
    connecting: "connecting",
    ready: "ready",
    busy: "moving",
    printing: "printing",
    halted: "HALTED",
    lost: "CONNECTION LOST",
    closed: "not connected",
  };

  function onStation(message) {
    put("pc-printer", `Printer: ${STATION[message.state] ?? message.state ?? "not connected"}`);
  }

  function left(seconds) {
    const minutes = Math.ceil(seconds / 60);
    return minutes < 90 ? `${minutes} min left` : `${(minutes / 60).toFixed(1)} h left`;
  }

  function named(job) {
    const name = job.replace(/^(run|file)~/, "");
    return name.length > LONGEST_NAME ? `${name.slice(0, LONGEST_NAME - 1)}…` : name;
  }

  function onPrint(message) {
    const state = (message.state ?? "").replaceAll("_", " ");
    const job = named(message.job ?? "");
    document.title = state ? `${[job, state].filter(Boolean).join(" ")} · ${TITLE}` : TITLE;
    if (!state) return put("pc-print", "Print: none");
    const words = [`Print: ${job ? `${job}, ` : ""}${state}`];
    if (Number.isFinite(message.share)) words.push(`${(100 * message.share).toFixed(1)} %`);
    if (Number.isFinite(message.time_left_s)) words.push(left(message.time_left_s));
    put("pc-print", words.join(", "));
  }

  // --- the controls ------------------------------------------------------------------------

  function showControls() {
    const button = at("pc-take");
    if (!button || !you) return;
    const mine = holder && holder.id === you.id;
    const sure = performance.now() < sureUntil;
    put(
      "pc-holder",
      mine ? "You hold the controls" : holder ? `Controls: ${holder.name}` : "Controls: nobody",
    );
    at("pc-holder").title = at("pc-holder").textContent;
    button.hidden = false;
    put("pc-take", mine ? "Release" : !holder ? "Take controls" : sure ? "Sure?" : "Take over");
    button.setAttribute("aria-label", mine ? "Release the controls" : `${button.textContent}`);
  }

  async function pressTake() {
    const mine = holder && holder.id === you?.id;
    if (holder && !mine && performance.now() >= sureUntil) {
      sureUntil = performance.now() + SURE_MS;
      setTimeout(showControls, SURE_MS + 50);
      showControls();
      return;
    }
    sureUntil = 0;
    const answer = await fetch("/api/v1/controls", {
      method: mine ? "DELETE" : "POST",
      headers: { "Content-Type": "application/json" },
      body: mine ? undefined : JSON.stringify({ force: Boolean(holder) }),
    }).catch(() => null);
    if (answer?.ok) onControls(await answer.json());
  }

  function onControls(message) {
    holder = message.holder;
    if (message.you) you = message.you;
    showControls();
  }

  // --- news --------------------------------------------------------------------------------

  function onMessage(message) {
    lastHeard = performance.now();
    if (message.event === "alive") you = message.you;
    if (message.event === "station") onStation(message);
    if (message.event === "print") onPrint(message);
    if (message.event === "controls") holder = message.holder;
    showControls();
    showLost(false);
    document.dispatchEvent(new CustomEvent("printctl", { detail: message }));
  }

  function connect() {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    socket = new WebSocket(`${scheme}//${location.host}/api/v1/events`);
    socket.addEventListener("message", (event) => onMessage(JSON.parse(event.data)));
    socket.addEventListener("close", () => {
      showLost(true);
      setTimeout(again, AGAIN_MS);
    });
  }

  async function again() {
    // Logged out, or the session has ended: the server says so, and the log-in page helps.
    const answer = await fetch("/api/v1/controls", { signal: AbortSignal.timeout(5000) }).catch(
      () => null,
    );
    if (answer?.status === 401) location.reload();
    else connect();
  }

  function showLost(now) {
    const noDoor = document.documentElement.hasAttribute("data-no-stop-door");
    lost = now;
    const said = [];
    if (lost) {
      said.push(
        "The connection to the server is lost: what you see is old. A print goes on by itself.",
      );
      said.push(
        noDoor
          ? "STOP has no way to the printer from here: to halt it, cut its power."
          : "STOP still works, by a way of its own.",
      );
    } else if (noDoor) {
      said.push("The stop process doesn't answer: STOP depends on the server alone.");
    }
    const banner = at("pc-lost");
    if (!banner) return;
    const text = said.join(" ");
    if (banner.textContent !== text) banner.textContent = text;
    banner.hidden = !text;
  }

  // NiceGUI reloads the page when the server doesn't answer for long. A reload from a server that
  // hangs would take the page away, and the stop with it; so it waits until the server is there.
  function keepPage() {
    const nicegui = window.socket;
    if (!nicegui?.io) return void setTimeout(keepPage, 200);
    nicegui.off("connect_error");
    nicegui.on("connect_error", (problem) => {
      if (problem.message === "timeout") nicegui.io.opts.transports = ["polling", "websocket"];
      if (problem.message === "Implicit handshake failed") location.reload();
    });
  }

  document.addEventListener("DOMContentLoaded", () => {
    if (!at("pc-stop")) return;
    at("pc-take")?.addEventListener("click", pressTake);
    connect();
    keepPage();
    setInterval(() => showLost(performance.now() - lastHeard > SILENT_MS), 1000);
    setInterval(() => fetch("/api/v1/controls").catch(() => null), RENEW_MS);
  });
})();
