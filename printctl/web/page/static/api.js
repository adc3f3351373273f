// The page's only way to the server: REST below /api/v1, and its stream of news.
const ROOT = "/api/v1";

// What the server refused, or why it couldn't be reached (status 0); `message` is for people.
class Problem extends Error {
  constructor(status, message) {
    super(message);
    this.status = status;
  }
}

const UNREACHED = "The server can't be reached. A print goes on by itself; try again in a moment.";

export const get = (path) => send("GET", path);

// Send `body` (an object as JSON, a FormData as it is); give the answer's value, null for none.
export async function send(method, path, body) {
  const form = body instanceof FormData;
  const options = { method, credentials: "same-origin" };
  if (body !== undefined) {
    options.body = form ? body : JSON.stringify(body);
    if (!form) options.headers = { "Content-Type": "application/json" };
  }
  const answer = await fetch(url(path), options).catch(() => null);
  if (answer === null) throw new Problem(0, UNREACHED);
  if (answer.status === 401) location.reload(); // logged out: the server shows its log-in page
  const json = (answer.headers.get("content-type") ?? "").includes("json");
  const value = json ? await answer.json().catch(() => null) : await answer.text();
  if (answer.ok) return json ? value : value || null;
  throw new Problem(answer.status, value?.message ?? `${method} ${path}: ${answer.status}`);
}

// A path of the API as an address; other paths stay as they are.
export const url = (path) => (path.startsWith("/api/") || path.startsWith("/live/") ? path : ROOT + path);

// A part of a path, as it must be written.
export const part = (name) => encodeURIComponent(name).replaceAll("%7E", "~");

// Send a file; `onShare` is told how much of it has gone, 0 to 1.
export function upload(path, file, onShare = () => {}, field = "file", more = {}) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    const form = new FormData();
    form.append(field, file);
    Object.entries(more).forEach(([name, value]) => form.append(name, value));
    request.open("POST", url(path));
    request.responseType = "json";
    request.upload.addEventListener("progress", (event) => onShare(event.loaded / (event.total || 1)));
    request.addEventListener("error", () => reject(new Problem(0, UNREACHED)));
    request.addEventListener("load", () => {
      const value = request.response;
      if (request.status < 300) resolve(value);
      else reject(new Problem(request.status, value?.message ?? `refused (${request.status})`));
    });
    request.send(form);
  });
}

// --- news ------------------------------------------------------------------------------------

// The last message of each event (printer, print, controls, ...; "alive" comes every 3 s), and who
// wants to know. "lost" is told with { lost: true } when the server has said nothing for a while.
const latest = new Map();
const listeners = new Set();
const SILENT_MS = 8000;
const AGAIN_MS = 1500;
let heard = performance.now();

export const last = (event) => latest.get(event) ?? null;

// Call `tell(message)` for each message from now on; returns how to end it.
export function listen(tell) {
  listeners.add(tell);
  return () => listeners.delete(tell);
}

function spread(message) {
  latest.set(message.event, message);
  listeners.forEach((tell) => tell(message));
}

function lost(now) {
  if ((last("lost")?.lost ?? false) !== now) spread({ event: "lost", lost: now });
}

function connect() {
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss:" : "ws:"}//${location.host}${ROOT}/events`);
  socket.addEventListener("message", (event) => {
    heard = performance.now();
    lost(false);
    spread(JSON.parse(event.data));
  });
  socket.addEventListener("close", () => {
    lost(true);
    setTimeout(again, AGAIN_MS);
  });
}

async function again() {
  // Logged out, or the session has ended: the server says so, and the log-in page helps.
  const answer = await fetch(url("/controls"), { signal: AbortSignal.timeout(5000) }).catch(() => null);
  if (answer?.status === 401) location.reload();
  else connect();
}

export function beginNews() {
  connect();
  setInterval(() => lost(performance.now() - heard > SILENT_MS), 1000);
  setInterval(() => fetch(url("/controls")).catch(() => null), 600_000); // renews the session
}
