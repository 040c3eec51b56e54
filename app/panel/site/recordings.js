// Recordings over their time: what a fault or an e-stop has left, and what somebody has asked for. One of them is
// shown as a ghost along its own time, with what happened.
import { LONG_MS } from "./api.js";
import { oneAtATime } from "./once.js";
import { reasonOf } from "./reasons.js";
import { inEachLanguage, speak, word } from "./words.js";

const WHEN = ["hello", "fault", "estop"];
const LATER_MS = 10_000; // a fault's file is whole some seconds after it
const SHOWN = 50;
const SAMPLES = 400;
const MAX_EVENTS = 100;
const REASONS = { fault: "rec_fault", estop: "rec_estop", request: "rec_request", continuous: "rec_continuous" };
const element = (id) => document.getElementById(id);

export class Recordings {
  constructor(api, motions, view) {
    this.api = api;
    this.motions = motions;
    this.view = view;
    this.found = { recordings: [], recorder: null };
    this.shown = null; // the path of a recording
    this.look = oneAtATime(() => this.ask());
    element("recordings").addEventListener("toggle", () => this.look());
    element("rec-dump").addEventListener("click", () => this.act({ action: "dump", seconds: 30 }, element("rec-dump")));
    element("rec-run").addEventListener("click", () => this.act({ action: this.runs ? "stop" : "start" }, element("rec-run")));
    element("rec-time").addEventListener("input", () => this.goTo(Number(element("rec-time").value)));
    element("rec-close").addEventListener("click", () => this.close());
    inEachLanguage(() => this.write());
  }

  get runs() {
    return Boolean(this.found.recorder?.recording);
  }

  hear(event) {
    if (!WHEN.includes(event.type)) return;
    this.look();
    setTimeout(() => this.look(), LATER_MS);
  }

  async ask() {
    if (!element("recordings").open || !this.api.robot) return;
    try {
      this.found = await this.api.get("/recordings");
      this.say(() => "");
      this.write();
    } catch (error) {
      this.say(() => reasonOf(error));
    }
  }

  async act(body, button) {
    button.disabled = true;
    try {
      await this.api.post("/recordings", body, { waitMs: LONG_MS });
      await this.look();
    } catch (error) {
      this.say(() => reasonOf(error));
    }
    button.disabled = false;
  }

  // As a file, with the token if there is one.
  async fetch(name) {
    try {
      const answer = await this.api.ask("GET", this.api.address(`/recordings/${encodeURIComponent(name)}`), undefined, { waitMs: LONG_MS });
      const link = document.createElement("a");
      link.href = URL.createObjectURL(await answer.blob());
      link.download = name;
      link.click();
      URL.revokeObjectURL(link.href);
    } catch (error) {
      this.say(() => reasonOf(error));
    }
  }

  // As a ghost, at the time that the slider has.
  async open(name) {
    try {
      this.say(() => "");
      const shown = await this.api.get(`/recordings/${encodeURIComponent(name)}/path?samples=${SAMPLES}`, { waitMs: LONG_MS });
      this.motions.discard();
      this.shown = shown;
      element("rec-name").textContent = name;
      element("rec-time").max = shown.duration_s;
      element("rec-events").replaceChildren(...shown.events.slice(-MAX_EVENTS).map((event) => this.event(event)));
      element("rec-shown").hidden = false;
      this.goTo(shown.duration_s);
    } catch (error) {
      this.say(() => reasonOf(error));
    }
  }

  goTo(time) {
    const view = this.view();
    if (view && view.plan !== this.shown) view.preview(this.shown); // somebody has looked at a plan meanwhile
    view?.hold(time);
    element("rec-time").value = time;
    element("rec-at").textContent = `${time.toFixed(2)} s`;
    element("rec-time").setAttribute("aria-valuetext", `${time.toFixed(2)} s`);
    for (const row of element("rec-events").children) row.toggleAttribute("data-past", Number(row.dataset.time) <= time);
  }

  event({ time_s: time, kind, mode, text }) {
    const [made, button] = ["li", "button"].map((tag) => document.createElement(tag));
    button.type = "button";
    button.textContent = `${time.toFixed(2)} s: ${kind} ${mode} ${text}`.trim();
    button.addEventListener("click", () => this.goTo(time));
    made.dataset.time = time;
    made.append(button);
    return made;
  }

  close() {
    if (this.view()?.plan === this.shown) this.motions.discard();
    this.shown = null;
    element("rec-shown").hidden = true;
  }

  write() {
    const { recordings, recorder } = this.found;
    element("rec-run").textContent = word(this.runs ? "rec_stop" : "rec_start");
    element("rec-run").setAttribute("aria-pressed", String(this.runs));
    element("rec-list").replaceChildren(...recordings.slice(0, SHOWN).map((each) => this.row(each)));
    element("rec-line").replaceChildren(...this.marks(recordings));
    if (recorder?.problem) this.say(() => recorder.problem);
  }

  row({ name, time, reason, size }) {
    const made = document.createElement("li");
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = word("rec_of", {
      when: new Date(time).toLocaleString(document.documentElement.lang, { hourCycle: "h23" }), reason: word(REASONS[reason]), mb: (size / 1e6).toFixed(1),
    });
    button.addEventListener("click", () => this.open(name));
    const file = document.createElement("button");
    file.type = "button";
    file.textContent = "↓";
    file.setAttribute("aria-label", word("rec_fetch", { name }));
    file.addEventListener("click", () => this.fetch(name));
    made.dataset.recording = name;
    made.append(button, file);
    return made;
  }

  // From the oldest to the newest: a line for each.
  marks(recordings) {
    const times = recordings.map((each) => Date.parse(each.time));
    const [first, last] = [Math.min(...times), Math.max(...times)];
    return recordings.map(({ reason }, index) => {
      const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
      const x = last > first ? 2 + (96 * (times[index] - first)) / (last - first) : 50;
      for (const [key, value] of Object.entries({ x1: x, x2: x, y1: 1, y2: 9 })) line.setAttribute(key, value);
      line.setAttribute("class", reason === "fault" || reason === "estop" ? "curve beyond" : "curve");
      return line;
    });
  }

  say(words) {
    speak("rec-why", words);
  }
}
