// Hold to move: frames go out as long as a button is held. Whatever ends the holding, they end; the service
// stops the arm when it is told so, or when it hears nothing for 200 ms.
import { abcOf, stepped } from "./kinematics.js";
import { word } from "./words.js";

const EVERY_MS = 50;
const TCP_M_S = 0.25;
const TCP_RAD_S = 0.5;
const JOINT_SHARE = 0.5; // of a joint's own speed, at 100 %
const STEPS = { small: [0.5, 0.001], middle: [2, 0.01], large: [10, 0.05] };
const element = (id) => document.getElementById(id);

export class Jog {
  constructor(api, stream, readouts) {
    this.api = api;
    this.stream = stream;
    this.readouts = readouts;
    this.held = null;
    this.timer = 0;
    this.pending = false;
    document.addEventListener("pointerdown", (event) => this.press(event, event.target.closest?.("[data-jog]")));
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
      document.addEventListener(end, () => this.release());
    }
    document.addEventListener("keydown", (event) => {
      const button = event.target.closest?.("[data-jog]");
      if (event.key !== "Enter" || !button) return;
      event.preventDefault();
      if (!event.repeat) this.press(event, button);
    });
    document.addEventListener("keyup", () => this.release());
    document.addEventListener("contextmenu", (event) => {
      if (event.target.closest?.("[data-jog]")) event.preventDefault();
    });
    window.addEventListener("blur", () => this.release());
    window.addEventListener("pagehide", () => this.release());
    document.addEventListener("visibilitychange", () => this.release());
    document.addEventListener("focusout", (event) => {
      if (event.target === this.held) this.release();
    });
  }

  press(event, button) {
    if (!button || (event.button ?? 0) !== 0) return;
    const how = element("jog-how").value;
    this.release();
    if (how !== "hold") {
      this.step(button, ...STEPS[how]);
      return;
    }
    if (event.pointerId !== undefined) button.setPointerCapture(event.pointerId);
    this.held = button;
    button.toggleAttribute("data-held", true);
    this.timer = setInterval(() => this.send(), EVERY_MS);
    this.send(); // which lets go, and ends the timer, if nobody hears it
  }

  // A frame without a velocity lets go; it goes out whenever a holding ends.
  release() {
    if (!this.held) return;
    this.held.removeAttribute("data-held");
    this.held = null;
    clearInterval(this.timer);
    this.stream.send({ type: "jog" });
    this.say(word("jog_hint"));
  }

  send() {
    const { jog, index, sign } = this.held.dataset;
    const share = (Number(sign) * element("jog-speed").value) / 100;
    const frame = { type: "jog" };
    if (jog === "joint") {
      frame.joints = this.readouts.ranges.map((range, each) =>
        each === Number(index) ? share * JOINT_SHARE * range.max_velocity : 0,
      );
    } else {
      frame.twist = [0, 0, 0, 0, 0, 0];
      frame.twist[index] = share * (index < 3 ? TCP_M_S : TCP_RAD_S);
      frame.frame = element("jog-frame").value;
    }
    if (!this.stream.send(frame)) this.release();
  }

  hear(frame) {
    if (frame.type === "jog" && this.held) this.say(frame.limited_by ? this.limited(frame) : word("jog_moves"));
    else if (frame.type === "jog_ended" && frame.reason) this.say(word("jog_ended", frame));
    else if (frame.type === "error" && frame.about === "jog") this.say(frame.detail);
  }

  limited(frame) {
    return word("jog_limited", { percent: Math.round(100 * frame.share), why: frame.limited_by });
  }

  // An increment is a motion like any other: planned, checked, and refused with the reason.
  async step(button, angle, way) {
    const { jog, index, sign } = button.dataset;
    if (this.pending) return;
    this.pending = true;
    this.say(word("jog_moves"));
    try {
      const answer = await (jog === "joint" ? this.stepJoint : this.stepTcp).call(
        this, Number(index), Number(sign) * angle * (Math.PI / 180), Number(sign) * way,
      );
      this.say(answer.success ? word("jog_hint") : answer.message);
    } catch (error) {
      this.say(error.message);
    } finally {
      this.pending = false;
    }
  }

  async stepJoint(index, angle, way) {
    const joints = (await this.api.get("/joint_states")).position;
    joints[index] += this.readouts.ranges[index].slides ? way : angle;
    return this.api.post("/move/joints", { joints, speed: element("jog-speed").value / 200 });
  }

  async stepTcp(index, angle, way) {
    const { position, orientation } = await this.api.get("/pose");
    const turn = orientation.quaternion;
    const step = [0, 0, 0, 0, 0, 0];
    step[index] = index < 3 ? way : angle;
    const inTool = element("jog-frame").value === "tool";
    const goal = stepped([position.x, position.y, position.z], [turn.x, turn.y, turn.z, turn.w], step, inTool);
    const [x, y, z] = goal.position;
    const [a, b, c] = abcOf(goal.quaternion);
    return this.api.post("/move/pose", { x, y, z, a, b, c, planner: "lin", speed: element("jog-speed").value / 200 });
  }

  say(text) {
    element("jog-why").textContent = text;
  }
}
