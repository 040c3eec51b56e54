// Why the arm will not move, in words, and the way out.
import { word } from "./words.js";

const element = (id) => document.getElementById(id);

export class Banner {
  constructor(api) {
    this.api = api;
    this.shown = "";
    element("reset").addEventListener("click", () => this.reset());
  }

  show(state) {
    const latched = state.mode === "ESTOP" || state.mode === "FAULT";
    const shown = latched ? `${state.mode} ${state.reason} ${document.documentElement.lang}` : "";
    if (shown === this.shown) return;
    this.shown = shown;
    element("banner").hidden = !latched;
    if (!latched) return;
    element("banner-title").textContent = word(state.mode === "ESTOP" ? "estop" : "fault");
    element("banner-reason").textContent = state.reason;
    element("banner-way").textContent = word("way_out");
  }

  async reset() {
    try {
      await this.api.post("/reset");
    } catch (error) {
      element("banner-way").textContent = error.message;
    }
  }
}
