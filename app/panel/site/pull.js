// Pulling a link of the simulated arm with the mouse or a finger, while it is guided by hand. Frames go out for as
// long as the button is held; the simulation ends a pull by itself when they stop.
import { reasonOf } from "./reasons.js";
import { word } from "./words.js";

const EVERY_MS = 50;
const element = (id) => document.getElementById(id);

export class Pull {
  // now: {view, freedrive}; the view may be missing.
  constructor(stream, now) {
    this.stream = stream;
    this.now = now;
    this.held = null; // {link, body, point, pointer, target}
    this.timer = 0;
    const place = element("view");
    const listen = (type, hear) => place.addEventListener(type, hear, { capture: true });
    listen("pointerdown", (event) => this.press(event));
    listen("pointermove", (event) => this.move(event));
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
      listen(end, (event) => event.pointerId === this.held?.pointer && this.release());
    }
    document.addEventListener("cobot-stop", () => this.release());
    window.addEventListener("blur", () => this.release());
    window.addEventListener("pagehide", () => this.release());
    document.addEventListener("visibilitychange", () => this.release());
  }

  get possible() {
    return this.now().freedrive.on && !element("simulation").hidden;
  }

  press(event) {
    if (event.button !== 0 || !event.isPrimary || this.held || !this.possible) return;
    const found = this.now().view?.pointing.pickLink(event);
    if (!found) return;
    event.stopPropagation(); // the camera stays
    this.held = { ...found, pointer: event.pointerId };
    event.target.setPointerCapture(event.pointerId);
    this.timer = setInterval(() => this.send(), EVERY_MS);
    this.send();
  }

  move(event) {
    if (event.pointerId !== this.held?.pointer) return;
    event.stopPropagation();
    this.held.target = this.now().view.pointing.besideLink(event, this.held);
  }

  send() {
    const { link, point, target } = this.held;
    if (!this.possible || !this.stream.send({ type: "pull", link, point, target })) return void this.release();
    this.now().view.pointing.showPull(this.held);
  }

  release() {
    if (!this.held) return;
    clearInterval(this.timer);
    this.held = null;
    this.stream.send({ type: "pull" });
    this.now().view?.pointing.showPull(null);
  }

  hear(frame) {
    if (frame.type !== "error" || frame.about !== "pull") return;
    this.release();
    this.now().freedrive.say(() => word("pull_refused", { why: reasonOf(frame) }));
  }
}
