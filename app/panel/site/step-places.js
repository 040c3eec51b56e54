// Places of waypoints: taught where the arm is, gone to alone, and shown all together.
import { abcOf, tcpOf } from "./kinematics.js";
import { PLANNERS } from "./planners.js";
import { partsOf } from "./sequence.js";
import { nameOf } from "./step-words.js";
import { kindOf, placeOf, POSE, previewOf, stepAt } from "./steps.js";
import { word } from "./words.js";

const ON_THE_WAY = ["radius", "actions", "until", "start_when", "pause_while"]; // these need the program
const HERE = [undefined, "", "base"];
const numbers = (values, count) => Array.isArray(values) && values.length >= count && values.every(Number.isFinite);

export class Places {
  // page: the page Program. now: {state, geometry}, of which one may be missing.
  constructor(page, motions, now, freedrive) {
    Object.assign(this, { page, motions, now, freedrive });
  }

  // Where the arm is, as joints and as a pose; null, and said, if that is not known.
  here() {
    const { state, geometry } = this.now();
    // In a hand the arm is where it is held, and not where its springs would have it.
    const joints = this.freedrive.on ? state?.position : state?.commanded_position;
    if (!geometry || !numbers(joints, geometry.joints.length)) {
      this.page.say(() => word("silence"));
      return null;
    }
    return { joints: [...joints], pose: this.poseOf(joints) };
  }

  // The pose of the TCP at these joints, null while the arm is not known.
  poseOf(joints) {
    const { geometry } = this.now();
    if (!geometry || !numbers(joints, geometry.joints.length)) return null;
    const { position, quaternion } = tcpOf(geometry, joints);
    const values = [...position, ...abcOf(quaternion)];
    return Object.fromEntries(POSE.map((name, index) => [name, +values[index].toFixed(7)]));
  }

  // Whether the place of a step can be set to where the arm is.
  canTeach(step) {
    const kind = kindOf(step);
    if (kind === "pallet") return HERE.includes(step.pallet.origin?.frame_id);
    return kind === "joints" || (kind === "pose" && HERE.includes(step.frame_id));
  }

  teachAgain(number) {
    const here = this.here();
    if (!here) return;
    this.page.editStep(number, (step) => {
      if (step.pallet) Object.assign(step.pallet.origin, here.pose);
      else if (step.joints) step.joints = here.joints;
      else Object.assign(step, here.pose);
    });
    this.page.say(() => word("step_taught", { number }));
    if (this.page.chosen === number) this.page.form.write();
  }

  // The way to a waypoint. One that follows a path of the TCP ends at a pose, which is made of joints if need be.
  setWay(number, planner) {
    const { joints } = stepAt(this.page.program.content, number);
    const pose = joints && PLANNERS[planner]?.pose ? this.poseOf(joints) : {};
    if (!pose) return void this.page.say(() => word("silence"));
    this.page.editStep(number, (step) => {
      Object.assign(step, pose, { planner });
      if (pose.x !== undefined) delete step.joints;
    });
    this.page.form.write();
  }

  // Plans a motion to the waypoint alone, at the speed of the slider, and shows it; nothing moves.
  go(number) {
    const step = stepAt(this.page.program.content, number);
    if (this.isOfPallet(number, step.frame_id)) return this.page.say(() => word("step_in_pallet", { frame: step.frame_id }));
    const alone = { ...step, speed: this.motions.speed };
    for (const name of ON_THE_WAY) delete alone[name];
    return this.motions.through(nameOf(step, number), () => partsOf({ waypoints: [alone] }));
  }

  isOfPallet(number, frame) {
    for (let { id } = placeOf(number); id; id = placeOf(id).id) {
      const pallet = stepAt(this.page.program.content, id)?.pallet;
      if (pallet && (pallet.frame ?? "place") === frame) return true;
    }
    return false;
  }

  // All motions that are known before it runs, as one plan.
  preview() {
    const { until, ...motions } = previewOf(this.page.program.content);
    if (until) this.page.say(() => word("preview_until", { number: until }));
    this.motions.through(this.page.program.document.label || word("program_unnamed"), () => partsOf(motions));
  }
}
