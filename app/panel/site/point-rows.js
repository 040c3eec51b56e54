// The rows of the list of waypoints: name, place, way, rounding, and what can be done with each.
import { PLANNERS } from "./planners.js";
import { word } from "./words.js";

const MAX_RADIUS_MM = 1000;
const MAX_NAME = 64;

function made(tag, text = "") {
  const element = document.createElement(tag);
  element.textContent = text;
  return element;
}

export function fileRow(list) {
  const { name, content } = list.file;
  const row = made("li");
  const count = (content.steps ?? content.waypoints).length;
  row.dataset.file = name;
  row.append(
    made("span", word(content.steps ? "steps_of_file" : "points_of_file", { name, count })),
    button(list, "✕", "points_close", 0, true, () => (list.file = null)),
  );
  return row;
}

export function pointRow(list, point, index) {
  const row = made("li");
  const last = list.list.length - 1;
  const [place, buttons] = [made("small", placeOf(point)), made("div")];
  buttons.append(
    button(list, "↑", "point_up", index, index > 0, () => list.swap(index, index - 1)),
    button(list, "↓", "point_down", index, index < last, () => list.swap(index, index + 1)),
    button(list, "✕", "point_remove", index, true, () => void list.list.splice(index, 1)),
    button(list, "⟳", "point_teach", index, true, () => list.teachAgain(index)),
    go(list, index),
  );
  row.append(made("span", index + 1), name(list, point, index), way(list, point, index), radius(list, point, index), place, buttons);
  return row;
}

// The TCP's place if it is known, or else the joints.
function placeOf({ pose, joints }) {
  const fixed = (value, scale) => (scale * value).toFixed(0).replace("-", "−");
  if (pose) return ["x", "y", "z"].map((axis, each) => `${axis} ${fixed(pose[each], 1000)}`).join("  ") + " mm";
  return joints.map((value) => fixed(value, 180 / Math.PI)).join("  ") + " °";
}

function name(list, point, index) {
  const input = made("input");
  Object.assign(input, { type: "text", maxLength: MAX_NAME, value: point.label ?? "", placeholder: word("point_of", { number: index + 1 }) });
  return changing(list, input, "point_name", index, () => (point.label = input.value.trim()));
}

function way(list, point, index) {
  const select = made("select");
  const there = Object.keys(PLANNERS).filter((each) => (PLANNERS[each].pose ? point.pose : point.joints));
  select.append(...there.map((each) => new Option(word(`way_${each}`, {}, `${PLANNERS[each].summary} (${each})`), each)));
  select.value = point.way;
  return changing(list, select, "point_way", index, () => (point.way = select.value));
}

function radius(list, point, index) {
  const [label, input] = [made("label"), made("input")];
  Object.assign(input, { type: "number", min: 0, max: MAX_RADIUS_MM, step: 1, value: point.radius });
  input.disabled = index === list.list.length - 1;
  changing(list, input, "point_radius", index, () => {
    point.radius = Math.max(0, Math.min(MAX_RADIUS_MM, Number(input.value)));
    input.value = point.radius;
  });
  label.append(input, " mm");
  return label;
}

function changing(list, control, name, index, change) {
  control.title = word(name, { number: index + 1 });
  control.setAttribute("aria-label", control.title);
  control.addEventListener("change", () => {
    change();
    list.edited();
  });
  return control;
}

function go(list, index) {
  const made = signed("▶", "point_go", index);
  made.addEventListener("click", () => list.go(index));
  return made;
}

function button(list, sign, name, index, enabled, act) {
  const made = signed(sign, name, index);
  made.disabled = !enabled;
  made.addEventListener("click", () => {
    const place = [...made.parentElement.children].indexOf(made);
    const there = act() ?? index;
    list.changed();
    list.focus(there, place);
  });
  return made;
}

function signed(sign, name, index) {
  const button = made("button", sign);
  button.type = "button";
  button.title = word(name, { number: index + 1 });
  button.setAttribute("aria-label", button.title);
  return button;
}
