// Joints and TCP as numbers and bars, each with its two jog buttons.
import { inEachLanguage, word } from "./words.js";
import { abcOf } from "./kinematics.js";

const AXES = ["X", "Y", "Z", "C, Rx", "B, Ry", "A, Rz"];
const NEAR = 0.03; // of the range, from a limit
const UNKNOWN = "?";
const fixed = (value) => (Number.isFinite(value) ? value.toFixed(1).replace(/^-(0\.0)$/, "$1") : UNKNOWN);
const number = (value) => value ?? NaN; // what is no number is null in JSON
const degrees = (rad) => (rad * 180) / Math.PI;

function button(sign, kind, index) {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = sign > 0 ? "+" : "−";
  made.dataset.jog = kind;
  made.dataset.index = index;
  made.dataset.sign = sign;
  return made;
}

function row(name, kind, index) {
  const made = document.createElement("div");
  const label = document.createElement("span");
  const meter = document.createElement("div");
  const fill = document.createElement("i");
  const value = document.createElement("b");
  made.className = "row";
  label.textContent = label.title = name;
  meter.className = kind === "joint" ? "meter" : "meter plain";
  meter.append(fill, value);
  const [less, more] = [button(-1, kind, index), button(1, kind, index)];
  made.append(label, less, meter, more);
  inEachLanguage(() => {
    less.setAttribute("aria-label", word("jog_less", { name }));
    more.setAttribute("aria-label", word("jog_more", { name }));
  });
  return { made, meter, fill, value };
}

function write(shown, text) {
  if (shown.textContent !== text) shown.textContent = text;
}

export class Readouts {
  constructor(joints, tcp) {
    this.place = joints;
    this.ranges = [];
    this.rows = [];
    this.tcp = AXES.map((name, index) => row(name, "tcp", index));
    tcp.replaceChildren(...this.tcp.map((each) => each.made));
  }

  describe(ranges) {
    if (JSON.stringify(ranges) === JSON.stringify(this.ranges)) return;
    this.ranges = ranges;
    this.rows = ranges.map((range, index) => row(range.name, "joint", index));
    this.place.replaceChildren(...this.rows.map((each) => each.made));
    this.rows.forEach((each, index) => {
      const { name, slides, min_position: low, max_position: high } = ranges[index];
      const scale = slides ? 1000 : 180 / Math.PI;
      each.meter.setAttribute("role", "meter");
      each.meter.setAttribute("aria-label", name);
      each.meter.setAttribute("aria-valuemin", (low * scale).toFixed(1));
      each.meter.setAttribute("aria-valuemax", (high * scale).toFixed(1));
    });
  }

  show(state) {
    this.rows.forEach((each, index) => {
      const { slides, min_position: low, max_position: high } = this.ranges[index];
      const position = number(state.position[index]);
      const share = Math.max(0, Math.min(1, (position - low) / (high - low))) || 0;
      const shown = fixed(slides ? 1000 * position : degrees(position));
      write(each.value, `${shown} ${slides ? "mm" : "°"}`);
      each.meter.setAttribute("aria-valuenow", Number.isFinite(position) ? shown : "");
      each.fill.style.setProperty("--share", share.toFixed(4));
      each.meter.toggleAttribute("data-near", Number.isFinite(position) && (share < NEAR || share > 1 - NEAR));
    });
    const [x, y, z, w, i, j, k] = state.tcp.map(number);
    const angles = abcOf([i, j, k, w]).reverse();
    [x, y, z].forEach((value, index) => write(this.tcp[index].value, `${fixed(1000 * value)} mm`));
    angles.forEach((value, index) => write(this.tcp[3 + index].value, `${fixed(degrees(value))} °`));
  }
}
