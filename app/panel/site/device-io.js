// The robot's own inputs and outputs, by name. The page Diagnose shows all of them while the card is open, and the page
// Move shows the outputs that the user has marked there. Each browser keeps the marks.
import { allow } from "./able.js";
import { oneAtATime } from "./once.js";
import { reasonOf } from "./reasons.js";
import { keep, keptList } from "./store.js";
import { inEachLanguage, speak, word } from "./words.js";

const EVERY_MS = 1000;
const MAX_MARKED = 4;
const element = (id) => document.getElementById(id);
const rounded = (value) => String(Number(value.toFixed(5)));
const markKey = (robot) => `cobot.outputs.${robot.name}`;

export class DeviceIo {
  constructor(api) {
    this.api = api;
    this.points = [];
    this.lost = false; // what is shown is as old as the last answer
    this.look = oneAtATime(() => this.ask());
    this.all = new Points("device-io", (point, value) => this.set(point, value), (name) => this.mark(name));
    this.marked = new Points("outputs", (point, value) => this.set(point, value));
    element("io").addEventListener("toggle", () => this.look());
    setInterval(() => this.look(), EVERY_MS);
    inEachLanguage(() => this.write());
  }

  // Names of the marked outputs. Those that the robot no longer has do not count.
  get names() {
    const names = this.api.robot ? keptList("localStorage", markKey(this.api.robot)) : [];
    return this.points.length ? names.filter((name) => this.points.some((point) => point.name === name)) : names;
  }

  // Whether a card is open that shows some of them.
  get shown() {
    return element("io").open || (this.names.length > 0 && document.body.dataset.page === "move");
  }

  async ask() {
    const { robot } = this.api;
    if (!robot || document.hidden) return;
    if (robot !== this.robot) this.points = [];
    this.robot = robot;
    if (!this.shown) return void this.write();
    try {
      const { points } = await this.api.get("/io");
      if (robot !== this.api.robot) return;
      this.points = points;
      if (this.lost) this.say(() => "");
      this.lost = false;
    } catch (error) {
      this.lost = true;
      this.say(() => reasonOf(error));
    }
    this.write();
  }

  async set({ name }, value) {
    this.say(() => "");
    try {
      await this.api.ask("PUT", this.api.address(`/io/${encodeURIComponent(name)}`), { value });
    } catch (error) {
      this.say(() => reasonOf(error));
    }
    this.look();
  }

  mark(name) {
    const names = this.names.includes(name) ? this.names.filter((each) => each !== name) : [...this.names, name];
    keep("localStorage", markKey(this.api.robot), JSON.stringify(names));
    this.write();
  }

  say(words) {
    for (const id of ["device-io-why", "outputs-why"]) speak(id, words);
  }

  write() {
    const { names } = this;
    const marked = this.points.filter(({ name, direction }) => direction === "output" && names.includes(name));
    element("device-io-part").hidden = !this.points.length;
    element("outputs-part").hidden = !marked.length;
    this.all.write(this.points, names);
    this.marked.write(marked, names);
  }
}

// A list of inputs and outputs.
class Points {
  // set: called with a point and its new value. mark: called with the name of an output that is marked or no longer; none
  // without marks.
  constructor(place, set, mark = null) {
    Object.assign(this, { place: element(place), set, mark, rows: [] });
  }

  write(points, names) {
    const shape = JSON.stringify(points.map(({ name, kind, direction }) => [name, kind, direction]));
    if (this.shape !== shape) {
      this.shape = shape;
      this.rows = points.map((point) => this.row(point));
      this.place.replaceChildren(...this.rows.map(({ row }) => row));
    }
    points.forEach((point, index) => this.show(point, this.rows[index], names));
  }

  show({ name, kind, value }, { shown, star }, names) {
    const said = value === null ? "?" : kind === "boolean" ? word(value ? "io_on" : "io_off") : rounded(value);
    if (shown.tagName === "INPUT") {
      if (document.activeElement !== shown) shown.value = value === null ? "" : rounded(value);
    } else {
      shown.textContent = said; // ? where the device reports what is no number
    }
    if (shown.tagName === "BUTTON") shown.setAttribute("aria-pressed", String(value));
    if (!star) return;
    const marked = names.includes(name);
    star.textContent = marked ? "★" : "☆";
    star.setAttribute("aria-pressed", String(marked));
    star.setAttribute("aria-label", word("io_mark", { name }));
    allow(star, marked || names.length < MAX_MARKED ? "" : "why_enough_outputs");
    if (!star.disabled) star.title = word("io_mark", { name });
  }

  // Its name and its value: of an input a text, of an output what sets it.
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
    const star = this.mark && point.direction === "output" ? document.createElement("button") : null;
    if (star) {
      star.type = "button";
      star.className = "star";
      star.addEventListener("click", () => this.mark(point.name));
      row.append(star);
    }
    return { row, shown, star };
  }
}
