// Why the arm will not move, in words, and the way out; or that nobody says how it is.
import { sentenceOf } from "./reasons.js";
import { inEachLanguage, word } from "./words.js";

// What the real-time process says when it latches begins or goes on like this; the word says it in each language.
export const CAUSES = [
  [/^e-stop requested/, "cause_estop"],
  [/^fast stop requested/, "cause_fast_stop"],
  [/not finite/, "cause_not_finite"],
  [/^reading from the robot failed/, "cause_reading"],
  [/^writing to the robot failed/, "cause_writing"],
  [/which clocks the cycle/, "cause_beat"],
  [/packets arrive too fast/, "cause_race"],
  [/has reported the same values/, "cause_frozen"],
  [/from its commanded position|measured position has jumped/, "cause_tracking"],
];
const LATCHED = { ESTOP: "estop", FAULT: "fault" };
const element = (id) => document.getElementById(id);

export class Banner {
  constructor(api) {
    this.api = api;
    this.state = null;
    this.quiet = false; // there are no states
    this.why = ""; // what there is to say of that
    this.problem = ""; // why a reset was refused
    this.shown = "";
    element("reset").addEventListener("click", () => this.reset());
    inEachLanguage(() => this.write());
  }

  show(state) {
    if (state.mode !== this.state?.mode || state.reason !== this.state?.reason) this.problem = "";
    this.state = state;
    this.write();
  }

  // why: what there is to say of it.
  silent(quiet, why = "") {
    [this.quiet, this.why] = [quiet, why];
    this.write();
  }

  write() {
    const kind = this.quiet ? "silence" : LATCHED[this.state?.mode];
    const shown = kind ? [kind, this.why, this.state?.reason, this.problem, document.documentElement.lang].join(" ") : "";
    if (shown === this.shown) return;
    this.shown = shown;
    element("banner").hidden = !kind;
    if (!kind) return;
    const reason = this.quiet ? this.why : this.state.reason;
    const cause = this.quiet ? "silent" : CAUSES.find(([pattern]) => pattern.test(reason))?.[1];
    element("banner-title").textContent = word(kind);
    element("banner-cause").textContent = cause ? word(cause) : "";
    element("banner-reason").textContent = reason;
    element("banner-way").textContent = this.problem || word(this.quiet ? "way_silent" : "way_out");
    element("reset").hidden = Boolean(this.quiet);
  }

  async reset() {
    try {
      await this.api.post("/reset");
      this.problem = "";
    } catch (error) {
      this.problem = sentenceOf(error);
    }
    this.write();
  }
}
