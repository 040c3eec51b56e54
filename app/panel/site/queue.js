// Motions that wait for their turn, each with a way out of the queue.
import { oneAtATime } from "./once.js";
import { reasonOf } from "./reasons.js";
import { inEachLanguage, speak, word } from "./words.js";

const SHOWN = 20;
const element = (id) => document.getElementById(id);

export class Queue {
  constructor(api) {
    this.api = api;
    this.jobs = [];
    this.rows = new Map(); // by job: one that is pressed stays until it is let go
    this.look = oneAtATime(() => this.ask());
    inEachLanguage(() => this.write());
  }

  hear(event) {
    if (event.type === "job" || event.type === "hello") this.look();
  }

  async ask() {
    const robot = this.api.robot;
    try {
      const { jobs } = await this.api.get("/jobs?n=1000&state=queued");
      if (robot !== this.api.robot) return;
      this.jobs = jobs.reverse(); // the next one first
      this.write();
    } catch (error) {
      this.say(() => reasonOf(error));
    }
  }

  write() {
    const more = this.jobs.length - SHOWN;
    const shown = this.jobs.slice(0, SHOWN);
    for (const [id, row] of this.rows) {
      if (shown.some((job) => job.id === id)) continue;
      row.made.remove();
      this.rows.delete(id);
    }
    for (const [index, job] of shown.entries()) this.writeRow(job, index);
    this.say(() => (more > 0 ? word("queue_more", { count: more }) : ""));
  }

  say(words) {
    speak("queue-why", words);
    element("queue-card").hidden = !this.jobs.length && !words();
  }

  writeRow({ id, request, planned_duration_s: duration }, index) {
    const { text, button } = this.rows.get(id) ?? this.row(id);
    text.textContent = word("queue_of", { seconds: (duration ?? 0).toFixed(1), request: request.split("/move/").at(-1) });
    button.setAttribute("aria-label", word("queue_cancel", { number: index + 1 }));
  }

  row(id) {
    const [made, text, button] = ["li", "span", "button"].map((tag) => document.createElement(tag));
    button.type = "button";
    button.textContent = "✕";
    button.addEventListener("click", () => this.cancel(id, button));
    made.dataset.job = id;
    made.append(text, button);
    element("queue").append(made);
    this.rows.set(id, { made, text, button });
    return this.rows.get(id);
  }

  async cancel(id, button) {
    button.disabled = true;
    try {
      await this.api.post(`/jobs/${id}/cancel`);
    } catch (error) {
      this.say(() => reasonOf(error));
    }
    this.look();
  }
}
