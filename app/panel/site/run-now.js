// The newest program of any client: its step, its cycle and the time of a cycle; and a pause after a chosen step.
import { allow } from "./able.js";
import { WITH_STEPS } from "./job.js";
import { reasonOf } from "./reasons.js";
import { nameOf } from "./step-words.js";
import { stepAt } from "./steps.js";
import { inEachLanguage, speak, word } from "./words.js";

const STEP = /^(?:step|waypoint) ([\w.]+)(?: of |\/)(\d+)/; // of the file that was started
const EXTENSION = /\.(json|lua)$/;
const MAX_CYCLES = 1000; // whose times are kept
const NONE = { name: "", iterations: 0, iteration: 0, began: 0, step: "", cycles: [], runs: false };
const element = (id) => document.getElementById(id);

export class RunNow {
  constructor(api, page, stored) {
    Object.assign(this, { api, page, stored });
    this.newest = NONE;
    element("run-pause-at").addEventListener("click", () => this.pauseAt());
    page.onChange(() => this.write());
    stored.onList(() => this.write());
    inEachLanguage(() => this.write());
  }

  // Another robot was chosen.
  load() {
    this.newest = NONE;
    speak("run-now-why", () => "");
    this.write();
  }

  // All events that the service keeps come after a page is opened. The start of a long program may be missing.
  hear({ type, time, data }) {
    if (type === "service" && data.what === "started") this.load();
    if (type !== "sequence") return;
    const now = Date.parse(time);
    if (data.what === "started") this.begin(data);
    else if (data.what === "waypoint") this.follow(now, data);
    else if (data.what === "ended") this.end(now, data);
    this.write();
  }

  begin({ name, iterations }) {
    this.newest = { ...NONE, name, iterations, runs: true };
    speak("run-now-why", () => "");
  }

  follow(now, { iteration, step }) {
    const known = this.newest.runs ? this.newest : NONE;
    const begins = iteration > known.iteration;
    this.newest = { ...known, step: step ?? "", runs: true };
    if (begins) this.newest = { ...this.newest, cycles: this.cyclesUntil(now), iteration, began: now };
  }

  end(now, { returncode }) {
    const cycles = returncode === 0 ? this.cyclesUntil(now) : this.newest.cycles;
    this.newest = { ...this.newest, cycles, step: returncode === 0 ? "" : this.newest.step, runs: false }; // where a stop has ended it
    speak("run-now-why", () => "");
  }

  // Times of the cycles, with the one that ends now. A cycle lasts until the next one begins or the program ends.
  cyclesUntil(now) {
    const { began, cycles } = this.newest;
    return began ? [...cycles, (now - began) / 1000].slice(-MAX_CYCLES) : cycles;
  }

  // The program goes on and waits once this step of its outermost list is done.
  async pauseAt() {
    const step = element("run-at").valueAsNumber;
    if (Number.isNaN(step)) return void element("run-at").focus();
    try {
      const { jobs } = await this.api.get("/jobs?n=10&state=running&state=planning&state=paused");
      const job = jobs.find((each) => each.parent === null && WITH_STEPS.includes(each.kind));
      if (!job) return void this.say(() => word("run_not"));
      await this.api.post(`/jobs/${job.id}/pause?at_waypoint=${step}`);
      this.say(() => word("run_pauses", { step }));
    } catch (error) {
      this.say(() => reasonOf(error));
    }
  }

  write() {
    const { name, iterations, iteration, step, cycles, runs } = this.newest;
    const [, number, total] = step === "home" ? ["", "0"] : STEP.exec(step) ?? ["", ""];
    const own = this.nameOfStep(name, number);
    const place = total ? word("run_of", { number, total }) : step;
    const [last, mean] = [cycles.at(-1), cycles.reduce((sum, each) => sum + each, 0) / cycles.length];
    const values = {
      "run-program": this.labelOf(name),
      "run-step": number === "0" ? own || word("step_home") : [place, own].filter(Boolean).join(" · "),
      "run-cycle": iteration && iterations ? word("run_of", { number: iteration, total: iterations }) : iteration || "",
      "run-time": cycles.length ? word("run_seconds", { last: last.toFixed(1), mean: mean.toFixed(1) }) : "",
    };
    for (const [id, text] of Object.entries(values)) element(id).textContent = text || "–";
    const isLua = name.endsWith(".lua");
    for (const id of ["run-at", "run-pause-at"]) allow(element(id), !runs ? "run_not" : isLua ? "why_lua" : "");
    for (const row of document.querySelectorAll("#steps [data-step]")) row.toggleAttribute("data-next", own !== "" && row.dataset.step === number);
  }

  labelOf(name) {
    const id = name.replace(EXTENSION, "");
    return this.stored.list.find((each) => each.id === id)?.label ?? id;
  }

  // The name of the step that runs, if its program is the one that is open.
  nameOfStep(name, number) {
    const { content, document: { id }, fileName } = this.page.program;
    const step = content && number && [fileName, `${id}.json`].includes(name) ? stepAt(content, number) : null;
    return step ? nameOf(step, number) : "";
  }

  say(words) {
    speak("run-now-why", words);
  }
}
