// The first-run guide: five marks that show a new user where to look, stop, jog, plan and teach. Each browser shows it
// once; the page Setup shows it again. It covers no control, takes no focus and no key: Escape stays STOP.
import { keep, keptText } from "./store.js";
import { inEachLanguage, word } from "./words.js";

const SEEN = "cobot.guide";
const MARKS = [
  ["guide_look", "guide_look_text", "picture"],
  ["guide_stop", "guide_stop_text", "stop"],
  ["guide_jog", "guide_jog_text", "joints"],
  ["guide_go", "guide_go_text", "positions"],
  ["guide_teach", "guide_teach_text", "tab-program"],
];
const element = (id) => document.getElementById(id);

export class Guide {
  // examples: gives the names of the example programs of the cell.
  constructor(examples) {
    this.examples = examples;
    this.mark = null; // index of the mark that is shown
    element("guide-next").addEventListener("click", () => this.show(this.mark + 1));
    element("guide-skip").addEventListener("click", () => this.show(MARKS.length));
    element("guide-again").addEventListener("click", () => this.show(0));
    inEachLanguage(() => this.write());
  }

  // Show it, unless this browser has shown it before.
  offer() {
    if (this.mark === null && keptText("localStorage", SEEN) === null) this.show(0);
  }

  show(mark) {
    this.point(false);
    this.mark = mark < MARKS.length ? mark : null;
    if (this.mark === null) keep("localStorage", SEEN, "seen");
    else element("tab-move").click(); // the marks are there
    this.write(); // first, because its height may change the height of what scrolls
    this.point(true);
  }

  point(on) {
    if (this.mark === null) return;
    const target = element(MARKS[this.mark][2]);
    target.toggleAttribute("data-marked", on);
    if (on) target.scrollIntoView({ block: "center" });
  }

  write() {
    element("guide").hidden = this.mark === null;
    if (this.mark === null) return;
    const [title, text] = MARKS[this.mark];
    element("guide-title").textContent = `${this.mark + 1} / ${MARKS.length} · ${word(title)}`;
    const real = title === "guide_look" && element("simulation").hidden;
    const [name] = title === "guide_teach" ? this.examples() : [];
    const example = name ? word("guide_example", { name }) : "";
    element("guide-text").textContent = `${word(real ? "guide_look_real" : text)} ${example}`.trim();
    element("guide-next").textContent = word(this.mark + 1 < MARKS.length ? "guide_next" : "guide_done");
  }
}
