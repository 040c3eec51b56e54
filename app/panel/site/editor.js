// A text field with line numbers.
export class Editor {
  constructor(field, numbers) {
    this.field = field;
    this.numbers = numbers;
    field.addEventListener("input", () => this.count());
    field.addEventListener("scroll", () => (numbers.scrollTop = field.scrollTop));
  }

  get text() {
    return this.field.value;
  }

  set text(text) {
    if (this.field.value !== text) this.field.value = text;
    this.count();
  }

  count() {
    const count = this.field.value.split("\n").length;
    if (this.counted === count) return;
    this.counted = count;
    this.numbers.textContent = Array.from({ length: count }, (_, line) => line + 1).join("\n");
  }

  // Selects a line.
  mark(line) {
    const lines = this.field.value.split("\n");
    const begin = lines.slice(0, line - 1).reduce((sum, each) => sum + each.length + 1, 0);
    this.field.focus();
    this.field.setSelectionRange(begin, begin + (lines[line - 1] ?? "").length);
  }
}
