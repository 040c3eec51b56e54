// A list of places that are taught, gone through with round corners, run as a sequence and kept as its file.
// What is in the list is kept in this browser. A sequence that has more than the list can say is shown and run
// as it is.
import { abcOf, tcpOf } from "./kinematics.js";
import { DEFAULT, PLANNERS } from "./planners.js";
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
function motion({ way, joints, pose }, speed) {
  const goal = PLANNERS[way].pose ? Object.fromEntries(POSE.map((name, index) => [name, pose[index]])) : { joints };
  return { ...goal, planner: way, speed };
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

  teach() {
    const { state, geometry } = this.now();
    // In a hand the arm is where it is held, and not where its springs would have it.
    const joints = this.freedrive.on ? state?.position : state?.commanded_position;
    if (!geometry || !numbers(joints, geometry.joints.length)) {
      this.say(() => word("silence"));
      return;
    }
    if (this.list.length >= MOST) {
      this.say(() => word("points_max"));
      return;
    }
    const { position, quaternion } = tcpOf(geometry, joints);
    this.file = null;
    this.list.push({ way: DEFAULT, radius: 0, joints: [...joints], pose: [...position, ...abcOf(quaternion)] });
    this.changed();
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
    const control = row?.children[place];
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
  opened({ joints, planner = DEFAULT, radius = 0, speed, ...pose }) {
    if (!Number.isFinite(radius) || !PLANNERS[planner]) return null;
    const radiusMm = Math.round(1000 * radius);
    if (joints) {
      const known = numbers(joints, 1) && !PLANNERS[planner].pose && !Object.keys(pose).length;
      return known ? { way: planner, radius: radiusMm, joints, pose: null } : null;
    }
    const values = POSE.map((name) => pose[name] ?? 0);
    const known = Object.keys(pose).every((name) => POSE.includes(name));
    return PLANNERS[planner].pose && known && numbers(values, 6) ? { way: planner, radius: radiusMm, joints: null, pose: values } : null;
  }

  write() {
    const rows = this.file ? [this.fileRow(this.file)] : this.list.map((point, index) => this.row(point, index));
    element("points").replaceChildren(...rows);
    for (const id of ["points-save", "points-run", "points-step"]) element(id).disabled = !rows.length;
    element("points-show").disabled = !rows.length || Boolean(this.file?.content.steps);
    element("points-why").textContent = this.words();
  }

  fileRow({ name, content }) {
    const made = document.createElement("li");
    const label = document.createElement("span");
    const count = (content.steps ?? content.waypoints).length;
    label.textContent = word(content.steps ? "steps_of_file" : "points_of_file", { name, count });
    made.dataset.file = name;
    made.append(label, this.button("✕", "points_close", 0, true, () => (this.file = null)));
    return made;
  }

  row(point, index) {
    const made = document.createElement("li");
    const label = document.createElement("span");
    label.textContent = index + 1;
    made.append(label, this.way(point, index), this.radius(point, index));
    made.append(
      this.button("↑", "point_up", index, index > 0, () => this.swap(index, index - 1)),
      this.button("↓", "point_down", index, index < this.list.length - 1, () => this.swap(index, index + 1)),
      this.button("✕", "point_remove", index, true, () => void this.list.splice(index, 1)),
    );
    return made;
  }

  way(point, index) {
    const select = document.createElement("select");
    const there = Object.keys(PLANNERS).filter((way) => (PLANNERS[way].pose ? point.pose : point.joints));
    select.append(...there.map((way) => new Option(word(`way_${way}`, {}, `${PLANNERS[way].summary} (${way})`), way)));
    select.value = point.way;
    return this.changing(select, "point_way", index, () => (point.way = select.value));
  }

  radius(point, index) {
    const input = document.createElement("input");
    Object.assign(input, { type: "number", min: 0, max: 1000, step: 1, value: point.radius });
    input.disabled = index === this.list.length - 1;
    return this.changing(input, "point_radius", index, () => {
      point.radius = Math.max(0, Math.min(1000, Number(input.value)));
      input.value = point.radius;
    });
  }

  changing(control, name, index, change) {
    control.title = word(name, { number: index + 1 });
    control.setAttribute("aria-label", control.title);
    control.addEventListener("change", () => {
      change();
      this.edited();
    });
    return control;
  }

  button(sign, name, index, enabled, act) {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = sign;
    made.disabled = !enabled;
    made.setAttribute("aria-label", word(name, { number: index + 1 }));
    made.addEventListener("click", () => {
      const place = [...made.parentElement.children].indexOf(made);
      const there = act() ?? index;
      this.changed();
      this.focus(there, place);
    });
    return made;
  }

  swap(one, other) {
    [this.list[one], this.list[other]] = [this.list[other], this.list[one]];
    return other;
  }

  say(words) {
    this.words = words;
    element("points-why").textContent = words();
  }
}
