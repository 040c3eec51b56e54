// The fields of the chosen step. Editing a field changes the step at once; Undo reverts it.
import { shortNames } from "./joint-names.js";
import { DEFAULT, PLANNERS } from "./planners.js";
import { canBlend, kindOf, POSE } from "./steps.js";
import { made } from "./step-tree.js";
import { wayName } from "./step-words.js";
import { word } from "./words.js";

const DEG = Math.PI / 180;
const MM = 0.001;
const SHARE = 0.01;
const AXES = ["x", "y", "z"];
const COMMANDS = ["release", "grasp", "move", "home", "stop"];
const TESTS = ["on", "off", "above", "below"];
const FORCES = ["press", "follow", "search", "insert"];
const MAX_NAME = 200;
const MAX_COMMENT = 1000;
const CONTROLS = "input, select, textarea";

export class StepForm {
  // page: see StepTree. place: the element for the fields.
  constructor(page, place) {
    this.page = page;
    this.place = place;
  }

  write() {
    const { step, number } = this;
    const focused = [...this.place.querySelectorAll(CONTROLS)].indexOf(document.activeElement);
    this.fill(step, number);
    if (focused >= 0) this.place.querySelectorAll(CONTROLS)[focused]?.focus();
  }

  fill(step, number) {
    this.place.replaceChildren();
    if (!step) return void this.place.append(made("p", word(this.page.program.content ? "step_choose" : "steps_as_text"), "hint"));
    const kind = kindOf(step);
    this.place.append(this.text("step_label", step.label ?? "", (text) => this.optional("label", text), { maxLength: MAX_NAME, id: "step-label" }));
    this.place.append(...(FIELDS[kind] ?? FIELDS.other)(this, step, number));
    this.place.append(this.text("step_comment", step.comment ?? "", (text) => this.optional("comment", text), { tag: "textarea", maxLength: MAX_COMMENT, rows: 2 }));
  }

  get number() {
    return this.page.chosen;
  }

  get step() {
    return this.page.step;
  }

  // Changes the step with a function.
  edit(change) {
    const { number } = this;
    this.page.editStep(number, change);
  }

  // A field that is omitted when it is empty.
  optional(name, value) {
    this.edit((step) => {
      if (value === "" || value === null || value === undefined) delete step[name];
      else step[name] = value;
    });
  }

  labelled(name, control, unit = "") {
    const label = made("label");
    const title = made("span", word(name));
    control.dataset.field = name;
    label.append(title, control);
    if (unit) title.append(` (${unit})`);
    return label;
  }

  text(name, value, change, { tag = "input", list = "", ...more } = {}) {
    const control = made(tag);
    if (tag === "input") control.type = "text";
    Object.assign(control, { spellcheck: false, autocomplete: "off", ...more, value });
    if (list) control.setAttribute("list", list);
    control.addEventListener("change", () => change(control.value.trim()));
    return this.labelled(name, control);
  }

  // A number in the unit of the panel; null if it is empty, where that is allowed.
  numeric(name, value, change, { unit = "", scale = 1, min = "", max = "", step = "any", empty = false, text = "" } = {}) {
    const control = made("input");
    const shown = (number) => (Number.isFinite(number) ? String(+(number / scale).toFixed(3)) : "");
    Object.assign(control, { type: "number", min, max, step, value: shown(value), required: !empty });
    control.addEventListener("change", () => {
      const number = control.valueAsNumber;
      if (control.checkValidity() && (empty || Number.isFinite(number))) change(Number.isFinite(number) ? +(number * scale).toFixed(9) : null);
      else control.reportValidity();
    });
    const label = this.labelled(name, control, unit);
    if (text) label.firstElementChild.textContent = text;
    return label;
  }

  choice(name, value, options, change) {
    const control = made("select");
    control.append(...options.map(([key, text]) => new Option(text, key)));
    control.value = value;
    control.addEventListener("change", () => change(control.value));
    return this.labelled(name, control);
  }

  tick(name, value, change) {
    const [label, control] = [made("label", "", "tick"), made("input")];
    Object.assign(control, { type: "checkbox", checked: value });
    control.dataset.field = name;
    control.addEventListener("change", () => change(control.checked));
    label.append(control, made("span", word(name)));
    return label;
  }

  group(name, ...parts) {
    const [group, title] = [made("fieldset"), made("legend", word(name))];
    group.append(title, ...parts);
    return group;
  }

