// Suggestions for fields: inputs, outputs and named positions of the robot.
import { oneAtATime } from "./once.js";

const HEARD = ["hello", "positions"];

export class Names {
  constructor(api) {
    this.api = api;
    this.look = oneAtATime(() => this.ask());
  }

  hear({ type }) {
    if (HEARD.includes(type)) this.look();
  }

  async ask() {
    const { robot } = this.api;
    const [{ points }, positions] = await Promise.all([
      this.api.get("/io").catch(() => ({ points: [] })), this.api.get("/positions").catch(() => []),
    ]);
    if (robot !== this.api.robot) return;
    const named = (direction) => points.filter((each) => each.direction === direction);
    for (const [id, list] of Object.entries({ "io-inputs": named("input"), "io-outputs": named("output"), "position-names": positions })) {
      document.getElementById(id).replaceChildren(...list.map(({ name, label = name }) => new Option(label, name)));
    }
  }
}
