// The gripper: how it is, and its commands. The card is there if the robot has one.
import { oneAtATime } from "./once.js";
import { reasonOf } from "./reasons.js";
import { inEachLanguage, speak, word } from "./words.js";

const EVERY_MS = 500;
const COMMAND_MS = 35_000; // the service gives a command 30 s
const NOT_THERE = [404, 501];
const MM = 1000;
const element = (id) => document.getElementById(id);

export class Gripper {
  constructor(api, view) {
    this.api = api;
    this.view = view; // of the arm, once there is one
    this.report = this.robot = null;
    this.none = false; // the robot has no gripper
    this.commands = 0; // a command of this page replaces the one before, whose answer no longer counts
    this.look = oneAtATime(() => this.ask());
    element("gripper-open").addEventListener("click", () => this.command("release", {}));
    element("gripper-grasp").addEventListener("click", () => this.command("grasp", this.force()));
    element("gripper-stop").addEventListener("click", () => this.command("stop"));
    element("gripper-home").addEventListener("click", () => this.command("home", {}));
    element("gripper-width").addEventListener("input", () => this.writeWidth());
    element("gripper-width").addEventListener("change", () => this.move());
    setInterval(() => this.look(), EVERY_MS);
    inEachLanguage(() => this.write());
  }

  async ask() {
    const { robot } = this.api;
    if (robot !== this.robot) [this.robot, this.none, this.report] = [robot, false, null];
    if (document.hidden || !robot || this.none) {
      this.write();
      return;
    }
    try {
      const report = await this.api.get("/gripper");
      if (robot === this.api.robot) this.report = report;
    } catch (error) {
      this.none = NOT_THERE.includes(error.status);
      if (!this.none) speak("gripper-state", () => reasonOf(error));
      return;
    }
    this.write();
  }

  force() {
    const force = element("gripper-force").valueAsNumber;
    return Number.isFinite(force) ? { force } : {};
  }

  move() {
    this.command("move", { width: element("gripper-width").valueAsNumber / MM, ...this.force() });
  }

  async command(name, body) {
    const number = (this.commands += 1);
    speak("gripper-why", () => "");
    this.look();
    let why = () => "";
    try {
      const answer = await this.api.post(`/gripper/${name}`, body, { waitMs: COMMAND_MS });
      if (answer.success === false) why = () => reasonOf({ ...answer, detail: answer.message });
    } catch (error) {
      why = () => reasonOf(error);
    }
    if (number === this.commands) speak("gripper-why", why);
    this.look();
  }

  write() {
    element("gripper").hidden = !this.report;
    if (!this.report) return;
    const { state, problem, capabilities: able, held } = this.report;
    const bounds = [able.width_m, able.force_n].join();
    if (element("gripper").dataset.bounds !== bounds) {
      element("gripper").dataset.bounds = bounds;
      this.describe(able);
    }
    const width = element("gripper-width");
    if (document.activeElement !== width && typeof state?.width === "number") width.value = MM * state.width;
    this.writeWidth();
    if (typeof state?.width === "number" && able.width_m) this.view()?.grip(able.width_m[1] - state.width);
    speak("gripper-state", () => problem || (state ? this.said(state, held) : ""));
  }

  describe({ width_m: widths, force_n: force, continuous }) {
    const width = element("gripper-width");
    width.closest("label").hidden = !widths;
    if (widths) [width.min, width.max] = widths.map((each) => MM * each);
    width.disabled = !continuous;
    const place = element("gripper-force");
    place.closest("label").hidden = !force;
    if (force) [place.min, place.max] = force;
  }

  writeWidth() {
    element("gripper-width-shown").textContent = `${element("gripper-width").valueAsNumber.toFixed(0)} mm`;
  }

  // Width, force and what is held, as far as they are known.
  said({ width, force, moving, object, fault }, held) {
    const values = [
      typeof width === "number" ? `${(MM * width).toFixed(1)} mm` : "",
      typeof force === "number" ? `${force.toFixed(0)} N` : "",
    ].filter(Boolean).join(", ");
    const parts = [
      fault,
      object ? word(`gripper_${object}`, { name: held ?? word("gripper_something") }) : "",
      moving ? word("gripper_moving") : "",
      values && word("gripper_measured", { values }),
    ];
    return parts.filter(Boolean).join(" ");
  }
}
