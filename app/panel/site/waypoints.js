// A list of taught waypoints, which is run as a sequence with round corners and can be saved as its file. This
// browser keeps the list. A sequence file with more than the list can express is shown and run as it is.
import { abcOf, tcpOf } from "./kinematics.js";
import { DEFAULT, PLANNERS } from "./planners.js";
import { fileRow, pointRow } from "./point-rows.js";
import { partsOf } from "./sequence.js";
import { keep, keptList } from "./store.js";
import { inEachLanguage, word } from "./words.js";

const MOST = 50;
const MOST_SHOWN = 10; // parts of a long sequence
const POSE = ["x", "y", "z", "a", "b", "c"];
const ENDS = ["finished", "failed", "cancelled", "interrupted"];
const element = (id) => document.getElementById(id);
const numbers = (values, count) => Array.isArray(values) && values.length >= count && values.every(Number.isFinite);

// Whether it can be a line of the list: joints, or a pose, or both.
function whole(point) {
  const { way, radius, joints, pose } = point ?? {};
  const planner = PLANNERS[way];
  return planner && (planner.pose ? numbers(pose, 6) : numbers(joints, 1)) && Number.isFinite(radius);
}

// The request to the service. A planner that follows a path ends at a pose, every other one at joints.
function motion({ way, joints, pose, label }, speed) {
  const named = label ? { label } : {};
  const goal = PLANNERS[way].pose ? Object.fromEntries(POSE.map((name, index) => [name, pose[index]])) : { joints };
  return { ...named, ...goal, planner: way, speed };
}

export class Waypoints {
  // now: {state, geometry}, of which one may be missing.
  constructor(api, motions, now, freedrive) {
    this.api = api;
    this.motions = motions;
    this.now = now;
    this.freedrive = freedrive;
    this.key = "";
    this.list = [];
    this.file = null; // {name, text, content}: shown in place of the list
    this.job = null; // that runs it
    this.words = () => word("points_hint");
    element("teach").addEventListener("click", () => this.teach());
    element("points-show").addEventListener("click", () => this.show());
    element("points-save").addEventListener("click", () => this.save());
    element("points-run").addEventListener("click", () => this.run());
    element("points-step").addEventListener("click", () => this.run(true));
    this.acceptFiles(element("points").closest(".card"));
    inEachLanguage(() => this.write());
  }

  load(robot) {
    this.key = `cobot.waypoints.${robot}`;
    this.list = keptList("localStorage", this.key).filter(whole).slice(0, MOST);
    this.file = this.job = null;
    this.say(() => word("points_hint"));
    this.write();
  }

  // Where the arm is, as joints and as a pose; null, and said, if that is not known.
  here() {
    const { state, geometry } = this.now();
    // In a hand the arm is where it is held, and not where its springs would have it.
    const joints = this.freedrive.on ? state?.position : state?.commanded_position;
    if (!geometry || !numbers(joints, geometry.joints.length)) {
      this.say(() => word("silence"));
      return null;
    }
    const { position, quaternion } = tcpOf(geometry, joints);
    return { joints: [...joints], pose: [...position, ...abcOf(quaternion)] };
  }

  teach() {
    const here = this.here();
    if (!here) return;
    if (this.list.length >= MOST) {
      this.say(() => word("points_max"));
      return;
    }
    this.file = null;
    this.list.push({ way: DEFAULT, radius: 0, label: "", ...here });
    this.changed();
  }

  // The place is where the arm is now; the way to it stays.
  teachAgain(index) {
    Object.assign(this.list[index], this.here() ?? {});
  }

  // Plans a motion to the waypoint alone, and shows it.
  go(index) {
    const { joints, pose, label } = this.list[index];
    const name = label || word("point_of", { number: index + 1 });
    if (joints) return this.motions.toJoints(name, joints);
    return this.motions.toPose(name, Object.fromEntries(POSE.map((axis, each) => [axis, pose[each]])));
  }

  changed() {
    this.edited();
    this.write();
  }

  // What the rows show already: they stay, and so does the focus.
  edited() {
    keep("localStorage", this.key, JSON.stringify(this.list));
    this.motions.discard();
  }

  // Who works by the keyboard stays where the row has gone to that was there.
  focus(index, place) {
    const row = element("points").children[Math.min(index, element("points").children.length - 1)];
    const control = row?.querySelectorAll("button")[place];
    const found = control?.disabled ? row.querySelector("button:enabled") : control;
    (found ?? element("teach")).focus();
  }

  show() {
    const cut = partsOf(this.sequence()).length > MOST_SHOWN;
    if (cut) this.say(() => word("points_first", { count: MOST * MOST_SHOWN }));
    this.motions.through(this.file?.name ?? word("points_name"), () => partsOf(this.sequence()).slice(0, MOST_SHOWN));
  }

  // As sequences/sequence.schema.json has it; opens again with all that is edited here.
  sequence() {
    if (this.file) return this.file.content;
    const { speed } = this.motions;
    const last = this.list.length - 1;
    return { waypoints: this.list.map((point, index) => ({ ...motion(point, speed), radius: index < last ? point.radius / 1000 : 0 })) };
  }

