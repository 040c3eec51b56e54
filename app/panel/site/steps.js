// The steps of a sequence file: kinds, lists in each other, and numbers as the runner has them: "2.1" is the first
// step in step 2, "2.else.1" the first one of its `else`, "0" the way home. Pure functions, without a browser.
const KINDS = ["gripper", "press", "follow", "search", "insert", "set", "wait_for", "wait_s", "repeat", "if", "call", "pallet", "on_error"];
const MOTIONS = { joints: "joints", named: "named", angle: "arc", x: "pose" };
const STILL = ["gripper", "set", "wait_for", "wait_s"]; // the arm does not move in these
const MAX_PREVIEWED = 500;
export const POSE = ["x", "y", "z", "a", "b", "c"];
const isObject = (value) => typeof value === "object" && value !== null && !Array.isArray(value);
const isPart = (text) => /^[a-z]/.test(text ?? "");

// The kind of a step: one of KINDS, joints, named, arc, pose; "unknown" for a step of a newer version.
export function kindOf(step) {
  const has = (key) => Object.hasOwn(step, key);
  return KINDS.find(has) ?? MOTIONS[Object.keys(MOTIONS).find(has)] ?? "unknown";
}

export const isMotion = (step) => Object.values(MOTIONS).includes(kindOf(step));

// The lists of a step as [part, steps], in the order in which they are shown. The main list has the part "".
export function blocksOf(step) {
  switch (kindOf(step)) {
    case "repeat": case "pallet": return [["", step.do ?? []]];
    case "if": return [["", step.then ?? []], ["else", step.else ?? []]];
    case "on_error": return [["", step.do ?? []], ["run", step.on_error.run ?? []]];
    default: return [];
  }
}

export const rootOf = (content) => content.steps ?? content.waypoints;

// Whether a sequence can be shown as a tree: it has objects and lists in the right places.
export function isTree(content) {
  const whole = (list) => Array.isArray(list) && list.every((step) => isObject(step)
    && isObject(step.on_error ?? {}) && blocksOf(step).every(([, steps]) => whole(steps)));
  return isObject(content) && !(content.steps && content.waypoints) && isObject(content.home ?? {}) && whole(rootOf(content));
}

// A list by its id: "" is the outermost one, "2" the main list of step 2, "2.else" its other one; null for none.
// make: create a list that the step does not have yet.
function listAt(content, id, make = false) {
  const parts = id ? id.split(".") : [];
  let list = rootOf(content);
  while (parts.length) {
    const step = list?.[Number(parts.shift()) - 1];
    const part = isPart(parts[0]) ? parts.shift() : "";
    if (!step || !blocksOf(step).some(([name]) => name === part)) return null;
    const holder = part === "run" ? step.on_error : step;
    const key = part || (kindOf(step) === "if" ? "then" : "do");
    list = make ? (holder[key] ??= []) : holder[key];
  }
  return list ?? null;
}

// {id, index}: the list of a step and its place in it.
export function placeOf(number) {
  const parts = number.split(".");
  return { index: Number(parts.pop()) - 1, id: parts.join(".") };
}

export const numberIn = (id, index) => (id ? `${id}.${index + 1}` : String(index + 1));

export function stepAt(content, number) {
  if (number === "0") return content.home ?? null;
  const { id, index } = placeOf(number);
  return listAt(content, id)?.[index] ?? null;
}

// Each step with its number; a step comes before the steps in it.
export function* walk(list, id = "") {
  for (const [index, step] of list.entries()) {
    const number = numberIn(id, index);
    yield { number, step, id, index };
    for (const [part, steps] of blocksOf(step)) yield* walk(steps, part ? `${number}.${part}` : number);
  }
}

export function numberOf(content, step) {
  if (content.home === step) return "0";
  for (const each of walk(rootOf(content))) if (each.step === step) return each.number;
  return null;
}

// Adds a step to a list. A file with waypoints only becomes one with steps if needed.
export function insert(content, step, id, index) {
  if (content.waypoints && !isMotion(step)) {
    content.steps = content.waypoints;
    delete content.waypoints;
  }
  listAt(content, id, true).splice(index, 0, step);
}

export function remove(content, number) {
  if (number === "0") return void delete content.home;
  const { id, index } = placeOf(number);
  listAt(content, id).splice(index, 1);
}

// Whether the list is in the step itself: it cannot be moved there.
export const isWithin = (id, number) => id === number || id.startsWith(`${number}.`);

// Moves a step to the place before the current `index`.
export function move(content, number, id, index) {
  const from = placeOf(number);
  const [source, target] = [listAt(content, from.id), listAt(content, id, true)];
  const [step] = source.splice(from.index, 1);
  target.splice(source === target && index > from.index ? index - 1 : index, 0, step);
}

// The next place down or up in the order of the rows, also into and out of other steps; null at the end.
export function placeBeside(content, number, down) {
  const { id, index } = placeOf(number);
  const list = listAt(content, id);
  const beside = list[index + (down ? 1 : -1)];
  if (beside) {
    const blocks = blocksOf(beside);
    const [part, steps] = (down ? blocks[0] : blocks.at(-1)) ?? [];
    const inner = numberIn(id, index + (down ? 1 : -1));
    if (steps) return { id: part ? `${inner}.${part}` : inner, index: down ? 0 : steps.length };
    return { id, index: down ? index + 2 : index - 1 };
  }
  if (!id) return null;
  const owner = isPart(id.split(".").at(-1)) ? id.slice(0, id.lastIndexOf(".")) : id;
  const parts = blocksOf(stepAt(content, owner)).map(([part]) => part);
  const other = parts[parts.indexOf(id === owner ? "" : id.slice(owner.length + 1)) + (down ? 1 : -1)];
  if (other !== undefined) {
    const next = other ? `${owner}.${other}` : owner;
    return { id: next, index: down ? 0 : (listAt(content, next) ?? []).length };
  }
  const outer = placeOf(owner);
  return { id: outer.id, index: outer.index + (down ? 1 : 0) };
}

// Whether the arm may pass this step without a stop: another waypoint follows it.
export function canBlend(content, number) {
  if (number === "0") return Boolean(rootOf(content)[0] && isMotion(rootOf(content)[0]));
  const { id, index } = placeOf(number);
  const next = listAt(content, id)[index + 1];
  return Boolean(next && isMotion(next));
}

// The sequence for the runner: without radii where the arm stops, and without optional lists that are empty.
export function runnable(content) {
  const made = structuredClone(content);
  const numbers = [...(made.home ? ["0"] : []), ...[...walk(rootOf(made))].map((each) => each.number)];
  for (const number of numbers) {
    const step = stepAt(made, number);
    if (step.radius && isMotion(step) && !canBlend(made, number)) delete step.radius;
    if (step.else && !step.else.length) delete step.else;
    if (step.on_error?.run && !step.on_error.run.length) delete step.on_error.run;
  }
  return made;
}

// The motions that are known before the program runs: {home, waypoints, until}. `until` is the number of the first
// step whose result decides where the arm goes; null without one.
export function previewOf(content) {
  const waypoints = [];
  let until = null;
  const collect = (list, id) => list.every((step, index) => {
    const kind = kindOf(step);
    if (STILL.includes(kind)) return true;
    if (kind === "repeat" || kind === "on_error") return collect(step.do ?? [], numberIn(id, index));
    if (isMotion(step) && waypoints.length < MAX_PREVIEWED) return waypoints.push(step);
    until = numberIn(id, index);
    return false;
  });
  const made = runnable(content);
  collect(rootOf(made), "");
  return { home: made.home, waypoints, until };
}
