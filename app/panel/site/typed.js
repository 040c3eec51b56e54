// A number of a joint or of the TCP, typed over: Enter plans the motion and shows it, a second Enter runs it.
import { withShortNames } from "./joint-names.js";
import { abcOf, tcpOf } from "./kinematics.js";
import { word } from "./words.js";

const POSE = ["x", "y", "z", "c", "b", "a"]; // in the order of the rows
const MM = 1000;
const RAD = Math.PI / 180;
const NUMBER = /^[+−-]?\d+(?:[.,]\d+)?(?: *(mm|°))?$/; // one comma or point: "1.234,5" could mean two numbers

// The number, or NaN for any other text, and for one with another unit than the field's.
export function numberOf(text, unit) {
  const found = NUMBER.exec(text.trim());
  if (!found || (found[1] ?? unit) !== unit) return NaN;
  return Number.parseFloat(text.trim().replace(",", ".").replace("−", "-"));
}

export class Typed {
  // now: {state, geometry, readouts}; either of the first two may be missing.
  constructor(motions, now) {
    this.motions = motions;
    this.now = now;
    this.planned = ""; // what the newest plan of a typed value is of
    this.plan = null; // that plan
    this.wanted = null; // the newest typed pose and the plan that was asked for it: {pose, asked}
    document.addEventListener("focusin", ({ target }) => target.dataset.value && target.select());
    document.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" || !event.target.dataset?.value) return;
      event.preventDefault();
      if (!event.repeat) this.enter(event.target);
    });
  }

  async enter(field) {
    const { value: kind, index } = field.dataset;
    const { state, geometry } = this.now();
    const typed = numberOf(field.value, this.unit(kind, Number(index), geometry));
    const asked = [kind, index, typed].join();
    if (asked === this.planned && this.plan && this.plan === this.motions.plan) {
      field.blur();
      await this.motions.execute();
      return;
    }
    if (!state || !geometry || !Number.isFinite(typed)) {
      this.motions.discard(); // Enter and Execute must not run what was typed before
      this.motions.say(() => word(state && geometry ? "typed_no_number" : "silence", { text: field.value }));
      return;
    }
    this.planned = asked;
    const name = `${withShortNames(field.closest(".row").firstElementChild.title)} ${field.value}`;
    const planned = kind === "joint"
      ? this.motions.toJoints(name, this.joints(state, geometry, Number(index), typed))
      : this.toPose(name, this.pose(state, geometry, Number(index), typed));
    this.plan = await planned;
    if (kind === "tcp" && this.plan?.path.length) this.now().readouts.aim(tcpOf(geometry, this.plan.path.at(-1).joints)); // for the next value
  }

  unit(kind, index, geometry) {
    const isLength = kind === "joint" ? geometry?.joints[index].slides : index < 3;
    return isLength ? "mm" : "°";
  }

  joints(state, geometry, index, typed) {
    const joints = [...state.commanded_position];
    joints[index] = geometry.joints[index].slides ? typed / MM : typed * RAD;
    return joints;
  }

  // The next value may be typed before this plan is there.
  async toPose(name, pose) {
    const planned = this.motions.toPose(name, pose);
    const wanted = { pose, asked: this.motions.asked };
    this.wanted = wanted;
    const plan = await planned;
    if (!plan && wanted === this.wanted) this.wanted = null;
    return plan;
  }

  // The pose that was typed before, as long as its plan is the newest one, with one value of it changed.
  pose(state, geometry, index, typed) {
    const { position, quaternion } = this.now().readouts.aimed ?? tcpOf(geometry, state.commanded_position);
    const [[x, y, z], [a, b, c]] = [position, abcOf(quaternion)];
    const before = this.wanted?.asked === this.motions.asked ? this.wanted.pose : { x, y, z, a, b, c };
    return { ...before, [POSE[index]]: index < 3 ? typed / MM : typed * RAD };
  }
}
