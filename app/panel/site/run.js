// Runs the open program as a job of the service. The job continues if this page is closed.
import { word, inEachLanguage } from "./words.js";

const ENDS = ["finished", "failed", "cancelled", "interrupted"];
const NUMBER = /(?:step|waypoint) ([\w.]+?)(?: of |\/)/; // of the outermost file
const element = (id) => document.getElementById(id);

export class Run {
  constructor(api, page, motions) {
    Object.assign(this, { api, page, motions });
    this.job = null; // that runs it
    this.words = () => "";
    element("points-run").addEventListener("click", () => this.run());
    element("points-step").addEventListener("click", () => this.run(true));
    page.onChange(() => this.write());
    inEachLanguage(() => this.write());
  }

  load() {
    this.job = null;
    this.say(() => "");
  }

  // hold: wait before the first motion.
  async run(hold = false) {
    const { program } = this.page;
    const body = new FormData();
    body.append("config", new File([program.text], program.fileName));
    body.append("n_iterations", element("points-rounds").value || "1");
    body.append("delay_between_iterations", "0");
    body.append("hold", String(hold));
    this.motions.discard();
    try {
      this.job = (await this.api.post("/sequences/start?wait=false", body)).id;
      this.say(() => word(hold ? "points_steps" : "points_runs"));
      await this.look();
    } catch (error) {
      this.say(() => error.message);
    }
  }

  hear({ type, data }) {
    if (!this.job) return;
    if (type === "sequence" && data.what === "waypoint") this.mark(NUMBER.exec(data.step ?? "")?.[1] ?? "");
    if (type === "hello" || (type === "job" && data.job === this.job)) this.look();
  }

  // Whether it still runs. Its end may have been reported before its number was known here.
  async look() {
    const { job } = this;
    if (!job) return;
    const { state, error } = await this.api.get(`/jobs/${job}`).catch((problem) => ({ state: "failed", error: { detail: problem.message } }));
    if (job !== this.job || !ENDS.includes(state)) return;
    this.job = null;
    this.mark("");
    this.say(() => (state === "finished" ? word("points_done") : error?.detail ?? word(`job_${state}`)));
  }

  // The step that runs.
  mark(number) {
    for (const row of document.querySelectorAll("#steps [data-step]")) row.toggleAttribute("data-next", row.dataset.step === number);
  }

  write() {
    const { program } = this.page;
    for (const id of ["points-run", "points-step"]) element(id).disabled = program.isEmpty;
    element("run-what").textContent = program.isEmpty ? word("run_none") : program.document.label || word("program_unnamed");
    element("run-why").textContent = this.words();
  }

  say(words) {
    this.words = words;
    this.write();
  }
}
