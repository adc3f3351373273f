// What the server tells of the print, over its WebSocket; comes back by itself when it was lost.
const FIRST_WAIT_MS = 500;
const LONGEST_WAIT_MS = 10000;

export class Feed {
  // onPrint gets each print event; onState gets true or false as the line stands.
  constructor(source, onPrint, onState) {
    const url = new URL(source, document.baseURI);
    url.protocol = url.protocol.replace(/^http/, "ws");
    Object.assign(this, { url, onPrint, onState, wait: FIRST_WAIT_MS });
    this.open();
  }

  open() {
    this.socket = new WebSocket(this.url);
    this.socket.addEventListener("open", () => {
      this.wait = FIRST_WAIT_MS;
      this.onState(true);
    });
    this.socket.addEventListener("message", ({ data }) => this.take(data));
    this.socket.addEventListener("close", () => this.again());
  }

  take(data) {
    let said;
    try {
      said = JSON.parse(data);
    } catch {
      return; // not for us
    }
    if (said && said.event === "print") this.onPrint(said);
  }

  again() {
    if (this.closed) return;
    this.onState(false);
    this.timer = setTimeout(() => this.open(), this.wait);
    this.wait = Math.min(2 * this.wait, LONGEST_WAIT_MS);
  }

  close() {
    this.closed = true;
    clearTimeout(this.timer);
    this.socket.close();
  }
}
