// Why the arm will not move, in words, and the way out; or that nobody says how it is.
import { saysMore, sentenceOf, whyOf } from "./reasons.js";
import { inEachLanguage, word } from "./words.js";

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
    const { quiet, state } = this;
    element("banner-title").textContent = word(kind);
    element("banner-cause").textContent = quiet ? word("silent") : whyOf(state);
    element("banner-cause").title = quiet ? "" : state.reason;
    element("banner-reason").textContent = quiet ? this.why : saysMore(state) ? state.reason : "";
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
