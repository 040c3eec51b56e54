// A list of named things with a form for the chosen one. Its subclasses say what the things are.
import { allow } from "./able.js";
import { ID } from "./ids.js";
import { abcOf } from "./kinematics.js";
import { changed, poseFields } from "./numbers.js";
import { reasonOf } from "./reasons.js";
import { inEachLanguage, speak, word } from "./words.js";

const ORIGIN = [0, 0, 0, 0, 0, 0];
const element = (id) => document.getElementById(id);
const poseOf = ({ position, quaternion }) => [...position, ...abcOf(quaternion)];

export class PlacedList {
  // kind: "object" or "frame", the beginning of all ids. list: the id of the list.
  // tcp: returns the pose of the TCP in the base frame, null while it is unknown.
  constructor(api, kind, list, tcp) {
    Object.assign(this, { api, kind, tcp, list: element(list), all: [], chosen: null, turn: Promise.resolve() });
    this.place = poseFields(this.part("place"));
    this.part("new").addEventListener("click", () => this.choose(null));
    this.part("here").addEventListener("click", () => this.placeHere());
    this.part("delete").addEventListener("click", () => this.afterwards(() => this.remove()));
    element(kind).addEventListener("submit", (event) => {
      event.preventDefault();
      this.afterwards(() => this.save());
    });
    inEachLanguage(() => this.write());
  }

  // When what was asked before has ended: its answer would replace the one of this.
  afterwards(work) {
    this.turn = this.turn.then(work, work);
  }

  part(name) {
    return element(`${this.kind}-${name}`);
  }

  // Shows the current state of the service. A form that is being edited does not change.
  offer(all) {
    this.all = all;
    const now = this.chosen ? all.find(({ name }) => name === this.chosen.name) : null;
    if (!this.typed) this.show(now ?? null);
    else if (!now) this.mark(null);
    this.write();
  }

  get typed() {
    return this.place.changed || changed(this.part("name"));
  }

  choose(one) {
    this.show(one);
    this.say(() => "");
    this.write();
  }

  show(one) {
    this.part("name").value = this.part("name").defaultValue = one?.name ?? "";
    this.place.set(one ? poseOf(one) : ORIGIN);
    this.mark(one);
  }

  mark(one) {
    this.chosen = one;
    allow(this.part("delete"), one ? "" : "why_none_chosen");
  }

  placeHere() {
    const pose = this.tcp();
    if (pose) this.place.type(poseOf(pose));
    else this.say(() => word("silence"), "warn");
  }

  // The fields as in a request; null if one of them is invalid, and the reason is shown.
  read() {
    const name = this.part("name").value.trim();
    const [x, y, z, a, b, c] = this.place.values();
    if (!ID.test(name)) this.say(() => word("name_letters"), "warn");
    else if (![x, y, z, a, b, c].every(Number.isFinite)) this.say(() => word("number_missing"), "warn");
    else return { name, place: { x, y, z, a, b, c } };
    return null;
  }

  // changes: of POST /scene. Returns whether they were made.
  async change(changes, words) {
    const { robot } = this.api;
    try {
      const { stopped, contacts } = await this.api.post("/scene", changes);
      if (robot !== this.api.robot) return false;
      const touched = contacts.length ? word("scene_touches", { contacts: contacts.join("; ") }) : "";
      this.say(() => [words(), stopped, touched].filter(Boolean).join(" "), stopped || touched ? "warn" : "good");
      return true;
    } catch (error) {
      this.say(() => reasonOf(error), "warn");
      return false;
    }
  }

  get sent() {
    return { place: this.place.sent };
  }

  // The form shows what was saved. The next event updates the list, in the base frame.
  settle(name, sent) {
    this.mark({ ...this.chosen, name });
    this.part("name").defaultValue = name;
    this.place.settle(sent.place);
  }

  // Buttons are replaced only after a change, because a finger may be on one.
  write() {
    const shown = JSON.stringify([this.chosen?.name, document.documentElement.lang, this.all.map((each) => this.title(each))]);
    if (shown === this.shown) return;
    this.shown = shown;
    this.list.replaceChildren(...(this.all.length ? this.all.map((each) => this.row(each)) : [this.none()]));
  }

  none() {
    const made = document.createElement("li");
    made.textContent = this.empty;
    return made;
  }

  row(one) {
    const [row, button] = ["li", "button"].map((tag) => document.createElement(tag));
    button.type = "button";
    button.textContent = this.title(one);
    button.setAttribute("aria-pressed", String(one.name === this.chosen?.name));
    button.dataset.name = one.name;
    button.addEventListener("click", () => this.choose(this.all.find(({ name }) => name === one.name) ?? one));
    row.append(button);
    return row;
  }

  say(words, level = "") {
    speak(`${this.kind}-why`, words);
    this.part("why").dataset.level = level;
  }
}
