// Digital inputs and outputs, and registers: read while the card is open, written by who may.
import { oneAtATime } from "./once.js";
import { reasonOf } from "./reasons.js";
import { inEachLanguage, speak, word } from "./words.js";

const EVERY_MS = 1000; // a change of them is no event
const WAYS = ["Input", "Output"];
const element = (id) => document.getElementById(id);

export class Io {
  constructor(api) {
    this.api = api;
    this.masks = { Input: 0, Output: 0 };
    this.counts = null; // of `robot`
    this.robot = null;
    this.look = oneAtATime(() => this.ask());
    element("io").addEventListener("toggle", () => this.look());
    setInterval(() => this.look(), EVERY_MS);
    for (const id of ["register-bank", "register-kind", "register-index"]) {
      element(id).addEventListener("change", () => this.look());
    }
    element("register-write").addEventListener("click", () => this.set());
    inEachLanguage(() => this.write());
  }

  // What a vendor's method gives.
  async call(method, fields = {}) {
    const answer = await this.api.ask("POST", `/${encodeURIComponent(this.api.robot.name)}/${method}`, fields);
    const { code, message, result } = await answer.json();
    if (code) throw new Error(message || `code ${code}`);
    return result;
  }

  get register() {
    const name = element("register-kind").value + element("register-bank").value;
    return { name, index: Number(element("register-index").value) };
  }

  async ask() {
    if (!element("io").open || document.hidden || !this.api.robot) return;
    const { name, index } = this.register;
    const { robot } = this.api;
    try {
      const [inputs, outputs, value] = await Promise.all([
        ...WAYS.map((way) => this.call(`IoControl/getStandardDigital${way}s`)),
        this.call(`RegisterControl/get${name}`, { index }),
      ]);
      const counts = robot === this.robot ? this.counts : await this.count();
      if (robot !== this.api.robot) return;
      [this.robot, this.counts, this.masks] = [robot, counts, { Input: inputs, Output: outputs }];
      element("register-shown").textContent = String(value);
      speak("io-why", () => "");
      this.write();
    } catch (error) {
      speak("io-why", () => reasonOf(error));
    }
  }

  async count() {
    const numbers = await Promise.all(WAYS.map((way) => this.call(`IoControl/getStandardDigital${way}Num`)));
    return Object.fromEntries(WAYS.map((way, index) => [way, numbers[index]]));
  }

  async toggle(way, index) {
    const value = !((this.masks[way] >> index) & 1);
    await this.done(this.call(`IoControl/setStandardDigital${way}`, { index, value }));
  }

  async set() {
    const { name, index } = this.register;
    const given = element("register-value").value.trim();
    const value = name.startsWith("Bool") ? ["true", "1"].includes(given) : Number(given || NaN);
    await this.done(this.call(`RegisterControl/set${name}`, { index, value }));
  }

  async done(call) {
    try {
      await call;
      this.look();
    } catch (error) {
      speak("io-why", () => reasonOf(error));
    }
  }

  write() {
    if (!this.counts) return;
    for (const way of WAYS) {
      const place = element(`io-${way}`);
      while (place.children.length > this.counts[way]) place.lastElementChild.remove();
      while (place.children.length < this.counts[way]) place.append(this.button(way, place.children.length));
      for (const [index, button] of [...place.children].entries()) {
        button.setAttribute("aria-pressed", String(Boolean((this.masks[way] >> index) & 1)));
        button.setAttribute("aria-label", word(way === "Input" ? "io_input" : "io_output", { number: index }));
      }
    }
  }

  button(way, index) {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = index;
    made.addEventListener("click", () => this.toggle(way, index));
    return made;
  }
}
