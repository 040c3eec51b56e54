// TCP teach-in: the tip of the tool touches a fixed point in four or more poses, and the service computes the TCP.
import { allow } from "./able.js";
import { reasonOf } from "./reasons.js";
import { inEachLanguage, speak, word } from "./words.js";

const [NEEDED, MAX] = [4, 20];
const STILL_RAD_S = 0.02; // in a hand, an arm is never quite still
const GOOD_M = 0.001;
const element = (id) => document.getElementById(id);
const mm = (metres, digits = 1) => (1000 * metres).toFixed(digits);

export class Tip {
  // state: returns the newest state. set: sets the TCP of the tool, or throws.
  constructor(api, state, set) {
    this.api = api;
    this.state = state;
    this.set = set;
    element("tip-take").addEventListener("click", () => this.take());
    element("tip-clear").addEventListener("click", () => this.clear());
    element("tip-set").addEventListener("click", () => this.use());
    this.clear();
    inEachLanguage(() => this.write());
  }

  // Also after another robot was chosen.
  clear() {
    this.points = [];
    this.found = null;
    this.asked = Symbol();
    this.say(() => "");
  }

  take() {
    const state = this.state();
    if (!state) return void this.say(() => word("silence"));
    if (Math.max(...state.velocity.map(Math.abs)) > STILL_RAD_S) return void this.say(() => word("tip_moves"));
    this.points.push(state.position);
    return this.compute();
  }

  remove(index) {
    this.points.splice(index, 1);
    return this.compute();
  }

  async compute() {
    const asked = (this.asked = Symbol());
    this.found = null;
    const missing = NEEDED - this.points.length;
    if (missing > 0) return void this.say(() => word("tip_missing", { missing }));
    this.say(() => "…");
    try {
      const found = await this.api.post("/tool/calibrate", { points: this.points });
      if (asked !== this.asked) return;
      this.found = found;
      this.say(() => this.result(), found.error_m > GOOD_M ? "warn" : "good");
    } catch (error) {
      if (asked === this.asked) this.say(() => reasonOf(error), "warn");
    }
  }

  result() {
    const { position, error_m: error, errors_m: errors } = this.found;
    const worst = errors.indexOf(Math.max(...errors)) + 1;
    const found = word("tip_found", { place: position.map((value) => mm(value)).join(", "), error: mm(error, 2) });
    return error > GOOD_M ? `${found} ${word("tip_poor", { worst })}` : found;
  }

  async use() {
    const { position } = this.found;
    try {
      await this.set(position);
      this.clear();
      this.say(() => word("tip_is_set"), "good");
    } catch (error) {
      this.say(() => reasonOf(error), "warn");
    }
  }

  say(words, level = "") {
    speak("tip-why", words);
    element("tip-why").dataset.level = level;
    this.write();
  }

  write() {
    element("tip-points").replaceChildren(...this.points.map((_, index) => this.row(index)));
    allow(element("tip-take"), this.points.length < MAX ? "" : "why_enough_points");
    allow(element("tip-clear"), this.points.length ? "" : "why_no_points");
    allow(element("tip-set"), this.found ? "" : "why_no_tip");
  }

  row(index) {
    const [row, text, remove] = ["li", "span", "button"].map((tag) => document.createElement(tag));
    const error = this.found?.errors_m[index];
    text.textContent = `${word("tip_point", { number: index + 1 })} ${error === undefined ? "" : `${mm(error, 2)} mm`}`;
    remove.type = "button";
    remove.textContent = "✕";
    remove.setAttribute("aria-label", word("tip_remove", { number: index + 1 }));
    remove.addEventListener("click", () => this.remove(index));
    row.append(text, remove);
    return row;
  }
}
