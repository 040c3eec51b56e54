// Completes the names of cobot's functions in a Lua program, in a list at the cursor. Tab takes the marked one, and
// so does Enter after an arrow key; other keys keep their meaning, so that Escape still stops the arm.
import { FUNCTIONS } from "./lua-functions.js";

const NAME = /[A-Za-z_][\w.]*$/;
const MIN_LETTERS = 2; // letters
const STEPS = { ArrowDown: 1, ArrowUp: -1 };

export class Complete {
  // isLua: whether the text is a Lua program. place: an empty list for the offers.
  constructor(field, place, isLua) {
    this.field = field;
    this.place = place;
    this.isLua = isLua;
    this.offers = [];
    field.addEventListener("input", () => this.look());
    field.addEventListener("keydown", (event) => this.press(event));
    for (const type of ["blur", "click", "scroll"]) field.addEventListener(type, () => this.close());
  }

  get before() {
    return this.field.value.slice(0, this.field.selectionStart);
  }

  look() {
    const typed = NAME.exec(this.before)?.[0] ?? "";
    const line = this.before.slice(this.before.lastIndexOf("\n") + 1);
    const names = this.isLua() && typed.length >= MIN_LETTERS && !line.includes("--") ? Object.keys(FUNCTIONS) : [];
    this.typed = typed;
    this.offers = names.filter((name) => name.startsWith(typed) && name !== typed);
    [this.marked, this.moved] = [0, false];
    this.draw(line.length - typed.length);
  }

  draw(column) {
    const { field, place } = this;
    place.hidden = !this.offers.length;
    field.toggleAttribute("aria-activedescendant", false);
    if (place.hidden) return;
    place.replaceChildren(...this.offers.map((name, index) => {
      const [row, parameters] = [document.createElement("li"), document.createElement("small")];
      row.id = `offer-${index}`;
      row.setAttribute("role", "option");
      parameters.textContent = FUNCTIONS[name];
      row.append(name, parameters);
      row.addEventListener("pointerdown", (event) => {
        event.preventDefault(); // the field keeps the focus
        this.take(name);
      });
      return row;
    }));
    const { lineHeight, paddingLeft, paddingTop, font } = getComputedStyle(field);
    const pen = document.createElement("canvas").getContext("2d");
    pen.font = font;
    const lines = this.before.split("\n").length;
    const left = field.offsetLeft + parseFloat(paddingLeft) + column * pen.measureText("0").width - field.scrollLeft;
    const top = field.offsetTop + parseFloat(paddingTop) + lines * parseFloat(lineHeight) - field.scrollTop;
    const below = top + place.offsetHeight <= field.offsetTop + field.offsetHeight;
    place.style.left = `${Math.max(0, Math.min(left, field.offsetLeft + field.offsetWidth - place.offsetWidth))}px`;
    place.style.top = `${below ? top : Math.max(0, top - parseFloat(lineHeight) - place.offsetHeight)}px`;
    this.mark();
  }

  mark() {
    [...this.place.children].forEach((row, index) => row.setAttribute("aria-selected", String(index === this.marked)));
    const row = this.place.children[this.marked];
    row.scrollIntoView({ block: "nearest" });
    this.field.setAttribute("aria-activedescendant", row.id);
  }

  press(event) {
    if (this.place.hidden) return;
    if (event.key in STEPS) {
      this.marked = (this.marked + STEPS[event.key] + this.offers.length) % this.offers.length;
      this.moved = true;
      this.mark();
    } else if ((event.key === "Tab" && !event.shiftKey) || (event.key === "Enter" && this.moved)) {
      this.take(this.offers[this.marked]);
    } else {
      if (event.key.length > 1 && event.key !== "Backspace" && event.key !== "Shift") this.close();
      return;
    }
    event.preventDefault();
  }

  take(name) {
    const { field } = this;
    const call = FUNCTIONS[name].startsWith("(") ? "(" : " ";
    field.setRangeText(name.slice(this.typed.length) + call, field.selectionStart, field.selectionEnd, "end");
    field.dispatchEvent(new Event("input", { bubbles: true })); // as if it had been typed
    this.close();
  }

  close() {
    this.offers = [];
    this.place.hidden = true;
    this.field.removeAttribute("aria-activedescendant");
  }
}
