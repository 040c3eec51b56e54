// The device's own inputs and outputs, by name: shown while the card is open; a press switches one that is
// boolean, a new number sets another one.
import { oneAtATime } from "./once.js";
import { inEachLanguage, word } from "./words.js";

const EVERY_MS = 1000;
const element = (id) => document.getElementById(id);

export class DeviceIo {
  constructor(api) {
    this.api = api;
    this.points = [];
    this.lost = false; // what is shown is as old as the last answer
    this.look = oneAtATime(() => this.ask());
    element("io").addEventListener("toggle", () => this.look());
    setInterval(() => this.look(), EVERY_MS);
    inEachLanguage(() => this.write());
  }

  async ask() {
    if (!element("io").open || document.hidden || !this.api.robot) return;
    const { robot } = this.api;
    try {
      const { points } = await this.api.get("/io");
      if (robot !== this.api.robot) return;
      this.points = points;
      this.write();
      if (this.lost) element("device-io-why").textContent = "";
      this.lost = false;
    } catch (error) {
      this.lost = true;
      element("device-io-why").textContent = error.message;
    }
  }

  async set({ name }, value) {
    element("device-io-why").textContent = "";
    try {
      await this.api.ask("PUT", this.api.address(`/io/${encodeURIComponent(name)}`), { value });
    } catch (error) {
      element("device-io-why").textContent = error.message;
    }
    this.look();
  }

  write() {
    element("device-io-part").hidden = !this.points.length;
    const place = element("device-io");
    const shape = JSON.stringify(this.points.map(({ name, kind, direction }) => [name, kind, direction]));
    if (place.dataset.shape !== shape) {
      place.dataset.shape = shape;
      place.replaceChildren(...this.points.map((point) => this.row(point)));
    }
    for (const [index, { kind, value }] of this.points.entries()) {
      const shown = place.children[index].lastElementChild;
      const known = kind === "boolean" ? word(value ? "io_on" : "io_off") : String(value);
      const said = value === null ? "?" : known; // the device reports what is no number
      if (shown.tagName === "INPUT") {
        if (document.activeElement !== shown) shown.value = value ?? "";
      } else {
        shown.textContent = said;
      }
      if (shown.tagName === "BUTTON") shown.setAttribute("aria-pressed", String(value));
    }
  }

  // A name and what it has: of an input a text, of an output what sets it.
  row(point) {
    const [row, name] = ["label", "span"].map((tag) => document.createElement(tag));
    name.textContent = point.name;
    const shown = document.createElement(point.direction === "input" ? "b" : point.kind === "boolean" ? "button" : "input");
    if (shown.tagName === "BUTTON") {
      shown.type = "button";
      shown.setAttribute("aria-label", point.name);
      shown.addEventListener("click", () => this.set(point, shown.getAttribute("aria-pressed") !== "true"));
    } else if (shown.tagName === "INPUT") {
      shown.type = "number";
      shown.step = point.kind === "digital" ? "1" : "any";
      shown.addEventListener("change", () => this.set(point, shown.valueAsNumber));
    }
    row.append(name, shown);
    return row;
  }
}
