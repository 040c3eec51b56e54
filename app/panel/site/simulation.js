// Begins the simulation again: the arm and its cell are at the start, an e-stop or a fault is cleared.
import { reasonOf } from "./reasons.js";
import { speak, word } from "./words.js";

const element = (id) => document.getElementById(id);

export class Simulation {
  constructor(api) {
    this.api = api;
    element("simulation-reset").addEventListener("click", () => this.reset());
  }

  async reset() {
    const say = (words) => speak("simulation-why", words);
    say(() => "…");
    try {
      await this.api.post("/simulation/reset");
      say(() => word("simulation_begun"));
    } catch (error) {
      say(() => reasonOf(error));
    }
  }
}