  // An input of the robot and its required value. empty: no input is allowed too.
  condition(name, found, change, empty = false) {
    const { input = "", is, above, below } = found ?? {};
    const test = typeof is === "boolean" ? (is ? "on" : "off") : above !== undefined ? "above" : below !== undefined ? "below" : "on";
    const now = { input, test, value: above ?? below ?? 0 };
    const put = (fields) => {
      Object.assign(now, fields);
      const tests = { on: { is: true }, off: { is: false }, above: { above: now.value }, below: { below: now.value } };
      change(now.input || !empty ? { input: now.input, ...tests[now.test] } : null);
    };
    const typed = this.text("step_input", input, (text) => { put({ input: text }); this.write(); }, { list: "io-inputs", maxLength: MAX_NAME });
    if (empty && !input) return this.group(name, typed);
    const parts = [
      typed,
      this.choice("step_test", test, TESTS.map((each) => [each, word(`test_${each}`)]), (key) => { put({ test: key }); this.write(); }),
    ];
    if (["above", "below"].includes(test)) parts.push(this.numeric("step_value", now.value, (value) => put({ value })));
    return this.group(name, ...parts);
  }

  // A pose in mm and degrees.
  pose(name, pose, change) {
    return this.group(name, ...POSE.map((axis, index) => this.numeric("step_axis", pose[axis] ?? 0, (value) => change(axis, value), {
      text: axis.toUpperCase() + (index < 3 ? " (mm)" : " (°)"), scale: index < 3 ? MM : DEG,
    })));
  }

  joints(step) {
    const joints = this.page.now().geometry?.joints ?? [];
    const names = shortNames(joints.map(({ name }) => name));
    return this.group("joints", ...step.joints.map((value, index) => this.numeric("step_axis", value, (made) => this.edit((now) => (now.joints[index] = made)), {
      text: `${names[index] ?? `J${index + 1}`} (${joints[index]?.slides ? "mm" : "°"})`, scale: joints[index]?.slides ? MM : DEG,
    })));
  }

  // The planner, the speed and the blend radius of a waypoint.
  motion(step, number) {
    const { planner = DEFAULT } = step;
    const ways = kindOf(step) === "arc" ? [] : Object.keys(PLANNERS).filter((each) => kindOf(step) !== "named" || !PLANNERS[each].pose);
    if (!ways.includes(planner)) ways.unshift(planner);
    const parts = [
      this.choice("step_way", planner, ways.map((each) => [each, wayName(each)]), (key) => this.page.places.setWay(number, key)),
      this.numeric("step_speed", step.speed ?? 0.1, (value) => this.optional("speed", value), { unit: "%", scale: SHARE, min: 1, max: 100 }),
    ];
    if (canBlend(this.page.program.content, number)) {
      parts.push(this.numeric("step_radius", step.radius ?? 0, (value) => this.optional("radius", value || null), { unit: "mm", scale: MM, min: 0, max: 1000 }));
    }
    return kindOf(step) === "arc" ? parts.slice(1) : parts;
  }

  // All fields of a step as JSON, without its lists of steps.
  json(step, hidden = []) {
    const shown = Object.fromEntries(Object.entries(step).filter(([key]) => !["label", "comment", ...hidden].includes(key)));
    const label = this.text("step_fields", JSON.stringify(shown, null, 1), (text) => {
      const field = label.querySelector("textarea");
      try {
        const found = JSON.parse(text);
        if (kindOf(found) !== kindOf(step)) throw new SyntaxError(word("step_other_kind"));
        field.setCustomValidity("");
        this.edit((now) => {
          for (const key of Object.keys(shown)) delete now[key];
          Object.assign(now, found);
        });
      } catch (error) {
        field.setCustomValidity(error.message);
        field.reportValidity();
      }
    }, { tag: "textarea", rows: 7 });
    return [label];
  }
}

