// The time factor of the simulation, and its restart: the arm and its cell are at the start, an e-stop or a fault is
// cleared.
import { oneAtATime } from "./once.js";
import { reasonOf } from "./reasons.js";
import { speak, word } from "./words.js";

const element = (id) => document.getElementById(id);
const say = (words) => speak("simulation-why", words);

export class Simulation {
  constructor(api) {
    this.api = api;
    this.look = oneAtATime(() => this.ask());
    element("simulation-reset").addEventListener("click", () => this.reset());
    element("time-factor").addEventListener("change", ({ target }) => this.scale(Number(target.value)));
  }

  hear(event) {
    if (["hello", "time_factor"].includes(event.type)) this.look();
  }

  async ask() {
    const { robot } = this.api;
    if (!robot) return;
    try {
      const { factor } = await this.api.get("/simulation/time_factor");
      if (robot === this.api.robot) this.show(factor);
    } catch (error) {
      say(() => reasonOf(error));
    }
  }

  // Also a factor that another client has set, and for which there is no button.
  show(factor) {
    element("simulation-factor").textContent = factor === 1 ? "" : `× ${factor}`;
    for (const each of element("time-factor").querySelectorAll("input")) each.checked = Number(each.value) === factor;
  }

  async scale(factor) {
    try {
      await this.api.post("/simulation/time_factor", { factor });
      say(() => word("simulation_hint"));
    } catch (error) {
      say(() => reasonOf(error));
    }
    this.look(); // the button that is in force, if the service has rejected this one
  }

  async reset() {
    say(() => "…");
    try {
      await this.api.post("/simulation/reset");
      say(() => word("simulation_begun"));
    } catch (error) {
      say(() => reasonOf(error));
    }
  }
}
