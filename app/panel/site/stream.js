// The WebSocket: states out, jog frames and stops in. It connects again when it is lost, and tells when no states
// come, whoever is silent: the real-time process, the service, or a cable that nobody has noticed to be cut.
const STATES_HZ = 25;
const AGAIN_MS = 1000;
const LOOK_MS = 250;
const SILENT_LOOKS = 4; // looks, not time: a page that was busy itself has looked once in between

export class Stream {
  constructor(api, { state, answer, connected, silent }) {
    this.api = api;
    this.tell = { state, answer, connected, silent };
    this.socket = null;
    this.again = 0;
    this.looks = 0; // since the newest state
    this.silent = false;
    setInterval(() => this.watch(), LOOK_MS);
  }

  get ready() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  watch() {
    this.looks += 1;
    if (this.looks < SILENT_LOOKS || this.silent || !this.socket) return;
    this.silent = true;
    this.tell.silent(true);
  }

  // To the robot that is shown now; what there was is closed.
  open() {
    this.looks = 0;
    this.connect();
  }

  connect() {
    clearTimeout(this.again);
    const before = this.socket;
    this.socket = null;
    before?.close();
    const address = new URL(`.${this.api.address("/stream")}`, location.href);
    address.protocol = address.protocol.replace("http", "ws");
    if (this.api.name) address.searchParams.set("client_name", this.api.name);
    const socket = new WebSocket(address, this.api.protocols);
    this.socket = socket;
    socket.addEventListener("open", () => {
      if (socket !== this.socket) return;
      socket.send(JSON.stringify({ type: "subscribe", rate_hz: STATES_HZ }));
      this.tell.connected(true);
    });
    socket.addEventListener("message", (event) => {
      if (socket !== this.socket) return;
      const frame = JSON.parse(event.data);
      if (frame.type === "state") this.hear(frame);
      else this.tell.answer(frame);
    });
    socket.addEventListener("close", () => {
      if (socket !== this.socket) return;
      this.tell.connected(false);
      this.again = setTimeout(() => this.connect(), AGAIN_MS);
    });
  }

  hear(frame) {
    this.looks = 0;
    if (this.silent) this.tell.silent(false);
    this.silent = false;
    this.tell.state(frame);
  }

  // false if nobody has heard it.
  send(frame) {
    if (!this.ready) return false;
    this.socket.send(JSON.stringify(frame));
    return true;
  }
}
