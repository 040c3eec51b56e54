// Mode, who has the control, speed override, how the cycle is, and whether anybody answers.
import { oneAtATime } from "./once.js";
import { inEachLanguage, word } from "./words.js";

const EVERY_MS = 5000; // how the cycle is, is no event
const CHANGES = ["hello", "lease", "motion", "session", "sequence", "job", "rtloop", "speed"];
const LEVELS = { HOLD: "good", ESTOP: "bad", FAULT: "bad", STOPPING: "warn" };
const element = (id) => document.getElementById(id);

function say(id, text, level = "") {
  const shown = element(id);
  if (shown.textContent !== text) shown.textContent = text;
  shown.dataset.level = level;
}

export class Status {
  constructor(api, device) {
    this.api = api;
    this.device = device;
    this.mode = null;
    this.line = null;
    this.look = oneAtATime(() => this.ask());
    inEachLanguage(() => {
      if (this.mode) this.write();
      if (this.line !== null) this.connected(this.line);
      this.look();
    });
    setInterval(() => this.look(), EVERY_MS);
  }

  show(state) {
    if (state.mode === this.mode) return;
    this.mode = state.mode;
    this.write();
  }

  write() {
    const shown = element("mode");
    shown.dataset.mode = this.mode;
    say("mode", word(`mode_${this.mode}`), LEVELS[this.mode] ?? "");
  }

  connected(connected) {
    this.line = connected;
    say("connection", word(connected ? "connected" : "lost"), connected ? "good" : "bad");
  }

  hear(event) {
    if (CHANGES.includes(event.type)) this.look();
  }

  async ask() {
    const { robot } = this.api;
    if (!robot || document.hidden) return;
    try {
      const [control, health, robots] = await Promise.all([
        this.api.get("/control"),
        this.api.get("/health"),
        this.api.robots(),
      ]);
      if (robot !== this.api.robot) return;
      this.device.tell(robots.find(({ name }) => name === robot.name)?.device);
      const holder = control.holder ? `${control.holder} (${control.address})` : control.what;
      say("control", control.held ? `${holder ?? ""}${control.what ? `: ${control.what}` : ""}` : word("nobody"));
      element("control").title = element("control").textContent;
      say("override", `${Math.round(100 * control.speed_fraction)} %`);
      const { total } = health.cycle_us ?? {};
      const level = health.rtloop?.alive ? "good" : "bad";
      say("cycle", total ? word("cycle_times", { p99: total.p99_us, late: health.rtloop.overruns }) : "?", level);
    } catch (error) {
      for (const id of ["control", "override", "cycle"]) say(id, "?", "bad");
      element("control").title = error.message;
    }
  }
}
