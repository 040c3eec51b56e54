// The steps of a program as a tree of rows. Pressing a row chooses it; its handle or the keyboard moves it.
import { blocksOf, isMotion, isWithin, kindOf, numberIn, placeOf, rootOf, stepAt } from "./steps.js";
import { lineOf, nameOf, partName, symbol } from "./step-words.js";
import { word } from "./words.js";

const MAX_ROWS = 500;
const EDGE_PX = 40; // near the edge of the list a row that is held scrolls it
const NARROW = matchMedia("(max-width: 60rem)");
const element = (id) => document.getElementById(id);

export function made(tag, text = "", className = "") {
  const element = document.createElement(tag);
  element.textContent = text;
  element.className = className;
  return element;
}

export class StepTree {
  // page: the page Program, with the program, the chosen step and the actions for it.
  constructor(page) {
    this.page = page;
    this.list = element("steps");
    this.held = null; // {number, id, index}: the row in a hand, and where it would go
    NARROW.addEventListener("change", () => this.placeForm());
    this.list.addEventListener("keydown", (event) => this.press(event));
  }

  get content() {
    return this.page.program.content;
  }

  write() {
    const focused = document.activeElement?.closest?.("#steps [data-step]") && document.activeElement.className;
    this.left = MAX_ROWS;
    const { content } = this;
    element("step-parts").append(element("step-form"));
    const rows = content ? this.rows(rootOf(content), "") : [];
    if (content?.home) rows.unshift(this.row(content.home, "0"));
    this.list.replaceChildren(...rows);
    if (this.left < 0) this.list.append(made("li", word("steps_more", { count: -this.left }), "hint"));
    this.mark();
    if (focused) this.focus(this.page.chosen, focused);
  }

  // Shows a step that has changed in place. The rows, and the fields in one of them, are kept.
  refresh() {
    const { activeElement: focused } = document;
    for (const row of this.list.querySelectorAll("[data-step]")) {
      const { step: number } = row.dataset;
      const before = row.firstElementChild;
      const line = this.line(stepAt(this.content, number), number);
      const again = before.contains(focused) && line.querySelector(`.${focused.classList[0]}`);
      before.replaceWith(line);
      if (again) again.focus();
    }
    this.mark();
  }

  // On a narrow page the fields are in the row of the step, otherwise next to the tree.
  placeForm() {
    const [form, chosen] = [element("step-form"), this.page.chosen && this.find(this.page.chosen)];
    if (NARROW.matches && chosen) chosen.firstElementChild.after(form);
    else if (form.parentElement !== element("step-parts")) element("step-parts").append(form);
  }

  rows(steps, id) {
    return steps.flatMap((step, index) => ((this.left -= 1) >= 0 ? [this.row(step, numberIn(id, index))] : []));
  }

  row(step, number) {
    const row = made("li");
    row.dataset.step = number;
    row.append(this.line(step, number));
    for (const [part, steps] of blocksOf(step)) {
      const id = part ? `${number}.${part}` : number;
      const list = made("ol");
      list.dataset.list = id;
      list.setAttribute("aria-label", `${number} ${partName(step, part)}`);
      list.append(...this.rows(steps, id));
      if (!steps.length) list.append(this.hint(id));
      if (part) row.append(made("p", partName(step, part), "part"));
      row.append(list);
    }
    return row;
  }

  // The place in an empty list where a step can be added.
  hint(id) {
    const hint = made("li", "", "hint");
    const button = made("button", word("steps_none"), "step-into");
    button.type = "button";
    button.dataset.into = id;
    button.addEventListener("click", () => this.page.choose(null, id));
    hint.append(button);
    return hint;
  }

  line(step, number) {
    const [line, choose] = [made("div", "", "step"), made("button", "", "step-name")];
    choose.type = "button";
    const name = nameOf(step, number);
    const about = lineOf(step, name, (joints) => this.page.places.poseOf(joints));
    choose.append(made("b", name), made("small", about));
    choose.title = about;
    choose.addEventListener("click", () => this.page.choose(number));
    line.append(number === "0" ? made("i", "", "grip") : this.grip(number), symbol(number === "0" ? "home" : kindOf(step)), made("span", number === "0" ? "" : number, "number"), choose);
    if (isMotion(step)) line.append(this.button("▶", "step_go", number, name, () => this.page.places.go(number)));
    if (this.page.places.canTeach(step)) line.append(this.button("⟳", "step_teach", number, name, () => this.page.places.teachAgain(number)));
    return line;
  }

