// What has happened, the newest first.
import { inEachLanguage, word } from "./words.js";

const MOST = 100;
const LEVELS = { fault: "bad", estop: "bad", lost: "bad", log: "warn", intervention: "warn", rtloop: "warn", stop: "warn" };
const QUIET = ["alive", "hello", "state"];
const element = (id) => document.getElementById(id);

// The fields of an event as words: they have names of their own, see docs/events.md.
function said(data) {
  const shown = Object.entries(data).filter(([, value]) => value !== null && value !== "");
  return shown.map(([name, value]) => `${name} ${typeof value === "object" ? JSON.stringify(value) : value}`).join(", ");
}

export class Log {
  constructor() {
    this.waiting = [];
    this.asked = false;
    element("log-problems").addEventListener("click", () => this.filter());
    inEachLanguage(() => this.mark());
  }

  clear() {
    this.waiting = [];
    element("log").replaceChildren();
  }

  hear(event) {
    if (QUIET.includes(event.type)) return;
    this.waiting.push(event);
    if (this.waiting.length > MOST) this.waiting.shift();
    if (this.asked) return;
    this.asked = true;
    setTimeout(() => this.write(), 100); // many may come at once
  }

  write() {
    this.asked = false;
    element("log").prepend(...this.waiting.reverse().map((event) => this.row(event)));
    this.waiting = [];
    while (element("log").children.length > MOST) element("log").lastElementChild.remove();
  }

  row({ time, type, data }) {
    const made = document.createElement("li");
    const [moment, kind, text] = ["time", "b", "span"].map((tag) => document.createElement(tag));
    moment.dateTime = time;
    moment.textContent = new Date(time).toLocaleTimeString();
    kind.textContent = type;
    kind.dataset.level = LEVELS[type] ?? "";
    text.textContent = said(data);
    made.dataset.type = type;
    made.toggleAttribute("data-problem", type in LEVELS);
    made.append(moment, kind, text);
    return made;
  }

  filter() {
    element("log").toggleAttribute("data-problems");
    this.mark();
  }

  mark() {
    const only = element("log").hasAttribute("data-problems");
    element("log-problems").setAttribute("aria-pressed", String(only));
    element("log-problems").textContent = word("log_problems");
  }
}