  get any() {
    return Boolean(this.file) || this.list.length > 0;
  }

  get text() {
    return this.file?.text ?? JSON.stringify(this.sequence(), null, 1);
  }

  save() {
    const file = new Blob([this.text], { type: "application/json" });
    const link = document.createElement("a");
    link.href = URL.createObjectURL(file);
    link.download = "sequence.json";
    link.click();
    URL.revokeObjectURL(link.href);
  }

  // As a job of the service, which goes on without this page; hold: it waits before its first motion.
  async run(hold = false) {
    const body = new FormData();
    body.append("config", new File([this.text], this.file?.name ?? "waypoints.json"));
    body.append("n_iterations", element("points-rounds").value || "1");
    body.append("delay_between_iterations", "0");
    body.append("hold", String(hold));
    this.motions.discard();
    try {
      this.job = (await this.api.post("/sequences/start?wait=false", body)).id;
      this.say(() => word(hold ? "points_steps" : "points_runs"));
      await this.look();
    } catch (error) {
      this.say(() => error.message);
    }
  }

  hear({ type, data }) {
    if (!this.job) return;
    if (type === "sequence" && data.what === "waypoint") this.mark(data.waypoint);
    if (type === "hello" || (type === "job" && data.job === this.job)) this.look();
  }

  // Whether it goes on: its end may have been heard of before its number was known here.
  async look() {
    const { job } = this;
    if (!job) return;
    const { state, error } = await this.api.get(`/jobs/${job}`).catch((problem) => ({ state: "failed", error: { detail: problem.message } }));
    if (job !== this.job || !ENDS.includes(state)) return;
    this.job = null;
    this.mark(0);
    this.say(() => (state === "finished" ? word("points_done") : error?.detail ?? word(`job_${state}`)));
  }

  // The waypoint that it goes to.
  mark(waypoint) {
    for (const [index, row] of [...element("points").children].entries()) {
      row.toggleAttribute("data-next", !this.file && index + 1 === waypoint);
    }
  }

  acceptFiles(card) {
    // What is dropped beside it must not take the place of this page.
    for (const kind of ["dragover", "drop"]) document.addEventListener(kind, (event) => event.preventDefault());
    card.addEventListener("dragover", (event) => {
      event.preventDefault();
      card.toggleAttribute("data-over", true);
    });
    card.addEventListener("dragleave", () => card.removeAttribute("data-over"));
    card.addEventListener("drop", async (event) => {
      event.preventDefault();
      card.removeAttribute("data-over");
      const file = event.dataTransfer.files[0];
      if (file) this.open(await file.text(), file.name);
    });
  }

  // What is in it is planned and shown at once; nothing moves. Steps decide only while they run: they are not shown.
  open(text, name) {
    let content = null;
    try { content = JSON.parse(text); } catch { /* said below */ }
    const { waypoints, ...more } = content ?? {};
    const items = more.steps ?? waypoints;
    if (!Array.isArray(items) || !items.length) return void this.say(() => word("points_none", { name }));
    if (more.steps) {
      this.file = { name, text, content };
      this.say(() => word("points_runs_only"));
      return void this.changed();
    }
    const list = waypoints.map((each) => this.opened(each ?? {}));
    const [speed, ...others] = new Set(waypoints.map((each) => each?.speed ?? 0.1));
    const editable = !Object.keys(more).length && !list.includes(null) && list.length <= MOST && !others.length;
    const taken = editable && this.motions.choosesSpeed(speed);
    this.file = taken ? null : { name, text, content };
    if (taken) this.list = list;
    this.say(() => word(taken ? "points_hint" : "points_as_it_is"));
    this.changed();
    this.show();
  }

  // null for what cannot be shown here without losing some of it.
  opened({ joints, planner = DEFAULT, radius = 0, speed, label = "", ...pose }) {
    if (!Number.isFinite(radius) || !PLANNERS[planner] || typeof label !== "string") return null;
    const radiusMm = Math.round(1000 * radius);
    if (joints) {
      const known = numbers(joints, 1) && !PLANNERS[planner].pose && !Object.keys(pose).length;
      return known ? { way: planner, radius: radiusMm, label, joints, pose: null } : null;
    }
    const values = POSE.map((name) => pose[name] ?? 0);
    const known = Object.keys(pose).every((name) => POSE.includes(name));
    return PLANNERS[planner].pose && known && numbers(values, 6) ? { way: planner, radius: radiusMm, label, joints: null, pose: values } : null;
  }

  write() {
    const rows = this.file ? [fileRow(this)] : this.list.map((point, index) => pointRow(this, point, index));
    element("points").replaceChildren(...rows);
    for (const id of ["points-save", "points-run", "points-step"]) element(id).disabled = !rows.length;
    element("points-show").disabled = !rows.length || Boolean(this.file?.content.steps);
    element("run-what").textContent = this.file?.name ?? (rows.length ? word("run_list", { count: rows.length }) : word("run_none"));
    this.say(this.words);
  }

  swap(one, other) {
    [this.list[one], this.list[other]] = [this.list[other], this.list[one]];
    return other;
  }

  say(words) {
    this.words = words;
    for (const id of ["points-why", "run-why"]) element(id).textContent = words();
  }
}
