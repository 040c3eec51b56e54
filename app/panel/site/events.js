// What happens, as it happens. After a lost connection it goes on with what has happened meanwhile.
const AGAIN_MS = 1000;

export class Events {
  constructor(api, hear) {
    this.api = api;
    this.hear = hear;
    this.socket = null;
    this.last = "0";
    this.again = 0;
  }

  // Of the robot that is shown now, from the oldest that is kept.
  open() {
    this.last = "0";
    this.connect();
  }

  connect() {
    clearTimeout(this.again);
    const before = this.socket;
    this.socket = null;
    before?.close();
    const address = new URL(`.${this.api.address("/events")}`, location.href);
    address.protocol = address.protocol.replace("http", "ws");
    address.searchParams.set("after", this.last);
    const socket = new WebSocket(address, this.api.protocols);
    this.socket = socket;
    socket.addEventListener("message", (message) => {
      if (socket !== this.socket) return;
      const event = JSON.parse(message.data);
      if ("id" in event) this.last = `${event.epoch}-${event.id}`;
      this.hear(event);
    });
    socket.addEventListener("close", () => {
      if (socket === this.socket) this.again = setTimeout(() => this.connect(), AGAIN_MS);
    });
  }
}
