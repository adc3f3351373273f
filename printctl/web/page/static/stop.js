// The emergency stop. Plain script: it needs neither the page's modules nor the server's event loop.
//
// A stop goes out twice at once: to the stop process, a process of its own on a port of its own (so
// that no hanging request of the page stands before it), and to the server.
(() => {
  "use strict";
  const TWICE_MS = 1000;
  const PATIENCE_MS = 6000;
  const ALIVE_MS = 10000;
  const port = document.querySelector("meta[name=printctl-stop-port]")?.content;
  const door = port ? `${location.protocol}//${location.hostname}:${port}` : null;
  const CUT = "If anything moves, cut the printer's power.";

  let lastEscape = -Infinity;
  let pressed = -Infinity;

  function escape() {
    const now = performance.now();
    if (now - lastEscape < TWICE_MS) {
      lastEscape = -Infinity;
      stop("Esc twice");
    } else {
      lastEscape = now;
    }
  }

  // In the capture phase of the window: whatever has the focus, and before any dialog's own keys.
  window.addEventListener(
    "keydown",
    (event) => {
      if (event.key === "Escape" && !event.repeat) escape();
    },
    true,
  );

  // A frame with one of our own pages in it hands on its keys (viewer/page.js).
  window.addEventListener("message", (event) => {
    if (event.data?.printctl !== "escape") return;
    const frames = [...document.querySelectorAll("iframe")];
    if (frames.some((frame) => frame.contentWindow === event.source)) escape();
  });

  // At the touch, not at its end: a glove slides, and then there is no click.
  const onButton = (event) => event.target instanceof Element && event.target.closest("#pc-stop");
  window.addEventListener(
    "pointerdown",
    (event) => {
      if (!onButton(event) || event.button !== 0) return;
      pressed = performance.now();
      stop("button");
    },
    true,
  );
  window.addEventListener(
    "click",
    (event) => {
      if (!onButton(event)) return;
      event.stopPropagation();
      if (performance.now() - pressed > 1500) stop("button"); // by Enter, Space, or a screen reader
    },
    true,
  );

  function show(lines) {
    const banner = document.getElementById("pc-stopped");
    if (!banner) return;
    banner.querySelector("p").textContent = lines.filter(Boolean).join(" ");
    banner.hidden = false;
  }

  async function ask(url, options, onLine) {
    const response = await fetch(url, {
      method: "POST",
      keepalive: true,
      cache: "no-store",
      signal: AbortSignal.timeout(PATIENCE_MS),
      ...options,
    });
    if (!response.ok) throw new Error(`answered ${response.status}`);
    const reader = response.body.getReader();
    const decoder = new TextDecoder();
    let text = "";
    for (;;) {
      const { done, value } = await reader.read();
      text += decoder.decode(value, { stream: !done });
      const lines = text.split("\n");
      text = done ? "" : lines.pop();
      lines.filter((line) => line.trim()).forEach((line) => onLine(JSON.parse(line)));
      if (done) return;
    }
  }

  // Whether they have halted; what it means for a print is on the Job page.
  function outcome(all) {
    if (all.some((one) => /cut its power/i.test(one.message))) {
      return "The printer hasn't confirmed that it halted: CUT ITS POWER.";
    }
    const ended = all.filter((one) => !["killed", "halted"].includes(one.state));
    if (ended.length) return ended.map((one) => `The print is over: ${one.message}.`).join(" ");
    return "The printer has halted: check where the needle is.";
  }

  async function stop(by) {
    const began = performance.now();
    const said = { head: `EMERGENCY STOP (${by}) …`, sent: "", outcome: "", rehearsal: "", trouble: "" };
    const tell = () => show([said.head, said.sent, said.outcome, said.rehearsal, said.trouble]);
    const since = () => `${Math.round(performance.now() - began)} ms`;
    let answers = 0;
    let most = 0;
    tell();
    const heard = (message) => {
      if (message.sent) {
        answers += 1;
        const machines = new Set(message.sent.map((one) => one.process || one.folder)).size;
        if (machines > most) {
          most = machines;
          said.sent = `Sent to ${most} printer${most > 1 ? "s" : ""} after ${since()}.`;
        } else if (!most) {
          said.sent = `No printer is connected here: nothing to halt. ${CUT}`;
        }
      }
      if (message.rehearsals_ended) said.rehearsal = "Running rehearsals were ended, too.";
      if (message.outcome?.length) said.outcome = outcome(message.outcome);
      said.head = `EMERGENCY STOP (${by}).`;
      tell();
    };
    const ways = [ask("/api/v1/stop", { credentials: "same-origin" }, heard)];
    if (door) ways.unshift(ask(`${door}/stop`, { mode: "cors", credentials: "include" }, heard));
    const results = await Promise.allSettled(ways);
    if (!answers) {
      said.head = "EMERGENCY STOP: NO ANSWER.";
      said.trouble = "Neither the stop process nor the server answers. CUT THE PRINTER'S POWER.";
    } else if (results.some((one) => one.status === "rejected")) {
      said.trouble = "One of the two connections of the emergency stop didn't answer.";
    }
    tell();
  }

  // Keeps the connection to the door open, and tells when it isn't there before it is needed.
  let doorLives = true;
  async function lookAtDoor() {
    try {
      const answer = await fetch(`${door}/alive`, {
        mode: "cors",
        credentials: "include",
        cache: "no-store",
        signal: AbortSignal.timeout(PATIENCE_MS),
      });
      await answer.text();
      doorLives = answer.ok;
    } catch {
      doorLives = false;
    }
    document.documentElement.toggleAttribute("data-no-stop-door", !doorLives);
  }
  if (door) {
    lookAtDoor();
    setInterval(lookAtDoor, ALIVE_MS);
  }

  document.addEventListener("DOMContentLoaded", () => {
    document.querySelector("#pc-stopped button")?.addEventListener("click", () => {
      document.getElementById("pc-stopped").hidden = true;
    });
  });
})();
