// The buttons over the picture, and the speed of the TCP.
import { inEachLanguage, word } from "./words.js";

const TOGGLES = { "view-collision": (view, on) => view.showCollision(on), "view-trace": (view, on) => view.showTrace(on) };
const MIN_PERIOD_S = 0.15; // between two places of which the speed is computed
const element = (id) => document.getElementById(id);

export class ViewTools {
  // view: gives the picture, null before there is one.
  constructor(view) {
    this.view = view;
    this.last = null;
    this.speed = 0;
    for (const button of document.querySelectorAll("[data-view]")) {
      button.addEventListener("click", () => this.view()?.look(button.dataset.view));
    }
    for (const [id, apply] of Object.entries(TOGGLES)) {
      element(id).addEventListener("click", () => {
        const on = element(id).getAttribute("aria-pressed") !== "true";
        element(id).setAttribute("aria-pressed", String(on));
        if (this.view()) apply(this.view(), on);
      });
    }
    inEachLanguage(() => this.write());
  }

  // For another robot: its TCP has left no trace yet, and its clock is another one.
  clear() {
    this.last = null;
    if (element("view-trace").getAttribute("aria-pressed") === "true") element("view-trace").click();
  }

  // The TCP's speed, m/s, from its places and the robot's own clock.
  show({ tcp, robot_time_s: time }) {
    const seconds = this.last ? time - this.last.time : 0;
    if (seconds >= 0 && seconds < MIN_PERIOD_S && this.last) return;
    const way = this.last ? Math.hypot(...[0, 1, 2].map((axis) => tcp[axis] - this.last.tcp[axis])) : 0;
    this.speed = seconds > 0 && Number.isFinite(way) ? way / seconds : 0;
    this.last = { tcp, time };
    this.write();
  }

  write() {
    const text = word("tcp_speed", { speed: (1000 * this.speed).toFixed(0) });
    if (element("tcp-speed").textContent !== text) element("tcp-speed").textContent = text;
  }
}
