// Mode, who has the control, speed override, how the cycle and the robot are, and whether anybody answers.
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
  constructor(api) {
    this.api = api;
    this.mode = null;
    this.line = null;
    this.look = oneAtATime(() => this.ask());
    inEachLanguage(() => {
      if (this.mode) this.write();
      if (this.line !== null) this.connected(this.line);
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

  // What the robot says of itself, of which a simulation says nothing.
  tell(device) {
    const shown = element("device");
    shown.closest("div").hidden = !device;
    if (!device) return;
    const { connection, quality, operation_mode: mode, drives, safety_stop: stop, text } = device;
    const drive = drives && `drives ${drives}`;
    const parts = stop ? [mode, stop] : [mode, connection, quality, drive];
    say("device", parts.filter(Boolean).join(", "), stop ? "bad" : "");
    shown.title = text;
  }

  async ask() {
    if (!this.api.robot || document.hidden) return;
    try {
      const [control, health, robots] = await Promise.all([
        this.api.get("/control"),
        this.api.get("/health"),
        this.api.robots().catch(() => []),
      ]);
      this.tell(robots.find((robot) => robot.name === this.api.robot.name)?.device?.status);
      const holder = control.holder ? `${control.holder} (${control.address})` : control.what;
      say("control", control.held ? `${holder ?? ""}${control.what ? `: ${control.what}` : ""}` : word("nobody"));
      element("control").title = element("control").textContent;
      say("override", `${Math.round(100 * control.speed_fraction)} %`);
      const cycle = health.cycle_us.total;
      const level = health.rtloop.alive ? "good" : "bad";
      if (cycle) say("cycle", word("cycle_times", { p99: cycle.p99_us, late: health.rtloop.overruns }), level);
    } catch (error) {
      say("control", "?");
    }
  }
}
