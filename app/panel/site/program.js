// The program that is open: a tree of steps or a text, what it was saved as, and what can be undone. This browser
// keeps it, so what is not saved yet is not lost with the page.
import { isTree, rootOf, runnable } from "./steps.js";
import { keep, keptText } from "./store.js";

const MAX_UNDONE = 100;
const KINDS = ["sequence", "lua"];
const NEW = { kind: "sequence", text: '{"steps":[]}', label: "", id: null, version: null, saved: null };

export class Program {
  // changed: called after each change, with true if another program or version is shown now.
  constructor(changed) {
    this.changed = changed;
    this.key = "";
    this.opened = 0; // counts programs: a step back never gives one program the version of another one
    this.show({ ...NEW });
  }

  // Loads what this browser has stored for a robot.
  load(robot) {
    this.key = `cobot.program.${robot}`;
    let kept = null;
    try { kept = JSON.parse(keptText("localStorage", this.key)); } catch { /* as if there were nothing */ }
    const whole = typeof kept?.text === "string" && typeof kept.label === "string" && KINDS.includes(kept.kind);
    this.show({ ...NEW, ...(whole ? kept : {}) });
    this.changed(true);
  }

  show(document) {
    this.opened += 1;
    this.document = { ...document, opened: this.opened };
    [this.done, this.undone] = [[], []];
    this.read();
  }

  // The steps of the text, null if it is a program in Lua or cannot be shown as a tree.
  read() {
    this.content = null;
    this.typing = false;
    this.problem = "";
    if (this.document.kind === "lua") return;
    try {
      const found = JSON.parse(this.document.text);
      if (isTree(found)) this.content = found;
    } catch (error) {
      this.problem = error.message;
    }
  }

  get isEmpty() {
    return this.content ? !rootOf(this.content).length && !this.content.home : !this.document.text.trim();
  }

  // Whether it differs from the version of the service.
  get isChanged() {
    const { saved } = this.document;
    return saved === null ? !this.isEmpty : saved !== this.state;
  }

  // Whether it is a copy of an example in which nothing was changed yet.
  get isExample() {
    const { id, copied } = this.document;
    return !id && copied?.state === this.state;
  }

  get state() {
    return JSON.stringify([this.document.label, this.document.text]);
  }

  // The text that is run and saved.
  get text() {
    return this.content ? JSON.stringify(runnable(this.content), null, 1) : this.document.text;
  }

  get fileName() {
    const name = this.document.label.replace(/[\\/:*?"<>|]/g, "_") || "program";
    return `${name}.${this.document.kind === "lua" ? "lua" : "json"}`;
  }

  // Changes the steps with a function. One undo reverts it.
  edit(change) {
    const before = this.document;
    change(this.content);
    this.put({ ...before, text: JSON.stringify(this.content, null, 1) }, before);
    this.changed(false);
  }

  // A text or a name that is being typed. One undo reverts what was typed without a pause.
  type(fields) {
    const before = this.typing ? null : this.document;
    this.put({ ...this.document, ...fields }, before);
    this.read();
    this.typing = true;
    this.changed(false);
  }

  // Replaces this program. Undo brings back a program that was not saved.
  // example: the id of the example that it copies; null for none.
  open({ kind, text, label, id = null, version = null, example = null }) {
    const before = this.isChanged ? this.document : null;
    this.opened += 1;
    this.put({ kind, text, label, id, version, saved: null, opened: this.opened }, before);
    if (!before) this.done = [];
    this.read();
    if (id) this.document.saved = this.state;
    if (typeof example === "string") this.document.copied = { id: example, state: this.state };
    this.keep();
    this.changed(true);
  }

  // The same steps as a new program that is not stored yet.
  becomeNew(label) {
    this.opened += 1;
    this.put({ ...this.document, label, id: null, version: null, saved: null, opened: this.opened }, null);
    this.changed(true);
  }

  startNew(kind) {
    this.open({ ...NEW, kind, text: kind === "lua" ? "" : NEW.text });
  }

  put(document, before) {
    if (before) this.done = [...this.done, before].slice(-MAX_UNDONE);
    this.undone = [];
    this.typing = false;
    this.document = document;
    this.keep();
  }

  // The service has stored this state, of the program with this number, as a version.
  savedAs({ id, version }, { state, opened }) {
    if (opened !== this.document.opened) return;
    Object.assign(this.document, { id, version, saved: state });
    this.keep();
    this.changed(false);
  }

  undo() {
    this.step("done", "undone");
  }

  redo() {
    this.step("undone", "done");
  }

  step(from, to) {
    const found = this[from].pop();
    if (!found) return;
    const { id, version, saved, opened } = this.document;
    this[to].push(this.document);
    // Undo reverts edits only, not what was saved.
    this.document = found.opened === opened ? { ...found, id, version, saved } : found;
    this.read();
    this.keep();
    this.changed(true);
  }

  keep() {
    keep("localStorage", this.key, JSON.stringify(this.document));
  }
}
