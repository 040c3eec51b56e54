// The control of the arm for this page alone. It is taken and released over the WebSocket, and ends with the
// connection. Requests that move the arm send its token.
import { reasonOf } from "./reasons.js";
import { inEachLanguage, speak, word } from "./words.js";

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
    else if (frame.type === "error" && frame.about === "control") speak("control-why", () => reasonOf(frame));
    else if (frame.type === "error" && frame.about === "release") this.set("");
  }

  // The connection is lost, or is a new one.
  lost() {
    this.set("");
  }

  set(token) {
    this.api.control = token;
    speak("control-why", () => "");
    this.write();
  }

  write() {
    element("take").textContent = word(this.held ? "give_back" : "take");
    element("take").setAttribute("aria-pressed", String(this.held));
    element("control").toggleAttribute("data-mine", this.held);
  }
}
