// Hold to move: frames go out as long as a button is held. Whatever ends the holding, they end; the service
// stops the arm when it is told so, or when it hears nothing for 200 ms.
import { allow } from "./able.js";
import { moved } from "./follow.js";
import { abcOf, stepped, tcpOf } from "./kinematics.js";
import { reasonOf, whyOf } from "./reasons.js";
import { inEachLanguage, speak, word } from "./words.js";

const EVERY_MS = 50;
// What 100 % is for planned motions of the TCP, and the limits of jogging: of the TCP, and as a share for a joint.
const [FULL_M_S, FULL_RAD_S] = [1, 2];
const [MAX_M_S, MAX_RAD_S, MAX_SHARE] = [0.25, 0.5, 0.5];
const LATCHED = ["ESTOP", "FAULT"];
const STEPS = { small: [0.5, 0.001], middle: [2, 0.01], large: [10, 0.05] };
const percentOf = ({ share }) => Math.round(100 * share);
const element = (id) => document.getElementById(id);

export class Jog {
  // now: {state, geometry}; either may be missing.
  constructor(api, stream, readouts, now, speeds) {
    this.api = api;
    this.speeds = speeds;
    this.stream = stream;
    this.readouts = readouts;
    this.now = now;
    this.held = null;
    this.why = null; // why nothing can be jogged; "" if it can
    this.refused = false; // whether the reason is shown why the last press did not move the arm, or no longer does
    this.blocked = false; // whether the arm has come to rest while the button was held
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
    // What is pressed without a pointer or a key, as a screen reader does: a step can be taken so, nothing held.
    document.addEventListener("click", (event) => {
      const button = event.target.closest?.("[data-jog]");
      if (button && !event.detail && !this.held) this.press(event, button, { held: false });
    });
    document.addEventListener("contextmenu", (event) => {
      if (event.target.closest?.("[data-jog]")) event.preventDefault();
    });
    for (const each of document.querySelectorAll("[name=jog-how]")) each.addEventListener("change", () => this.hint());
    this.hint();
    inEachLanguage(() => this.mark());
    window.addEventListener("blur", () => this.release());
    window.addEventListener("pagehide", () => this.release());
    document.addEventListener("visibilitychange", () => this.release());
    document.addEventListener("focusout", (event) => {
      if (event.target === this.held) this.release();
    });
  }

  // In an e-stop or a fault nothing can be jogged.
  show({ mode }) {
    const why = LATCHED.includes(mode) ? "why_latched" : "";
    if (why === this.why) return;
    this.why = why;
    if (why) this.release();
    this.mark();
    this.hint();
  }

  mark() {
    if (this.why === null) return;
    for (const button of document.querySelectorAll("[data-jog]")) allow(button, this.why);
  }

  get how() {
    return document.querySelector("input[name=jog-how]:checked").value;
  }

  // What a press does.
  hint() {
    const { why } = this;
    if (why) return void this.say(() => word(why));
    const [angle, way] = STEPS[this.how] ?? [];
    this.say(() => (angle ? word("jog_hint_step", { angle, way: 1000 * way }) : word("jog_hint")));
  }

  press(event, button, { held = true } = {}) {
    if (!button || (event.button ?? 0) !== 0) return;
    const { how } = this;
    this.release();
    this.refused = this.blocked = false;
    if (!this.speeds.override) return void this.say(() => word("jog_override_zero"));
    if (how !== "hold") {
      this.step(button, ...STEPS[how]);
      return;
    }
    if (!held) {
      this.say(() => word("jog_steps"));
      return;
    }
    if (event.pointerId !== undefined) button.setPointerCapture(event.pointerId);
    this.held = button;
    button.toggleAttribute("data-held", true);
    this.timer = setInterval(() => this.send(), EVERY_MS);
    this.send(); // which lets go, and ends the timer, if there is no connection
  }

