// The head of the panel: the state in one word, the robot, and who has the control. Cycle times and the connection
// are on the page Diagnose.
import { oneAtATime } from "./once.js";
import { reasonOf } from "./reasons.js";
import { inEachLanguage, named, speak, word } from "./words.js";

const EVERY_MS = 5000; // no event tells of the cycle
const CHANGES = ["hello", "lease", "motion", "session", "sequence", "job", "rtloop", "speed"];
const LEVELS = { HOLD: "good", TRAJECTORY: "busy", ESTOP: "bad", FAULT: "bad", STOPPING: "warn" };
const OWN = { jog: "mode_jog", freedrive: "mode_freedrive" };
const STREAMING = ["JOINT_IMPEDANCE", "CARTESIAN", "JOINT_TORQUE"];
const UNNAMED = /^anonymous\b/;
const element = (id) => document.getElementById(id);

function say(id, text, level = "") {
  const shown = element(id);
  if (shown.textContent !== text) shown.textContent = text;
  shown.dataset.level = level;
}

export class Status {
  // ownStream: what this page streams, "jog", "freedrive", or null. isPaused: whether the motion is.
  constructor(api, device, ownStream, isPaused) {
    this.api = api;
    this.device = device;
    this.ownStream = ownStream;
    this.isPaused = isPaused;
    this.mode = this.line = this.own = null;
    this.look = oneAtATime(() => this.ask());
    inEachLanguage(() => {
      if (this.mode) this.write();
      if (this.line !== null) this.connected(this.line);
      this.look();
    });
    setInterval(() => this.look(), EVERY_MS);
  }

  // The robot that is shown; null: none yet.
  name(robot) {
    say("robot-name", robot?.name ?? "cobot");
    say("robot-model", robot?.model ?? "");
    document.title = robot ? `${robot.name} · cobot` : "cobot";
  }

  show(state) {
    this.mode = state.mode;
    this.write();
  }

  write() {
    // Until the arm is at rest after a jog, the state is still "Jogging".
    this.own = STREAMING.includes(this.mode) ? (OWN[this.ownStream()] ?? this.own) : null;
    element("mode").dataset.mode = this.mode;
    const paused = ["TRAJECTORY", "HOLD"].includes(this.mode) && this.isPaused(); // on a path, or between two motions
    say("mode", word(paused ? "job_paused" : (this.own ?? `mode_${this.mode}`)), paused ? "warn" : (LEVELS[this.mode] ?? "busy"));
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
      const device = robots.find(({ name }) => name === robot.name)?.device;
      this.device.tell(device);
      element("simulation").hidden = element("simulation-card").hidden = !device || device.hardware;
      say("control", this.holder(control));
      const who = control.holder ? `${named(control.holder)} (${control.address})` : "";
      say("control-who", who && this.api.control ? `${word("you")} · ${who}` : who);
      if (!control.held) speak("control-why", () => ""); // why it could not be taken is no longer true
      const { total } = health.cycle_us ?? {};
      const level = health.rtloop?.alive ? "good" : "bad";
      say("cycle", total ? word("cycle_times", { p99: total.p99_us, late: health.rtloop.overruns }) : "?", level);
    } catch (error) {
      for (const id of ["control", "cycle"]) say(id, "?", "bad");
      say("control-who", reasonOf(error));
    }
  }

  // Free, You, or the name of the other client.
  holder({ held, holder, what }) {
    if (!held) return word("nobody");
    if (this.api.control) return word("you");
    const name = holder ?? what ?? "";
    return UNNAMED.test(name) ? word("unnamed_short") : named(name); // the menu has the address
  }
}
