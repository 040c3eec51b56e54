// The WebSocket: states in, jog frames out. It connects again when it is lost.
const STATES_HZ = 25;
const AGAIN_MS = 1000;

export class Stream {
  constructor(api, { state, answer, connected }) {
    this.api = api;
    this.tell = { state, answer, connected };
    this.socket = null;
    this.again = 0;
  }

  get ready() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  // To the robot that is shown now; what there was is closed.
  open() {
    clearTimeout(this.again);
    const before = this.socket;
    this.socket = null;
    before?.close();
    const address = new URL(this.api.address("/stream"), location.href);
    address.protocol = address.protocol.replace("http", "ws");
    const socket = new WebSocket(address, this.api.protocols);
    this.socket = socket;
    socket.addEventListener("open", () => {
      socket.send(JSON.stringify({ type: "subscribe", rate_hz: STATES_HZ }));
      this.tell.connected(true);
    });
    socket.addEventListener("message", (event) => {
      if (socket !== this.socket) return;
      const frame = JSON.parse(event.data);
      if (frame.type === "state") this.tell.state(frame);
      else this.tell.answer(frame);
    });
    socket.addEventListener("close", () => {
      if (socket !== this.socket) return;
      this.tell.connected(false);
      this.again = setTimeout(() => this.open(), AGAIN_MS);
    });
  }

  // false if nobody has heard it.
  send(frame) {
    if (!this.ready) return false;
    this.socket.send(JSON.stringify(frame));
    return true;
  }
}
