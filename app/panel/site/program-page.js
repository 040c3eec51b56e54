// The page Program: the steps of the open program, the actions for a step, and the program as text.
import { Complete } from "./complete.js";
import { Editor } from "./editor.js";
import { newStep, PLACED } from "./new-steps.js";
import { Program } from "./program.js";
import { StepForm } from "./step-form.js";
import { Places } from "./step-places.js";
import { StepTree } from "./step-tree.js";
import { nameOf } from "./step-words.js";
import { insert, move, numberIn, numberOf, placeBeside, placeOf, previewOf, remove, rootOf, stepAt } from "./steps.js";
import { WRITING } from "./stop.js";
import { inEachLanguage, word } from "./words.js";

const LINE = /line (\d+)/;
const element = (id) => document.getElementById(id);

export class ProgramPage {
  // now: {state, geometry}; either may be missing.
  constructor(api, motions, now, freedrive) {
    Object.assign(this, { api, motions, now });
    this.places = new Places(this, motions, now, freedrive);
    this.chosen = null; // the number of a step
    this.into = null; // the id of an empty list where the next step goes
    this.keepsRows = false; // a step changes that stays where it is
    this.listeners = [];
    this.words = () => word("steps_hint");
    this.program = new Program((other) => this.changed(other));
    this.tree = new StepTree(this);
    this.form = new StepForm(this, element("step-fields"));
    this.editor = new Editor(element("program-text"), element("program-lines"));
    this.complete = new Complete(element("program-text"), element("offers"), () => this.program.document.kind === "lua");
    this.listen();
    inEachLanguage(() => this.write());
  }

  listen() {
    const acts = {
      "program-undo": () => this.program.undo(), "program-redo": () => this.program.redo(), teach: () => this.teach(), preview: () => this.places.preview(),
      "step-up": () => this.shift(this.chosen, false), "step-down": () => this.shift(this.chosen, true),
      "step-copy": () => this.copy(), "step-remove": () => this.remove(this.chosen),
    };
    for (const [id, act] of Object.entries(acts)) element(id).addEventListener("click", act);
    for (const button of document.querySelectorAll("[data-add]")) button.addEventListener("click", () => this.add(button.dataset.add));
    for (const view of document.querySelectorAll("[name=program-view]")) view.addEventListener("change", () => this.write());
    element("program-name").addEventListener("input", (event) => this.program.type({ label: event.target.value }));
    element("program-text").addEventListener("input", () => this.program.type({ text: this.editor.text }));
    for (const id of ["program-name", "program-text"]) element(id).addEventListener("change", () => (this.program.typing = false));
    document.addEventListener("keydown", (event) => this.press(event));
  }

  load(robot) {
    this.say(() => word("steps_hint"));
    this.program.load(robot);
  }

  // heard: called after each change of the program.
  onChange(heard) {
    this.listeners.push(heard);
  }

  get step() {
    return this.chosen === null || !this.program.content ? null : stepAt(this.program.content, this.chosen);
  }

  get view() {
    return document.querySelector("[name=program-view]:checked").value;
  }

  show(view) {
    element(`view-${view}`).checked = true;
    this.write();
  }

  changed(other) {
    if (!this.form) return; // not yet
    if (other) {
      this.chosen = this.into = null;
      if (!this.program.content && this.view === "steps") element("view-text").checked = true;
      if (this.program.content && this.view === "text" && this.program.document.kind === "sequence") element("view-steps").checked = true;
    }
    if (!this.step) this.chosen = null;
    this.motions.discard();
    this.write(other);
    for (const heard of this.listeners) heard();
  }

  write(other = true) {
    const { document: { label, kind, text }, content, problem, done, undone } = this.program;
    if (element("program-name") !== document.activeElement) element("program-name").value = label;
    if (element("program-text") !== document.activeElement) this.editor.text = text;
    element("program-undo").disabled = !done.length;
    element("program-redo").disabled = !undone.length;
    for (const part of document.querySelectorAll("[data-part]")) part.hidden = !part.dataset.part.split(" ").includes(this.view);
    for (const part of document.querySelectorAll("[data-kind]")) part.hidden = part.dataset.kind !== kind;
    element("teach").disabled = element("add").inert = !content;
    element("preview").disabled = !content || !previewOf(content).waypoints.length;
    element("text-why").textContent = problem && kind === "sequence" ? word("text_wrong", { why: problem }) : "";
    if (this.keepsRows) this.tree.refresh();
    else this.tree.write();
    if (other || !this.form.place.contains(document.activeElement)) this.form.write();
    this.mark();
    this.say(this.words);
  }

