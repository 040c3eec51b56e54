// A list of places that are taught, gone through with round corners, and kept as a sequence file.
// What is in the list is kept in this browser.
import { abcOf } from "./kinematics.js";
import { inEachLanguage, word } from "./words.js";

const MOST = 50; // of POST /robot/plan/sequence
const WAYS = ["ptp", "lin"];
const POSE = ["x", "y", "z", "a", "b", "c"];
const element = (id) => document.getElementById(id);
const numbers = (values, count) => Array.isArray(values) && values.length >= count && values.every(Number.isFinite);

// What the service plans: a straight line ends at a pose, every other way at joints.
function motion({ way, joints, pose }, speed) {
  if (way === "ptp") return { joints, speed };
  return { ...Object.fromEntries(POSE.map((name, index) => [name, pose[index]])), planner: "lin", speed };
}

export class Waypoints {
  constructor(motions, state) {
    this.motions = motions;
    this.state = state;
    this.key = "";
    this.list = [];
    element("teach").addEventListener("click", () => this.teach());
    element("points-show").addEventListener("click", () => this.show());
    element("points-save").addEventListener("click", () => this.save());
    this.acceptFiles(element("points").closest(".card"));
    inEachLanguage(() => this.write());
  }

  load(robot) {
    this.key = `cobot.waypoints.${robot}`;
    this.list = JSON.parse(localStorage.getItem(this.key) ?? "[]");
    this.write();
  }

  teach() {
    const state = this.state();
    if (!state) return;
    if (this.list.length >= MOST) {
      this.say("points_max");
      return;
    }
    const [x, y, z, w, i, j, k] = state.tcp;
    this.list.push({ way: "ptp", radius: 0, joints: [...state.commanded_position], pose: [x, y, z, ...abcOf([i, j, k, w])] });
    this.changed();
  }

  changed() {
    localStorage.setItem(this.key, JSON.stringify(this.list));
    this.motions.discard();
    this.write();
  }

  radii() {
    return this.list.slice(0, -1).map((point) => point.radius / 1000);
  }

  show() {
    this.motions.through(word("points_name"), (speed) => this.list.map((point) => motion(point, speed)), this.radii());
  }

  // As sequences/sequence.schema.json has it; opens again with all that is edited here.
  sequence() {
    const { speed } = this.motions;
    const radii = [...this.radii(), 0];
    return { waypoints: this.list.map((point, index) => ({ ...motion(point, speed), radius: radii[index] })) };
  }

  save() {
    const file = new Blob([JSON.stringify(this.sequence(), null, 1)], { type: "application/json" });
    const link = document.createElement("a");
    link.href = URL.createObjectURL(file);
    link.download = "sequence.json";
    link.click();
    URL.revokeObjectURL(link.href);
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
      if (file) this.open(await file.text());
    });
  }

  open(text) {
    try {
      const { waypoints, ...more } = JSON.parse(text);
      const list = waypoints.map((each) => this.opened(each));
      if (Object.keys(more).length || list.includes(null) || list.length > MOST) throw new Error("more");
      this.list = list;
      this.changed();
      this.say("points_hint");
    } catch {
      this.say("points_other");
    }
  }

  // null for what cannot be shown here without losing some of it.
  opened({ joints, planner = "ptp", radius = 0, speed, ...pose }) {
    if (!Number.isFinite(radius)) return null;
    const radiusMm = Math.round(1000 * radius);
    if (joints) {
      const whole = numbers(joints, 1) && planner === "ptp" && !Object.keys(pose).length;
      return whole ? { way: "ptp", radius: radiusMm, joints, pose: null } : null;
    }
    const values = POSE.map((name) => pose[name] ?? 0);
    const known = Object.keys(pose).every((name) => POSE.includes(name));
    return planner === "lin" && known && numbers(values, 6) ? { way: "lin", radius: radiusMm, joints: null, pose: values } : null;
  }

  write() {
    element("points").replaceChildren(...this.list.map((point, index) => this.row(point, index)));
    for (const id of ["points-show", "points-save"]) element(id).disabled = !this.list.length;
  }

  row(point, index) {
    const made = document.createElement("li");
    const label = document.createElement("span");
    label.textContent = index + 1;
    made.append(label, this.way(point, index), this.radius(point, index));
    made.append(
      this.button("↑", "point_up", index, index > 0, () => this.swap(index, index - 1)),
      this.button("↓", "point_down", index, index < this.list.length - 1, () => this.swap(index, index + 1)),
      this.button("✕", "point_remove", index, true, () => this.list.splice(index, 1)),
    );
    return made;
  }

  way(point, index) {
    const select = document.createElement("select");
    const there = WAYS.filter((way) => (way === "ptp" ? point.joints : point.pose));
    select.append(...there.map((way) => new Option(word(`way_${way}`), way)));
    select.value = point.way;
    return this.changing(select, "point_way", index, () => (point.way = select.value));
  }

  radius(point, index) {
    const input = document.createElement("input");
    Object.assign(input, { type: "number", min: 0, max: 1000, step: 1, value: point.radius });
    input.disabled = index === this.list.length - 1;
    return this.changing(input, "point_radius", index, () => (point.radius = Math.max(0, Math.min(1000, Number(input.value)))));
  }

  changing(control, name, index, change) {
    control.setAttribute("aria-label", word(name, { number: index + 1 }));
    control.addEventListener("change", () => {
      change();
      this.changed();
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
      act();
      this.changed();
    });
    return made;
  }

  swap(one, other) {
    [this.list[one], this.list[other]] = [this.list[other], this.list[one]];
  }

  say(name) {
    element("points-why").dataset.word = name;
    element("points-why").textContent = word(name);
  }
}
