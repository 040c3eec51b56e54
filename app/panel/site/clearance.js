// The clearance to the surroundings: its figure, and the line between the nearest points. It is asked for only
// after the arm or its surroundings have changed.
import { inEachLanguage, word } from "./words.js";

const MIN_PERIOD_MS = 250;
const CHANGED_RAD = 1e-3; // rad or m
const [RED_M, GREEN_M] = [0.02, 0.15]; // between them the colour goes over
const element = (id) => document.getElementById(id);

// The colour at this distance, as a hue: 0 is red, 130 is green.
export function hueAt(distance) {
  return 130 * Math.max(0, Math.min(1, (distance - RED_M) / (GREEN_M - RED_M)));
}

export class Clearance {
  // view: returns the picture, null before there is one.
  constructor(api, view) {
    this.api = api;
    this.view = view;
    this.clear();
    inEachLanguage(() => this.write());
  }

  // Also for another robot, and while no state arrives.
  clear() {
    this.joints = this.tag = this.nearest = null;
    this.asked = Symbol();
    this.next = 0;
    this.draw();
  }

  // tag: changes with scene and tool.
  show({ position }, tag) {
    const changed = tag !== this.tag || !this.joints || position.some((value, index) => Math.abs(value - this.joints[index]) > CHANGED_RAD);
    if (!changed || performance.now() < this.next || document.hidden) return;
    [this.joints, this.tag, this.next] = [position, tag, Infinity];
    this.ask();
  }

  async ask() {
    const asked = (this.asked = Symbol());
    const found = await this.api.get("/clearance").catch(() => null);
    if (asked !== this.asked) return;
    this.next = performance.now() + MIN_PERIOD_MS;
    if (!found) this.joints = null; // asked for again
    this.nearest = found?.closest_environment ?? null;
    this.draw();
  }

  draw() {
    this.view()?.showClearance("arm", this.nearest);
    this.write();
  }

  write() {
    const place = element("clearance");
    place.hidden = !this.nearest;
    if (!this.nearest) return;
    const { distance_m: distance, between } = this.nearest;
    const said = word("clearance", { mm: Math.round(1000 * distance), between: between.join(" – ") });
    const parts = this.view()?.parts.size;
    const text = parts ? `${said} · ${word("clearance_without")}` : said;
    if (place.textContent !== text) place.textContent = text;
    place.title = [text, word("clearance_about"), parts && word("clearance_parts")].filter(Boolean).join("\n");
    place.style.setProperty("--hue", hueAt(distance).toFixed(0));
  }
}