  mark() {
    const { step } = this;
    const placed = step && this.chosen !== "0";
    element("step-title").textContent = step ? nameOf(step, this.chosen) : word("step_form");
    element("step-up").disabled = !placed || !placeBeside(this.program.content, this.chosen, false);
    element("step-down").disabled = !placed || !placeBeside(this.program.content, this.chosen, true);
    element("step-copy").disabled = !placed;
    element("step-remove").disabled = !step;
    element("step-form").toggleAttribute("data-empty", !step);
  }

  choose(number, into = null) {
    this.chosen = this.chosen === number && into === null ? null : number;
    this.into = into;
    this.tree.mark();
    this.form.write();
    this.mark();
  }

  teach() {
    const here = this.places.here();
    if (here) this.put({ joints: here.joints, speed: this.motions.speed });
  }

  // A new step that is not a waypoint.
  add(kind) {
    element("add").open = false;
    const here = PLACED.includes(kind) ? this.places.here() : {};
    if (!here) return;
    const step = newStep(kind, { ...here, speed: this.motions.speed, position: this.motions.positions[0]?.name ?? "" });
    if (kind === "home") this.program.edit((content) => (content.home = step));
    else this.put(step);
  }

  // After the chosen step, in the chosen empty list, or at the end.
  put(step) {
    const { content } = this.program;
    if (!content) return;
    const after = this.chosen && this.chosen !== "0" ? placeOf(this.chosen) : null;
    const id = this.into ?? after?.id ?? "";
    const index = this.into !== null ? 0 : after ? after.index + 1 : this.chosen === "0" ? 0 : rootOf(content).length;
    this.program.edit(() => insert(content, step, id, index));
    this.chosen = null;
    this.choose(numberIn(id, index));
    this.tree.find(this.chosen)?.scrollIntoView({ block: "nearest" });
  }

  editStep(number, change) {
    this.keepsRows = true;
    this.program.edit((content) => change(stepAt(content, number)));
    this.keepsRows = false;
  }

  // Moves steps. The chosen step stays chosen.
  arrange(change) {
    const { content } = this.program;
    const { step } = this;
    this.chosen = null;
    this.program.edit(() => change(content));
    this.chosen = step && numberOf(content, step);
    this.into = null;
    this.tree.mark();
    this.form.write();
    this.mark();
  }

  moveTo(number, id, index) {
    this.chosen = number;
    this.arrange((content) => move(content, number, id, index));
    this.tree.focus(this.chosen);
  }

  shift(number, down) {
    const place = number === "0" ? null : placeBeside(this.program.content, number, down);
    if (!place) return;
    const button = document.activeElement;
    this.moveTo(number, place.id, place.index);
    if (["step-up", "step-down"].includes(button.id) && !button.disabled) button.focus();
  }

  copy() {
    const copy = structuredClone(this.step);
    this.put(copy);
  }

  remove(number) {
    const rows = [...this.tree.list.querySelectorAll("[data-step]")].map((row) => row.dataset.step);
    const next = rows[rows.indexOf(number) + 1];
    this.chosen = null;
    this.program.edit((content) => remove(content, number));
    this.say(() => word("step_removed"));
    this.tree.focus(this.tree.find(number) ? number : next && this.tree.find(next) ? next : rows[rows.indexOf(number) - 1]);
  }

  rename(number) {
    if (this.chosen !== number) this.choose(number);
    element("step-label").select();
    element("step-label").focus();
  }

  // Marks the line that the reason names.
  markWrong(why) {
    const found = LINE.exec(why);
    if (found) this.editor.mark(Number(found[1]));
  }

  press(event) {
    const writes = event.target.closest?.(WRITING);
    if (document.body.dataset.page !== "program" || writes || !(event.ctrlKey || event.metaKey)) return;
    const key = event.key.toLowerCase();
    if (!["z", "y"].includes(key)) return;
    event.preventDefault();
    if (key === "y" || event.shiftKey) this.program.redo();
    else this.program.undo();
  }

  say(words) {
    this.words = words;
    element("program-why").textContent = words();
  }
}