  button(sign, name, number, of, act) {
    const button = made("button", sign, name);
    button.type = "button";
    button.title = word(name, { number, name: of });
    button.setAttribute("aria-label", button.title);
    button.addEventListener("click", act);
    return button;
  }

  mark() {
    for (const row of this.list.querySelectorAll("[data-step]")) {
      row.toggleAttribute("data-chosen", row.dataset.step === this.page.chosen);
      row.querySelector(".step-name").setAttribute("aria-pressed", String(row.dataset.step === this.page.chosen));
    }
    this.placeForm();
    for (const button of this.list.querySelectorAll("[data-into]")) button.setAttribute("aria-pressed", String(button.dataset.into === this.page.into));
  }

  find(number) {
    return this.list.querySelector(`[data-step="${number}"]`);
  }

  focus(number, className = "step-name") {
    const row = number && this.find(number)?.firstElementChild;
    (row?.querySelector(`.${className.split(" ")[0]}`) ?? row?.querySelector(".step-name") ?? element("teach")).focus();
  }

  // The arrow keys choose the row above or below. With Alt they move the row.
  press(event) {
    const number = event.target.closest("[data-step]")?.dataset.step;
    if (!number) return;
    const down = event.key === "ArrowDown";
    if (down || event.key === "ArrowUp") {
      event.preventDefault();
      if (event.altKey) return void this.page.shift(number, down);
      const rows = [...this.list.querySelectorAll(".step-name")];
      rows[rows.indexOf(this.find(number).querySelector(".step-name")) + (down ? 1 : -1)]?.focus();
    } else if (event.key === "Delete") {
      event.preventDefault();
      this.page.remove(number);
    } else if (event.key === "F2") {
      event.preventDefault();
      this.page.rename(number);
    }
  }

  // The handle of a row follows the mouse or a finger. A line shows where the row would go.
  grip(number) {
    const grip = made("i", "⠿", "grip");
    grip.title = word("step_drag");
    grip.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      grip.setPointerCapture(event.pointerId);
      this.held = { number };
      this.list.toggleAttribute("data-dragging", true);
    });
    grip.addEventListener("pointermove", (event) => this.held && this.drag(event));
    grip.addEventListener("pointerup", () => this.drop());
    for (const end of ["pointercancel", "lostpointercapture"]) grip.addEventListener(end, () => this.letGo());
    return grip;
  }

  drag({ clientX: x, clientY: y }) {
    const box = this.list.getBoundingClientRect();
    if (y < box.top + EDGE_PX) this.list.scrollTop -= EDGE_PX / 4;
    if (y > box.bottom - EDGE_PX) this.list.scrollTop += EDGE_PX / 4;
    const place = this.placeAt(x, y);
    this.unmark();
    Object.assign(this.held, place ?? { id: undefined });
    if (place) place.shown.dataset.drop = place.where;
  }

  // The target of a row that is dropped here: {id, index, shown, where}. Left of a row, it leaves the lists
  // that end there.
  placeAt(x, y) {
    const lines = [...this.list.querySelectorAll(".step, [data-into]")];
    const line = lines.findLast((each) => each.getBoundingClientRect().top <= y) ?? lines[0];
    if (line.dataset.into) return this.allowed({ id: line.dataset.into, index: 0, shown: line, where: "into" });
    let row = line.parentElement;
    if (row.dataset.step === "0") return null;
    const { top, height } = line.getBoundingClientRect();
    const { id, index } = placeOf(row.dataset.step);
    if (y < top + height / 2) return this.allowed({ id, index, shown: line, where: "before" });
    if (blocksOf(stepAt(this.content, row.dataset.step)).length) return this.allowed({ id: row.dataset.step, index: 0, shown: line, where: "after" });
    const outer = (each) => each.parentElement.closest("[data-step]");
    while (outer(row) && x < row.getBoundingClientRect().left && !row.nextElementSibling) row = outer(row);
    const last = placeOf(row.dataset.step);
    return this.allowed({ id: last.id, index: last.index + 1, shown: row, where: "after" });
  }

  allowed(place) {
    const { number } = this.held;
    if (isWithin(place.id, number)) return null;
    return place;
  }

  drop() {
    const { held } = this;
    this.letGo();
    if (held?.id === undefined) return;
    const from = placeOf(held.number);
    if (from.id === held.id && [from.index, from.index + 1].includes(held.index)) return;
    this.page.moveTo(held.number, held.id, held.index);
  }

  letGo() {
    this.held = null;
    this.unmark();
    this.list.removeAttribute("data-dragging");
  }

  unmark() {
    for (const each of this.list.querySelectorAll("[data-drop]")) delete each.dataset.drop;
  }
}
