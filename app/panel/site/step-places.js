// Waypoints: teaching them, moving to one, and previewing all of them.
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

  // The current joints and pose; null if they are unknown, and the reason is shown.
  here() {
    const { state, geometry } = this.now();
    // During hand guiding, the measured position counts and not the commanded one.
    const joints = this.freedrive.on ? state?.position : state?.commanded_position;
    if (!geometry || !numbers(joints, geometry.joints.length)) {
      this.page.say(() => word("silence"));
      return null;
    }
    return { joints: [...joints], pose: this.poseOf(joints) };
  }

  // The pose of the TCP at these joints; null while the model is unknown.
  poseOf(joints) {
    const { geometry } = this.now();
    if (!geometry || !numbers(joints, geometry.joints.length)) return null;
    const { position, quaternion } = tcpOf(geometry, joints);
    const values = [...position, ...abcOf(quaternion)];
    return Object.fromEntries(POSE.map((name, index) => [name, +values[index].toFixed(7)]));
  }

  // Whether the step has a position that can be taught again.
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

  // The motion to a waypoint. A planner that follows a TCP path needs a pose, which is computed from joints.
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

  // Plans and shows a motion to this waypoint at the speed of the slider. Nothing moves.
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

  // Plans all motions that are known before the program runs, as one.
  preview() {
    const { until, ...motions } = previewOf(this.page.program.content);
    if (until) this.page.say(() => word("preview_until", { number: until }));
    this.motions.through(this.page.program.document.label || word("program_unnamed"), () => partsOf(motions));
  }
}
