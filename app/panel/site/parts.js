// The parts of a simulated cell and the objects of the scene, with their places. One is chosen in the list or in the
// picture. A motion above it or to its middle becomes the target of the TCP, as if the handles had been dragged there:
// it is planned and shown, and nothing moves before Execute.
import { multiply, rotate, upOf } from "./kinematics.js";
import { oneAtATime } from "./once.js";
import { reasonOf } from "./reasons.js";
import { inEachLanguage, word } from "./words.js";

const ABOVE_M = 0.1; // over the highest point
const CLICK_PX = 5; // farther, it was a turn of the camera
const LOOKED_AT = ["hello", "scene"];
const MM = 1000;
const element = (id) => document.getElementById(id);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const along = (position, axis, way) => position.map((each, index) => each + way * axis[index]);

// A turn about an axis of length 1, as a quaternion.
function turn(axis, angle) {
  return [...axis.map((each) => each * Math.sin(angle / 2)), Math.cos(angle / 2)];
}

// How far a solid reaches from its middle along an axis, m.
export function reachOf({ shape, size, quaternion: [x, y, z, w] }, axis) {
  const own = rotate([-x, -y, -z, w], axis);
  const [radius, length = 0] = size;
  const tilted = Math.sqrt(Math.max(0, 1 - own[2] ** 2));
  if (shape === "sphere") return radius;
  if (shape === "cylinder") return radius * tilted + (length / 2) * Math.abs(own[2]);
  if (shape === "capsule") return radius + (length / 2) * Math.abs(own[2]);
  return size.length === 3 ? own.reduce((sum, each, index) => sum + Math.abs(each) * size[index] / 2, 0) : 0;
}

// The TCP points straight down, turned as little as possible; over what has edges it is in line with one of them.
export function downwards(quaternion, up, { shape, quaternion: of }) {
  const tip = rotate(quaternion, [0, 0, 1]);
  const normal = cross(tip, up.map((each) => -each));
  const sine = Math.hypot(...normal);
  const axis = sine > 1e-9 ? normal.map((each) => each / sine) : rotate(quaternion, [1, 0, 0]);
  const down = multiply(turn(axis, Math.atan2(sine, -dot(tip, up))), quaternion);
  if (shape !== "box" && shape !== "mesh") return down;
  const edge = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((each) => rotate(of, each)).find((each) => Math.abs(dot(each, up)) < 0.7);
  const now = rotate(down, [1, 0, 0]);
  const angle = Math.atan2(dot(up, cross(now, edge)), dot(now, edge));
  return multiply(turn(up, angle - (Math.PI / 2) * Math.round(angle / (Math.PI / 2))), down);
}

export class Parts {
  // now: {state, geometry, view, drag, pull, freedrive}; the first three may be missing.
  constructor(api, now) {
    this.api = api;
    this.now = now;
    this.look = oneAtATime(() => this.ask());
    this.down = null; // where a pointer went down on the picture
    for (const each of ["positions", "parts"]) element(`places-${each}`).addEventListener("change", () => this.write());
    const place = element("view");
    place.addEventListener("pointerdown", (event) => this.press(event), { capture: true });
    place.addEventListener("pointerup", (event) => this.lift(event), { capture: true });
    element("cell-reset").addEventListener("click", () => this.putBack());
    this.clear();
    inEachLanguage(() => this.translate());
  }

  // Another robot was chosen.
  clear() {
    this.loose = this.objects = []; // {name, shape, size, position, quaternion}
    this.rows = new Map();
    this.choose("");
  }

  hear({ type }) {
    if (LOOKED_AT.includes(type)) this.look();
  }

  async ask() {
    const { robot } = this.api;
    const scene = await this.api.get("/scene").catch(() => null);
    if (!scene || robot !== this.api.robot) return;
    this.objects = scene.objects;
    this.write();
  }

  // The loose parts of the cell, as GET /cell has them.
  show(parts) {
    this.loose = parts.map(({ size_m: size, ...part }) => ({ ...part, size, loose: true }));
    this.write();
  }

