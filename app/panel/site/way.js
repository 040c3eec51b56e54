// The way of the TCP of the motion that runs, whosever it is, as a line in the picture.
import { tcpOf } from "./kinematics.js";
import { oneAtATime } from "./once.js";

const SAMPLES = 200;

export class Way {
  constructor(api, view) {
    this.api = api;
    this.view = view;
    this.look = oneAtATime(() => this.ask());
  }

  hear(event) {
    if (event.type === "motion" || event.type === "hello") this.look();
  }

  async ask() {
    const [view, { robot }] = [this.view(), this.api];
    if (!view || !robot) return;
    const { path } = await this.api.get(`/motion?samples=${SAMPLES}`).catch(() => ({ path: [] }));
    if (robot !== this.api.robot || !view.geometry) return;
    view.follow(path.map(({ joints }) => tcpOf(view.geometry, joints).position));
  }
}
