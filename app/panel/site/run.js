// Starts a stored program, or the program that is open on the page Program, as a job of the service. The job continues
// if this page is closed.
import { allow } from "./able.js";
import { nextAfter } from "./job.js";
import { reasonOf, whyOfEnd } from "./reasons.js";
import { inEachLanguage, speak, word } from "./words.js";

const ENDS = ["finished", "failed", "cancelled", "interrupted"];
const UNSURE = [0, 503]; // no answer, or the service is too busy: the job goes on
const AGAIN_MS = 1000;
const OPEN = ""; // the choice of the program that is open, in place of the id of a stored one
const element = (id) => document.getElementById(id);

export class Run {
  constructor(api, page, motions, stored) {
    Object.assign(this, { api, page, motions, stored });
    this.job = null; // the one that was started here
    this.chosen = null; // an id or OPEN; null until the user chooses
    element("points-run").addEventListener("click", () => this.run());
    element("points-step").addEventListener("click", () => this.run(true));
    page.onChange(() => this.write());
    stored.onList(() => this.write());
    inEachLanguage(() => this.write());
  }

  // Another robot was chosen.
  load() {
    this.job = this.chosen = null;
    this.say(() => "");
  }

  // What can be started: the open program if it is not saved, then the stored ones.
  get choices() {
    const { isEmpty, isChanged, document: { label, kind } } = this.page.program;
    const open = { id: OPEN, label: label || word("program_unnamed"), kind, about: word("stored_changed") };
    const stored = this.stored.list.map((each) => ({ ...each, about: each.example ? word("example") : word("stored_as", each) }));
    return isEmpty || !isChanged || this.page.program.isExample ? stored : [open, ...stored];
  }

  // The one that the user chose, or else the open program, or else the first one.
  choiceOf(choices) {
    const { id, copied } = this.page.program.document;
    const wanted = [this.chosen, OPEN, id, copied?.id];
    return wanted.map((id) => choices.find((each) => each.id === id)).find(Boolean) ?? choices[0];
  }

  // hold: wait before the first motion.
  async run(hold = false) {
    const { id, kind } = this.choiceOf(this.choices);
    const how = { n_iterations: element("points-rounds").valueAsNumber || 1, hold };
    const from = element("run-from").valueAsNumber;
    if (kind !== "lua" && !Number.isNaN(from)) how.from_waypoint = from;
    this.motions.discard();
    try {
      const started = id === OPEN
        ? await this.api.post("/sequences/start?wait=false", this.upload({ ...how, delay_between_iterations: 0 }))
        : await this.api.post(`/programs/${id}/run?wait=false`, how);
      this.job = started.id;
      await this.look();
    } catch (error) {
      this.say(() => reasonOf(error), "warn");
    }
  }

  upload(how) {
    const { text, fileName } = this.page.program;
    const body = new FormData();
    body.append("config", new File([text], fileName));
    for (const [name, value] of Object.entries(how)) body.append(name, String(value));
    return body;
  }

  hear({ type, data }) {
    if (this.job && (type === "hello" || (type === "job" && data.job === this.job))) this.look();
  }

  // Whether it still runs. Its end may have been reported before its number was known here.
  async look() {
    const { job } = this;
    if (!job) return;
    const ended = (problem) => (UNSURE.includes(problem.status) ? {} : { state: "failed", error: problem });
    const { state, error } = await this.api.get(`/jobs/${job}`).catch(ended);
    if (job !== this.job) return;
    if (!state) return void setTimeout(() => this.look(), AGAIN_MS);
    if (!ENDS.includes(state)) return void this.say(() => word(state === "paused" ? "points_steps" : "points_runs"));
    this.job = null;
    if (state === "finished") return void this.say(() => word("points_done"));
    this.say(() => {
      const why = whyOfEnd(state, error).replace(/[^.!?。]$/, "$&.");
      return word("run_ended", { state: word(`job_${state}`), why, next: word(nextAfter(state, "sequence"), {}, "") });
    }, "warn");
  }

  write() {
    const { choices } = this;
    const choice = this.choiceOf(choices);
    const focused = document.activeElement?.dataset.run;
    element("run-list").replaceChildren(...choices.map((each) => this.row(each, each === choice)));
    if (focused !== undefined) element("run-list").querySelector(`[data-run="${focused}"]`)?.focus();
    element("run-what").textContent = choice ? "" : word("run_none");
    for (const id of ["points-run", "points-step"]) allow(element(id), this.job ? "why_program_runs" : choice ? "" : "run_none");
    allow(element("run-from"), choice?.kind === "lua" ? "why_lua" : "");
  }

  row({ id, label, kind, about }, isChosen) {
    const [row, button, name, line] = ["li", "button", "b", "small"].map((tag) => document.createElement(tag));
    button.type = "button";
    button.dataset.run = id;
    button.setAttribute("aria-pressed", String(isChosen));
    name.textContent = label;
    line.textContent = kind === "lua" ? `Lua · ${about}` : about;
    button.append(name, line);
    button.addEventListener("click", () => {
      this.chosen = id;
      this.write();
    });
    row.append(button);
    return row;
  }

  // level: "warn" for a program that has not started or has not reached its end.
  say(words, level = "") {
    speak("run-why", words);
    element("run-why").dataset.level = level;
    this.write();
  }
}