  // A frame without a velocity lets go; it goes out whenever a holding ends.
  release() {
    if (!this.held) return;
    this.held.removeAttribute("data-held");
    this.held = null;
    clearInterval(this.timer);
    this.stream.send({ type: "jog" });
    if (!this.refused && !this.blocked) this.hint();
  }

  // The connection is lost, or no states come: the arm stops, and the person learns why.
  lose() {
    if (!this.held) return;
    this.release();
    this.refuse(() => word("reason_jog_silent"));
  }

  // For another robot.
  clear() {
    this.release();
    this.refused = this.blocked = false;
    this.hint();
  }

  send() {
    const { jog, index, sign } = this.held.dataset;
    const { share, override } = this.speeds;
    const velocity = (full, max) => Number(sign) * Math.min(share * full, max) * override;
    const frame = { type: "jog" };
    if (jog === "joint") {
      frame.joints = this.readouts.ranges.map((range, each) =>
        each === Number(index) ? velocity(1, MAX_SHARE) * range.max_velocity : 0,
      );
    } else {
      frame.twist = [0, 0, 0, 0, 0, 0];
      frame.twist[index] = index < 3 ? velocity(FULL_M_S, MAX_M_S) : velocity(FULL_RAD_S, MAX_RAD_S);
      frame.frame = element("jog-frame").value;
    }
    if (!this.stream.send(frame)) this.lose();
  }

  hear(frame) {
    if (frame.type === "jog" && this.held) {
      if (this.refused && frame.share === 0) return; // the service waits for the release
      this.refused = false;
      this.blocked = Boolean(frame.limited_by) && percentOf(frame) === 0;
      this.say(() => (frame.limited_by ? this.limited(frame) : word("jog_moves")));
    } else if (frame.type === "jog_ended" && frame.reason) this.refuse(() => word("jog_ended", { reason: whyOf(frame) }));
    else if (frame.type === "error" && frame.about === "jog") this.refuse(() => reasonOf(frame));
  }

  // The reason stays after the release, until the next press.
  refuse(words) {
    this.refused = true;
    this.say(words);
  }

  limited(frame) {
    const percent = percentOf(frame);
    const why = whyOf({ ...frame, reason: frame.limited_by });
    return word(percent ? "jog_limited" : "jog_blocked", { percent, why });
  }

  // An increment is a motion like any other: planned, checked, and refused with the reason. It starts from the
  // commanded position, because the errors of measured positions would add up.
  async step(button, angle, way) {
    const { jog, index, sign } = button.dataset;
    if (this.pending) return;
    const { state, geometry } = this.now();
    if (!state || !geometry) {
      this.say(() => word("silence"));
      return;
    }
    this.pending = true;
    this.say(() => word("jog_moves"));
    const joints = [...state.commanded_position];
    const speed = Math.min(this.speeds.share, MAX_SHARE);
    let why = null;
    const [turn, line] = [Number(sign) * angle * (Math.PI / 180), Number(sign) * way];
    try {
      if (jog === "joint") {
        joints[index] += geometry.joints[index].slides ? line : turn;
        why = await moved(this.api, "/move/joints", { joints, speed });
      } else {
        const goal = this.beside(tcpOf(geometry, joints), Number(index), turn, line);
        why = await moved(this.api, "/move/pose", { ...goal, planner: "lin", speed });
      }
      if (why) this.say(() => reasonOf(why));
      else this.hint();
    } catch (error) {
      this.say(() => reasonOf(error));
    } finally {
      this.pending = false;
    }
  }

  beside({ position, quaternion }, index, turn, line) {
    const step = [0, 0, 0, 0, 0, 0];
    step[index] = index < 3 ? line : turn;
    const goal = stepped(position, quaternion, step, element("jog-frame").value === "tool");
    const [x, y, z] = goal.position;
    const [a, b, c] = abcOf(goal.quaternion);
    return { x, y, z, a, b, c };
  }

  say(words) {
    speak("jog-why", words);
  }
}
