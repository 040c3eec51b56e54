// What a stop has left: who stopped the arm and when, what has ended, and what to press next. It stays next to the
// arm until a motion begins or it is closed. An e-stop and a fault have a message of their own, in banner.js.
import { WITH_STEPS } from "./job.js";
import { causeOf } from "./reasons.js";
import { isSamePress, requests } from "./stop.js";
import { inEachLanguage, named, word } from "./words.js";

const STREAM = "stream";
const LATCHED = ["ESTOP", "FAULT"];
const element = (id) => document.getElementById(id);

export class Halt {
  constructor() {
    element("halt-close").addEventListener("click", () => this.clear());
    inEachLanguage(() => this.write());
    this.clear();
  }

  // Also for another robot.
  clear() {
    this.stop = null; // the event
    this.ended = this.running = ""; // the kind of the job that the stop has ended, and of the one that runs
    this.write();
  }

  hear({ type, time, data }) {
    if (type === "stop") this.stopped({ time, data });
    else if (type === "job" && !data.parent) this.follow(data);
    else if (type === "motion" && data.what === "begun") this.clearStop();
    else if (type === "session") this.stream(data.what);
    else if (type === "mode" && LATCHED.includes(data.mode)) this.clearStop();
  }

  stopped(event) {
    if (isSamePress(this.stop, event)) return;
    this.stop = event;
    this.ended = this.running;
    this.write();
  }

  follow({ state, kind }) {
    if (state === "running") {
      this.running = kind;
      this.clearStop();
    } else if (state !== "paused") {
      if (state === "cancelled" && this.stop && !this.ended) this.ended = kind;
      this.running = "";
      this.write();
    }
  }

  // Jogging, hand guiding and streams of other clients.
  stream(what) {
    this.running = what === "begun" ? STREAM : "";
    if (this.running) this.clearStop();
  }

  clearStop() {
    this.stop = null;
    this.ended = "";
    this.write();
  }

  write() {
    element("halt").hidden = !this.stop;
    if (!this.stop) return;
    const { data } = this.stop;
    const time = new Date(this.stop.time).toLocaleTimeString(document.documentElement.lang, { hourCycle: "h23" });
    const who = requests.has(data.request) ? word("halt_you", { time }) : word("halt_by", { time, by: named(data.by) });
    const why = data.cause === "cancelled" ? "" : causeOf(data); // that cause is only the client once more
    element("halt-who").textContent = [who, why].filter(Boolean).join(" ");
    const isProgram = WITH_STEPS.includes(this.ended);
    const what = isProgram ? "halt_program" : this.ended ? "halt_motion" : "halt_nothing";
    element("halt-what").textContent = `${word(what)} ${word("halt_ready")}`;
    const isMotion = this.ended && this.ended !== STREAM;
    element("halt-next").textContent = isMotion ? word(isProgram ? "halt_next_program" : "halt_next_motion") : "";
  }
}