const FIELDS = {
  joints: (form, step, number) => [...form.motion(step, number), form.joints(step)],
  pose: (form, step, number) => [...form.motion(step, number), form.pose("tcp", step, (axis, value) => form.edit((now) => (now[axis] = value)))],
  named: (form, step, number) => [
    form.text("step_position", step.named, (text) => form.edit((now) => (now.named = text)), { list: "position-names", maxLength: MAX_NAME }), ...form.motion(step, number),
  ],
  arc: (form, step, number) => [...form.motion(step, number), ...form.json(step, ["speed", "radius"])],
  gripper: (form, { gripper }) => {
    const put = (name) => (value) => form.edit((now) => { if (value === null) delete now.gripper[name]; else now.gripper[name] = value; });
    const parts = [form.choice("step_command", gripper.command, COMMANDS.map((each) => [each, word(`gripper_do_${each}`)]), (command) => {
      form.edit((now) => (now.gripper = { command, ...(command === "move" ? { width: 0 } : {}) }));
      form.write();
    })];
    if (["move", "grasp"].includes(gripper.command)) {
      parts.push(form.numeric("gripper_width", gripper.width, put("width"), { unit: "mm", scale: MM, min: 0, empty: gripper.command === "grasp" }));
      parts.push(form.numeric("gripper_force", gripper.force, put("force"), { min: 0, empty: true }));
    }
    return parts;
  },
  set: (form, { set }) => {
    const kind = typeof set.value === "boolean" ? (set.value ? "on" : "off") : "number";
    const value = form.choice("step_value", kind, [["on", word("io_on")], ["off", word("io_off")], ["number", word("step_number")]], (key) => {
      form.edit((now) => (now.set.value = key === "number" ? 0 : key === "on"));
      form.write();
    });
    const number = kind === "number" ? [form.numeric("step_number", set.value, (found) => form.edit((now) => (now.set.value = found)))] : [];
    return [form.text("step_output", set.output, (text) => form.edit((now) => (now.set.output = text)), { list: "io-outputs", maxLength: MAX_NAME }), value, ...number];
  },
  wait_for: (form, step) => [
    form.condition("step_wait_for", step.wait_for, (found) => form.edit((now) => (now.wait_for = found))),
    form.numeric("step_timeout", step.timeout_s ?? 60, (value) => form.edit((now) => (now.timeout_s = value)), { unit: "s", min: 0, max: 86400 }),
  ],
  wait_s: (form, step) => [form.numeric("step_duration", step.wait_s, (value) => form.edit((now) => (now.wait_s = value)), { unit: "s", min: 0, max: 86400 })],
  repeat: (form, { repeat }) => {
    const put = (name) => (value) => form.edit((now) => { if (value === null) delete now.repeat[name]; else now.repeat[name] = value; });
    return [
      form.numeric("step_count", repeat.count, put("count"), { min: 1, max: 1e9, step: 1, empty: true }),
      form.condition("step_while", repeat.while, put("while"), true), form.condition("step_until", repeat.until, put("until"), true),
    ];
  },
  if: (form, step) => [form.condition("step_if", step.if, (found) => form.edit((now) => (now.if = found)))],
  call: (form, step) => [form.text("step_file", step.call, (text) => form.edit((now) => (now.call = text)), { maxLength: MAX_NAME })],
  pallet: (form, { pallet }) => [
    form.text("step_frame", pallet.frame ?? "place", (text) => form.edit((now) => (now.pallet.frame = text)), { maxLength: MAX_NAME }),
    form.pose("step_origin", pallet.origin, (axis, value) => form.edit((now) => (now.pallet.origin[axis] = value))),
    ...AXES.map((_, way) => direction(form, pallet, way)),
  ],
  on_error: (form, { on_error: recovery }) => [
    form.numeric("step_retry", recovery.retry ?? 0, (value) => form.edit((now) => (now.on_error.retry = value)), { min: 0, max: 1000, step: 1 }),
    form.tick("step_go_on", Boolean(recovery.go_on), (value) => form.edit((now) => (now.on_error.go_on = value))),
  ],
  other: (form, step) => form.json(step),
};
for (const each of FORCES) FIELDS[each] = FIELDS.other;

// One direction of a pallet: the number of places and the distance between them. An empty number means one place.
function direction(form, { counts, offsets }, way) {
  if (way > counts.length) return "";
  const put = (change) => form.edit(({ pallet }) => change(pallet));
  const count = form.numeric("step_places", counts[way], (value) => {
    put((now) => {
      if (value === null) [now.counts, now.offsets] = [now.counts.slice(0, way), now.offsets.slice(0, way)];
      else {
        now.counts[way] = value;
        now.offsets[way] ??= {};
      }
    });
    form.write();
  }, { min: 1, max: 10000, step: 1, empty: way > 0 });
  const apart = way < counts.length ? AXES.map((axis) => form.numeric("step_axis", offsets[way]?.[axis] ?? 0, (value) => put((now) => (now.offsets[way][axis] = value)), {
    text: `${axis.toUpperCase()} (mm)`, scale: MM,
  })) : [];
  const group = form.group("step_direction", count, ...apart);
  group.querySelector("legend").append(` ${way + 1}`);
  return group;
}
