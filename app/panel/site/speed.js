// The one speed of this panel: of the motions that are planned here, of steps and of jogging. It is a share of the
// limits, and is scaled by the override in the head, which is that of all clients. On a phone its slider is next to
// the jog buttons, elsewhere next to the plan.
import { inEachLanguage, word } from "./words.js";

const SLIDERS = ["motion-speed", "jog-speed"];
const element = (id) => document.getElementById(id);

export class Speed {
  constructor() {
    for (const id of SLIDERS) {
      element(id).addEventListener("input", () => {
        for (const each of SLIDERS) element(each).value = element(id).value;
        this.write();
      });
    }
    element("jog-speed").addEventListener("change", () => element("motion-speed").dispatchEvent(new Event("change")));
    inEachLanguage(() => this.write());
  }

  // As a share of the limits, without the override.
  get share() {
    return element("motion-speed").value / 100;
  }

  get override() {
    return element("override-set").value / 100;
  }

  write() {
    const { value: percent } = element("motion-speed");
    const { value: override } = element("override-set");
    const scaled = override === "100" ? "" : ` × ${override} %`;
    const values = { override, percent: Number((percent * override) / 100).toFixed(1).replace(/\.0$/, "") };
    const about = `${word("speed_about", { percent })} ${scaled && word("speed_scaled", values)}`.trim();
    for (const id of SLIDERS) {
      element(`${id}-shown`).textContent = `${percent} %${scaled}`;
      element(id).closest("label").title = about;
      element(id).setAttribute("aria-valuetext", `${percent} %${scaled}`);
    }
    element("override-part").toggleAttribute("data-scaled", scaled !== "");
  }
}