  // What a part and a held object have in common is shown once.
  get all() {
    const parts = new Set(this.loose.map(({ name }) => name));
    return [...this.loose, ...this.objects.filter(({ name, attached }) => !attached && !parts.has(name))];
  }

  choose(name) {
    this.chosen = name;
    if (name) {
      element("places-parts").checked = true;
      this.rows.get(name)?.row.scrollIntoView({ block: "nearest" });
    }
    this.now().view?.pointing.choose(name);
    this.write();
  }

  // Rows are replaced only when others are there, because a finger may be on one.
  write() {
    const { all } = this;
    if (this.chosen && !all.some(({ name }) => name === this.chosen)) return void this.choose("");
    const names = all.map(({ name }) => name);
    if (names.join() !== [...this.rows.keys()].join()) {
      this.rows = new Map(all.map((each) => [each.name, this.row(each)]));
      element("cell-list").replaceChildren(...[...this.rows.values()].map(({ row }) => row));
      this.translate();
    }
    for (const { name, position } of all) {
      const { pick, where } = this.rows.get(name);
      const text = position.map((each) => (MM * each).toFixed(0).replace(/^-0$/, "0")).join("  ");
      if (where.textContent !== text) where.textContent = text;
      pick.setAttribute("aria-pressed", String(name === this.chosen));
    }
    const parts = names.length > 0 && element("places-parts").checked;
    element("places-of").hidden = !names.length;
    element("positions-title").hidden = names.length > 0;
    for (const id of ["positions", "position-fields"]) element(id).hidden = parts;
    for (const id of ["cell-list", "cell-unit"]) element(id).hidden = !parts;
    element("cell-reset").hidden = !parts || !this.loose.length;
  }

  // All parts, for the next run of a program.
  async putBack() {
    const failed = await this.api.post("/cell/reset").then(() => null, (error) => error);
    element("cell-why").textContent = failed ? reasonOf(failed) : "";
  }

  row({ name, loose }) {
    const [row, pick, where, above, middle] = ["li", "button", "span", "button", "button"].map((tag) => document.createElement(tag));
    for (const each of [pick, above, middle]) each.type = "button";
    pick.textContent = pick.title = name;
    pick.addEventListener("click", () => this.choose(this.chosen === name ? "" : name));
    above.addEventListener("click", () => this.plan(name, true));
    middle.addEventListener("click", () => this.plan(name, false));
    row.append(pick, where, above, ...(loose ? [middle] : []));
    return { row, pick, where, above, middle };
  }

  translate() {
    element("cell-reset").title = word("cell_reset_about");
    for (const [name, { above, middle }] of this.rows) {
      above.textContent = word("part_go_above");
      middle.textContent = word("part_go_to");
      above.title = word("part_go_above_about", { name, mm: MM * ABOVE_M });
      middle.title = word("part_go_to_about", { name });
    }
  }

  // Above it: around obstacles. To its middle: along a straight line.
  plan(name, isAbove) {
    const { state, geometry, drag } = this.now();
    const part = this.all.find((each) => each.name === name);
    if (!state || !geometry || !part) return;
    this.choose(name);
    const up = upOf(geometry);
    const quaternion = downwards(drag.pose(state, geometry).quaternion, up, part);
    const way = isAbove ? reachOf(part, up) + ABOVE_M : 0;
    drag.take({ position: along(part.position, up, way), quaternion }, isAbove ? `${name} + ${MM * ABOVE_M} mm` : name, isAbove ? "auto" : "lin");
  }

  // A press that turns nothing and holds nothing chooses what is under it.
  press({ button, isPrimary, clientX, clientY }) {
    const { drag, pull } = this.now();
    this.down = button === 0 && isPrimary && drag.pointer === null && !pull.held ? [clientX, clientY] : null;
  }

  lift(event) {
    const { down } = this;
    this.down = null;
    if (!down || document.body.dataset.page !== "move" || Math.hypot(event.clientX - down[0], event.clientY - down[1]) > CLICK_PX) return;
    const name = this.now().view?.pointing.pickThing(event);
    if (name && this.rows.has(name)) this.choose(name);
  }
}
