// Joints and TCP as numbers and bars, each with its two jog buttons. A number can be typed over, see typed.js.
import { inEachLanguage, word } from "./words.js";
import { setJoints, shortNames } from "./joint-names.js";
import { abcOf } from "./kinematics.js";

const AXES = ["X", "Y", "Z", "Rx", "Ry", "Rz"];
const TITLES = ["X, mm", "Y, mm", "Z, mm", "Rx (C), °", "Ry (B), °", "Rz (A), °"]; // with the letters of the requests
const NEAR = 0.03; // of the range, from a limit
const UNKNOWN = "?";
const number = (value) => value ?? NaN; // what is no number is null in JSON
const degrees = (rad) => (rad * 180) / Math.PI;

// One decimal. Neither -0.0 nor -180.0 is shown, which would alternate with 0.0 and 180.0 at rest.
function fixed(value) {
  return Number.isFinite(value) ? value.toFixed(1).replace(/^-(0\.0|180\.0)$/, "$1") : UNKNOWN;
}

function button(sign, kind, index) {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = sign > 0 ? "+" : "−";
  made.dataset.jog = kind;
  made.dataset.index = index;
  made.dataset.sign = sign;
  return made;
}

function field(kind, index) {
  const made = document.createElement("input");
  made.type = "text";
  made.inputMode = "decimal";
  made.autocomplete = "off";
  made.dataset.value = kind;
  made.dataset.index = index;
  return made;
}

function row(name, title, kind, index) {
  const [made, label] = ["div", "span"].map((tag) => document.createElement(tag));
  made.className = "row";
  label.textContent = name;
  label.title = title;
  const [less, value, more] = [button(-1, kind, index), field(kind, index), button(1, kind, index)];
  const meter = document.createElement("div");
  meter.className = "meter";
  meter.append(document.createElement("i"));
  made.append(label, less, ...(kind === "joint" ? [meter] : []), more, value);
  inEachLanguage(() => {
    less.setAttribute("aria-label", word("jog_less", { name: title }));
    more.setAttribute("aria-label", word("jog_more", { name: title }));
    value.setAttribute("aria-label", word("value_of", { name: title }));
  });
  return { made, meter, value };
}

// Not while it is typed over.
function write({ value }, text) {
  if (value !== document.activeElement && value.value !== text) value.value = text;
}

export class Readouts {
  constructor(joints, tcp) {
    this.place = joints;
    this.ranges = [];
    this.rows = [];
    this.aimed = null;
    this.tcp = AXES.map((name, index) => row(name, TITLES[index], "tcp", index));
    tcp.replaceChildren(...this.tcp.map((each) => each.made));
  }

  // Returns whether there are new buttons.
  describe(ranges) {
    if (JSON.stringify(ranges) === JSON.stringify(this.ranges)) return false;
    this.ranges = ranges;
    const full = ranges.map(({ name }) => name);
    const names = shortNames(full);
    setJoints(full);
    this.rows = ranges.map((range, index) => row(names[index], range.name, "joint", index));
    this.place.replaceChildren(...this.rows.map((each) => each.made));
    this.rows.forEach(({ meter }, index) => {
      const { name, slides, min_position: low, max_position: high } = ranges[index];
      const scale = slides ? 1000 : 180 / Math.PI;
      meter.setAttribute("role", "meter");
      meter.setAttribute("aria-label", name);
      meter.setAttribute("aria-valuemin", (low * scale).toFixed(1));
      meter.setAttribute("aria-valuemax", (high * scale).toFixed(1));
      meter.title = `${(low * scale).toFixed(1)} … ${(high * scale).toFixed(1)} ${slides ? "mm" : "°"}`;
    });
    return true;
  }

  show(state) {
    this.rows.forEach((each, index) => {
      const { slides, min_position: low, max_position: high } = this.ranges[index];
      const position = number(state.position[index]);
      const share = (value) => Math.max(0, Math.min(1, (value - low) / (high - low))) || 0;
      const shown = fixed(slides ? 1000 * position : degrees(position));
      write(each, `${shown} ${slides ? "mm" : "°"}`);
      each.meter.setAttribute("aria-valuenow", Number.isFinite(position) ? shown : "");
      const [from, to] = [share(0), share(position)];
      each.meter.style.setProperty("--zero", from.toFixed(4));
      each.meter.style.setProperty("--from", Math.min(from, to).toFixed(4));
      each.meter.style.setProperty("--share", Math.abs(to - from).toFixed(4));
      each.meter.toggleAttribute("data-near", Number.isFinite(position) && (to < NEAR || to > 1 - NEAR));
    });
    if (this.aimed) return;
    const [x, y, z, w, i, j, k] = state.tcp.map(number);
    this.showTcp([x, y, z], [i, j, k, w]);
  }

  // The TCP's numbers are those of a dragged target, a pose in the base frame; null: of the arm again.
  aim(target) {
    if (target === this.aimed) return;
    this.aimed = target;
    for (const { value } of this.tcp) value.toggleAttribute("data-aimed", target !== null);
    if (target) this.showTcp(target.position, target.quaternion);
  }

  showTcp(position, quaternion) {
    const angles = abcOf(quaternion).reverse();
    position.forEach((value, index) => write(this.tcp[index], fixed(1000 * value)));
    angles.forEach((value, index) => write(this.tcp[3 + index], fixed(degrees(value))));
  }
}
