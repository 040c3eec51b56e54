// How fast all motions go, and the motion that runs: how far it is, its pause and how it has ended.
import { allow } from "./able.js";
import { oneAtATime } from "./once.js";
import { reasonOf, whyOfEnd } from "./reasons.js";
import { dayAndTime, inEachLanguage, speak, word } from "./words.js";

const EVERY_MS = 500; // while it runs: progress is no event
const STATES = {
  queued: "job_queued", planning: "job_planning", running: "job_running", paused: "job_paused", finished: "job_finished",
  failed: "job_failed", cancelled: "job_cancelled", interrupted: "job_interrupted",
};
const GOING = ["planning", "running"];
const OVER = ["finished", "failed", "cancelled", "interrupted"];
const among = (states) => states.map((state) => `&state=${state}`).join("");
export const WITH_STEPS = ["sequence", "program"];
const PLANNED = ["move", "execute", "trajectory", "queue"];
const element = (id) => document.getElementById(id);

function write(id, text) {
  if (element(id).textContent !== text) element(id).textContent = text;
}

// What to do after a job that did not reach its end: a word of the catalogue; "" for nothing.
export function nextAfter(state, kind) {
  if (state === "failed") return "job_next";
  if (state !== "cancelled") return "";
  return WITH_STEPS.includes(kind) ? "halt_next_program" : PLANNED.includes(kind) ? "halt_next_motion" : "";
}

export class Job {
  // speeds: shows the override next to the speed.
  constructor(api, speeds) {
    this.api = api;
    this.speeds = speeds;
    this.job = null;
    this.timer = 0;
    this.sent = 0; // changes of the override from here: an answer from before one is old
    this.held = this.sending = false; // somebody has a hand on the slider; its value is on its way
    this.look = oneAtATime(() => this.ask());
    this.sendSpeed = oneAtATime(() => this.setSpeed());
    const slider = element("override-set");
    slider.addEventListener("input", () => this.writeSpeed());
    slider.addEventListener("change", () => this.sendSpeed());
    slider.addEventListener("pointerdown", () => (this.held = true));
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
      slider.addEventListener(end, () => (this.held = false));
    }
    element("pause").addEventListener("click", () => this.act(this.job.state === "paused" ? "resume" : "pause"));
    element("step").addEventListener("click", () => this.act(this.job.state === "paused" ? "step" : "pause?at_waypoint=0"));
    element("end").addEventListener("click", () => this.act("cancel"));
    inEachLanguage(() => this.write());
  }

  hear(event) {
    if (["job", "hello", "speed"].includes(event.type)) this.look();
  }

  async ask() {
    clearTimeout(this.timer);
    const { sent, api: { robot } } = this;
    try {
      const [job, { fraction }] = await Promise.all([this.newest(), this.api.get("/speed_override")]);
      if (robot !== this.api.robot) return;
      this.job = job;
      if (sent === this.sent) this.show(fraction);
      this.write();
    } catch (error) {
      speak("job-why", () => reasonOf(error));
    }
    if (this.job?.state === "running") this.timer = setTimeout(() => this.look(), EVERY_MS);
  }

  // The one that goes on, or else the last one: those that wait in the queue are newer than both, and may be many.
  async newest() {
    for (const states of [["paused", ...GOING], OVER]) {
      const { jobs } = await this.api.get(`/jobs?n=10${among(states)}`);
      const found = jobs.find((job) => job.parent === null && job.kind !== "study"); // a study moves nothing
      if (found) return found;
    }
    return null;
  }

  show(fraction) {
    if (this.held || this.sending) return;
    element("override-set").value = Math.round(100 * fraction);
    this.writeSpeed();
  }

  writeSpeed() {
    const text = `${element("override-set").value} %`;
    write("override-shown", text);
    element("override-set").setAttribute("aria-valuetext", text);
    this.speeds.write();
  }

  async setSpeed() {
    this.sending = true;
    this.sent += 1;
    const fraction = element("override-set").value / 100;
    try {
      await this.api.post("/speed_override", { fraction });
      speak("job-why", () => "");
    } catch (error) {
      speak("job-why", () => reasonOf(error));
    }
    this.sending = false;
    this.sent += 1;
    this.look();
  }

  // A sequence is paused with the motion that it is in.
  async act(what) {
    try {
      await this.api.post(`/jobs/${this.job.id}/${what}`);
      speak("job-why", () => "");
    } catch (error) {
      speak("job-why", () => reasonOf(error));
    }
    this.look();
  }

  write() {
    const { state, kind, owner, progress = 0, remaining_s: left, ended_at: ended, error } = this.job ?? {};
    const paused = state === "paused";
    const going = paused || GOING.includes(state);
    write("pause", word(paused ? "resume" : "pause"));
    const idle = going ? "" : "why_no_motion";
    for (const id of ["pause", "end"]) allow(element(id), idle);
    allow(element("step"), idle || (WITH_STEPS.includes(kind) ? "" : "why_no_steps"));
    element("progress").value = going || state === "finished" ? progress : 0;
    write("job", this.job ? word(ended ? "job_over" : "job_of", { state: word(STATES[state]), owner, time: ended && dayAndTime(ended) }) : word("job_none"));
    write("job-error", whyOfEnd(state, error));
    write("job-next", word(nextAfter(state, kind), {}, ""));
    element("job-error").title = error?.detail ?? "";
    write("job-left", going && typeof left === "number" ? word("job_left", { seconds: left.toFixed(0) }) : "");
  }
}
