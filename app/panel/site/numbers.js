// Fields for the numbers of a pose, a position or a size. A number that was not edited keeps all its digits.
import { inEachLanguage, word } from "./words.js";

const UNITS = { mm: 1000, "°": 180 / Math.PI };
const DIGITS = 2;

export class Numbers {
  // labels: [name, unit] of each number. The unit is "mm" or "°", the name a word of the catalogue or a text.
  constructor(place, labels) {
    this.place = place;
    this.given = [];
    this.rows = labels.map(([name, unit], index) => {
      const [label, text, field] = ["label", "span", "input"].map((tag) => document.createElement(tag));
      field.id = `${place.id}-${index + 1}`;
      field.type = "number";
      field.step = "any";
      label.append(text, field);
      inEachLanguage(() => (text.textContent = `${word(name)}, ${unit}`));
      return { field, label, unit };
    });
    place.replaceChildren(...this.rows.map(({ label }) => label));
  }

  // In m and rad.
  set(values) {
    this.given = values;
    this.rows.forEach(({ field, unit }, index) => {
      const value = values[index] * UNITS[unit];
      field.value = Number.isFinite(value) ? Number(value.toFixed(DIGITS)) : "";
      field.defaultValue = field.value;
    });
  }

  // Sets the numbers as if they had been typed.
  type(values) {
    const { given } = this;
    const before = this.rows.map(({ field }) => field.defaultValue);
    this.set(values);
    this.rows.forEach(({ field }, index) => (field.defaultValue = before[index]));
    this.given = given;
  }

  // The current content of the fields, for `settle`.
  get sent() {
    return { values: this.values(), texts: this.rows.map(({ field }) => field.value) };
  }

  // These numbers have been saved. Numbers that were typed meanwhile stay.
  settle({ values, texts }) {
    this.given = values;
    this.rows.forEach(({ field }, index) => (field.defaultValue = texts[index]));
  }

  // In m and rad; NaN for a field without a number. others: the numbers of the fields that were not edited.
  values(others = this.given) {
    return this.rows.map(({ field, unit }, index) => (changed(field) ? field.valueAsNumber / UNITS[unit] : others[index]));
  }

  get changed() {
    return this.rows.some(({ field }) => changed(field));
  }
}

export function changed(field) {
  return field.value !== field.defaultValue;
}

const PLACE = [["X", "mm"], ["Y", "mm"], ["Z", "mm"]];

export const placeFields = (place) => new Numbers(place, PLACE);

export const poseFields = (place) => new Numbers(place, [...PLACE, ["A", "°"], ["B", "°"], ["C", "°"]]);
