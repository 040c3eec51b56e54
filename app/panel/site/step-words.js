// A step as it is shown: symbol, name and one line that describes it.
import { DEFAULT, PLANNERS } from "./planners.js";
import { blocksOf, kindOf } from "./steps.js";
import { word } from "./words.js";

const SVG = "http://www.w3.org/2000/svg";
const SHAPES = {
  joints: "M5 20 12 4l7 16-7-4z", pose: "M5 20 12 4l7 16-7-4z", home: "M4 11l8-7 8 7v9H4z", named: "M12 21s-6-6-6-11a6 6 0 0 1 12 0c0 5-6 11-6 11zM12 8v4",
  arc: "M4 18a8 8 0 0 1 16 0M17 15l3 3 2-4", gripper: "M12 3v4M6 21v-6l-2-4 4-4h8l4 4-2 4v6", press: "M12 3v12M7 11l5 5 5-5M4 21h16",
  follow: "M4 20h16M4 14c4 0 4-8 8-8s4 8 8 8", search: "M11 4a7 7 0 1 0 0 14 7 7 0 0 0 0-14zM16 16l5 5", insert: "M12 2v11M8 9l4 4 4-4M4 12v8h5v-4h6v4h5v-8",
  set: "M12 3v9M6.5 6.500a8 8 0 1 0 11 0", wait_for: "M3 12h10M9 8l4 4-4 4M17 4v16M21 4v16", wait_s: "M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18zM12 7v5l3 3",
  repeat: "M17 2l4 4-4 4M3 11V9a3 3 0 0 1 3-3h15M7 22l-4-4 4-4M21 13v2a3 3 0 0 1-3 3H3", if: "M12 3v6M12 9l-7 6v6M12 9l7 6v6",
  call: "M6 3h9l4 4v14H6zM14 3v5h5", pallet: "M4 4h6v6H4zM14 4h6v6h-6zM4 14h6v6H4zM14 14h6v6h-6z", on_error: "M12 4l9 16H3zM12 10v4M12 17v1",
  unknown: "M5 12h1M12 12h1M19 12h1",
};
const POSE = ["x", "y", "z"];
const NAMES = ["label", "comment"];

export function symbol(kind) {
  const [svg, path] = ["svg", "path"].map((tag) => document.createElementNS(SVG, tag));
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("aria-hidden", "true");
  svg.dataset.kind = kind;
  path.setAttribute("d", SHAPES[kind] ?? SHAPES.unknown);
  svg.append(path);
  return svg;
}

export const nameOf = (step, number) => step.label || (number === "0" ? word("step_home") : step.named) || word(`step_${kindOf(step)}`);

const whole = (value, scale) => (scale * value).toFixed(0).replace("-", "−").replace(/^−0$/, "0");
const placeText = (pose) => `${POSE.map((axis) => `${axis} ${whole(pose[axis] ?? 0, 1000)}`).join("  ")} mm`;

// An input and what it must be.
function conditionText({ input = "", is, above, below } = {}) {
  if (typeof is === "boolean") return word(is ? "say_is_on" : "say_is_off", { input });
  return above === undefined ? word("say_below", { input, value: below ?? "?" }) : word("say_above", { input, value: above });
}

export const wayName = (planner) => word(`way_${planner}`, {}, PLANNERS[planner]?.summary ?? planner);

// name: shown above the line. poseOf: returns {x, y, z} for joints, or null while the model is unknown.
export function lineOf(step, name, poseOf) {
  const kind = kindOf(step);
  const made = LINES[kind]?.(step, poseOf, name) ?? Object.keys(step).filter((key) => !NAMES.includes(key)).join(", ");
  return [made, step.comment].filter(Boolean).join(" — ");
}

function motion(step, place) {
  const { planner = DEFAULT, speed = 0.1, speed_m_s: fast, radius } = step;
  const pace = fast ? `${whole(fast, 1000)} mm/s` : `${whole(speed, 100)} %`;
  const frame = step.frame_id ? word("say_frame", { frame: step.frame_id }) : "";
  return [wayName(planner), place, frame, pace, radius ? word("say_blend", { mm: whole(radius, 1000) }) : ""].filter(Boolean).join(" · ");
}

const LINES = {
  joints: (step, poseOf) => motion(step, poseText(step.joints, poseOf)),
  named: (step, _, name) => motion(step, name === step.named ? "" : step.named),
  pose: (step) => motion(step, placeText(step)),
  arc: (step) => motion({ planner: "arc", ...step }, `${whole(step.angle, 180 / Math.PI)}°`),
  gripper: ({ gripper: { command, width, force } = {} }) => [
    word(`gripper_do_${command}`, {}, command), width === undefined || width === null ? "" : `${whole(width, 1000)} mm`, force ? `${force} N` : "",
  ].filter(Boolean).join(" · "),
  set: ({ set: { output = "", value } = {} }) => `${output} = ${typeof value === "boolean" ? word(value ? "io_on" : "io_off") : value}`,
  wait_for: (step) => word("say_wait_for", { condition: conditionText(step.wait_for), seconds: step.timeout_s ?? 60 }),
  wait_s: ({ wait_s: seconds }) => `${seconds} s`,
  repeat: ({ repeat: { count, while: during, until } = {} }) => [
    count ? word("say_times", { count }) : "", during ? word("say_while", { condition: conditionText(during) }) : "",
    until ? word("say_until", { condition: conditionText(until) }) : "", count || during || until ? "" : word("say_endless"),
  ].filter(Boolean).join(" · "),
  if: (step) => conditionText(step.if),
  call: ({ call }) => call,
  pallet: ({ pallet: { counts = [], origin = {} } = {} }) => `${counts.join(" × ")} · ${placeText(origin)}`,
  on_error: ({ on_error: { retry = 0, go_on: goesOn } }) => word(goesOn ? "say_retry_go_on" : "say_retry", { count: retry }),
};

function poseText(joints, poseOf) {
  const pose = poseOf(joints);
  return pose ? placeText(pose) : `${joints.map((value) => whole(value, 180 / Math.PI)).join("  ")} °`;
}

// The heading of a list that is not the main one of its step, and the text in an empty list.
export const partName = (step, part) => word(part ? `part_${part}` : blocksOf(step).length > 1 ? `part_${kindOf(step)}` : "part_do");
