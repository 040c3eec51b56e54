// The log, the newest event first: for people one line per job and what they have to know; or all events.
import { causeOf, reasonOf, whyOf, whyOfEnd } from "./reasons.js";
import { isSamePress } from "./stop.js";
import { inEachLanguage, timeOfDay, word } from "./words.js";

const MAX_ENTRIES = 100;
const LEVELS = { fault: "bad", estop: "bad", lost: "bad", log: "warn", intervention: "warn", refused: "warn", rtloop: "warn", stop: "warn", planning: "warn" };
const FAILURES = ["failed", "interrupted"];
const LATCHED = ["ESTOP", "FAULT"];
const TERMINATED = [143, -15]; // return codes of a program that a stop or a cancel has ended
const LOST_CONTROL = ["taken over", "disconnected", "revoked"];
const QUIET = ["alive", "hello", "state"];
const IN_WORDS = { mode: { mode: "mode", before: "mode" }, job: { state: "job", kind: "kind" } };
// Steps on the way to something that has a line of its own.
const DETAILS = ["mode", "motion", "session", "plan", "action", "planning"];
const OVER = ["finished", "failed", "cancelled", "interrupted"];
const element = (id) => document.getElementById(id);

// An event in a sentence; of one that has none its fields, by their names in docs/events.md.
// labelOf: gives the name of a program from that of its file.
function said(type, data, labelOf) {
  const values = Object.fromEntries(Object.entries(data).map(([field, value]) => [field, value ?? ""]));
  if (type === "sequence" && data.name) values.name = labelOf(data.name);
  for (const [field, of] of Object.entries(IN_WORDS[type] ?? {})) {
    if (values[field]) values[field] = word(`${of}_${values[field]}`);
  }
  if (type === "stop") values.reason = causeOf(data);
  else if (type === "refused") values.reason = reasonOf({ ...data, detail: data.reason });
  else if (data.reason_code) values.reason = whyOf(data);
  if (type === "job" && data.error) values.error = whyOfEnd(data.state, { ...data, detail: data.error });
  if (type === "speed") values.percent = Math.round(100 * values.fraction);
  if (Array.isArray(values.objects)) values.objects = values.objects.join(", ") || word("object_none");
  if (Array.isArray(values.robots)) values.robots = values.robots.join(", ");
  if (Array.isArray(values.planners)) values.planners = values.planners.join(", ");
  if (values.duration_s) values.duration_s = values.duration_s.toFixed(1);
  const name = [endOf(type, data), `said_${type}_${data.what ?? data.state}`, `said_${type}`].filter(Boolean).find((each) => word(each) !== each);
  if (name) return word(name, values).trim() + (data.held_back ? ` ${word("said_held_back", data)}` : "");
  const shown = Object.entries(data).filter(([, value]) => value !== null && value !== "");
  return shown.map(([name, value]) => `${name} ${typeof value === "object" ? JSON.stringify(value) : value}`).join(", ");
}

// The word for the end of a program that was stopped or has failed.
function endOf(type, { returncode }) {
  if (type !== "sequence" || !returncode) return "";
  return TERMINATED.includes(returncode) ? "said_sequence_terminated" : "said_sequence_failed";
}

// "bad", "warn", or "" for what is no problem.
export function levelOf({ type, data }) {
  if (type === "log" && data.level !== "warning") return "bad";
  if (type === "job") return FAILURES.includes(data.state) ? "bad" : "";
  if (type === "motion") return data.what === "failed" ? "bad" : "";
  if (type === "mode") return LATCHED.includes(data.mode) ? "bad" : "";
  if (type === "sequence") return data.what === "ended" && data.returncode && !TERMINATED.includes(data.returncode) ? "bad" : "";
  if (type === "lease") return LOST_CONTROL.includes(data.what) ? "warn" : "";
  return LEVELS[type] ?? "";
}

// Whether a line is left out for people: a step, a part of another job, or a job that goes on.
function isDetail(event) {
  const { type, data } = event;
  if (levelOf(event)) return false;
  if (type === "job") return Boolean(data.parent) || !OVER.includes(data.state);
  if (type === "sequence") return data.what === "waypoint";
  return DETAILS.includes(type);
}

// All fields of an event, by their names in docs/events.md.
function fieldsOf(data) {
  const made = document.createElement("pre");
  const known = Object.entries(data).filter(([, value]) => value !== null && value !== "");
  made.textContent = known.map(([name, value]) => `${name}: ${typeof value === "object" ? JSON.stringify(value) : value}`).join("\n");
  return made;
}

export class Log {
  // labelOf: gives the name of a program from that of its file.
  constructor(labelOf) {
    this.labelOf = labelOf;
    this.waiting = [];
    this.asked = false;
    element("log-filter").addEventListener("change", ({ target }) => (element("log").dataset.shown = target.value));
    inEachLanguage(() => this.translate());
  }

  clear() {
    this.waiting = [];
    this.stop = null; // the last one
    element("log").replaceChildren();
  }

  hear(event) {
    if (QUIET.includes(event.type)) return;
    if (event.type === "stop") event.repeats = this.repeats(event);
    this.waiting.push(event);
    if (this.waiting.length > MAX_ENTRIES) this.waiting.shift();
    if (this.asked) return;
    this.asked = true;
    setTimeout(() => this.write(), 100); // many may come at once
  }

  // Whether a stop is the same press as the one before.
  repeats(event) {
    if (isSamePress(this.stop, event)) return true;
    this.stop = event;
    return false;
  }

  write() {
    this.asked = false;
    element("log").prepend(...this.waiting.reverse().map((event) => this.row(event)));
    this.waiting = [];
    while (element("log").children.length > MAX_ENTRIES) element("log").lastElementChild.remove();
  }

  translate() {
    for (const row of element("log").children) {
      const made = this.row(row.told);
      made.firstChild.open = row.firstChild.open;
      row.replaceWith(made);
    }
  }

  row(event) {
    const { time, type, data } = event;
    const level = event.repeats ? "" : levelOf(event);
    const made = document.createElement("li");
    const [whole, line, moment, kind, text] = ["details", "summary", "time", "b", "span"].map((tag) => document.createElement(tag));
    moment.dateTime = time;
    moment.textContent = timeOfDay(time);
    kind.textContent = word(`event_${type}`);
    kind.dataset.level = level;
    text.textContent = said(type, data, this.labelOf);
    text.title = [data.what, data.error ?? data.reason].filter(Boolean).join(": ");
    made.told = event;
    made.dataset.type = type;
    made.toggleAttribute("data-problem", Boolean(level));
    made.toggleAttribute("data-detail", Boolean(event.repeats) || isDetail(event));
    line.append(moment, kind, text);
    whole.append(line);
    whole.addEventListener("toggle", () => whole.append(fieldsOf(data)), { once: true });
    made.append(whole);
    return made;
  }
}
