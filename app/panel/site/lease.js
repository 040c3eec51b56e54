// The control of the arm, for this page alone: taken and given back over the WebSocket, and gone with it. Its
// token goes with the requests that move the arm.
import { inEachLanguage, word } from "./words.js";

const TIMEOUT_S = 600; // after the last motion
const element = (id) => document.getElementById(id);

export class Lease {
  constructor(api, stream) {
    this.api = api;
    this.stream = stream;
    element("take").addEventListener("click", () => this.toggle());
    inEachLanguage(() => this.write());
  }

  get held() {
    return Boolean(this.api.control);
  }

  toggle() {
    this.stream.send(this.held ? { type: "release" } : { type: "control", timeout_s: TIMEOUT_S });
  }

  hear(frame) {
    if (frame.type === "control") this.set(frame.token);
    else if (frame.type === "control_released" || frame.type === "control_lost") this.set("");
    else if (frame.type === "error" && frame.about === "control") element("control").textContent = frame.detail;
    else if (frame.type === "error" && frame.about === "release") this.set("");
  }

  // The connection is another one, or none.
  lost() {
    this.set("");
  }

  set(token) {
    this.api.control = token;
    this.write();
  }

  write() {
    element("take").textContent = word(this.held ? "give_back" : "take");
    element("take").setAttribute("aria-pressed", String(this.held));
  }
}
