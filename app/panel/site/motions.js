// Go to a named position: plan, look at it, execute.
import { inEachLanguage, word } from "./words.js";

const SAMPLES = 100;
const MADE = "cobot.plans"; // the plans of this tab, also after it was loaded again
const element = (id) => document.getElementById(id);

export class Motions {
  constructor(api, preview) {
    this.api = api;
    this.preview = preview;
    this.plan = null;
    this.name = null;
    this.again = null;
    this.asked = 0;
    this.made = JSON.parse(sessionStorage.getItem(MADE) ?? "[]");
    this.words = () => word("plan_hint");
    element("execute").addEventListener("click", () => this.execute());
    element("discard").addEventListener("click", () => this.discard());
    element("motion-speed").addEventListener("change", () => this.again?.());
    inEachLanguage(() => this.say(this.words));
  }

  own(id) {
    return this.made.includes(id);
  }

  async load() {
    const positions = await this.api.get("/positions");
    element("positions").replaceChildren(
      ...positions.map(({ name, description }) => {
        const button = document.createElement("button");
        button.type = "button";
        button.textContent = name;
        button.title = description;
        button.dataset.position = name;
        button.setAttribute("aria-pressed", "false");
        button.addEventListener("click", () => this.choose(name));
        return button;
      }),
    );
  }

  get speed() {
    return element("motion-speed").value / 100;
  }

  choose(name) {
    return this.ask(name, () => this.api.post("/plan/named", { name, speed: this.speed, samples: SAMPLES }));
  }

  // Several motions as one: bodies as POST /robot/plan/sequence takes them.
  through(name, motions, radii) {
    const body = () => ({ motions: motions(this.speed), radii, samples: SAMPLES });
    return this.ask(name, () => this.api.post("/plan/sequence", body()));
  }

  async ask(name, planned) {
    this.discard();
    this.name = name;
    this.again = () => this.ask(name, planned);
    this.mark();
    const asked = this.asked;
    this.say(() => word("planning", { name }));
    try {
      const plan = await planned();
      this.made = [...this.made, plan.plan_id].slice(-1000);
      sessionStorage.setItem(MADE, JSON.stringify(this.made));
      if (asked !== this.asked) return;
      this.plan = plan;
      this.preview(plan);
      this.say(() => this.described(plan));
    } catch (error) {
      if (asked === this.asked) this.say(() => error.message);
    }
    this.mark();
  }

  described(plan) {
    if (!plan.duration_s) return word("there_already");
    const near = [plan.closest_environment, plan.closest_self].filter(Boolean);
    const nearest = near.sort((one, other) => one.distance_m - other.distance_m)[0];
    const distance = nearest
      ? word("closest", { mm: Math.round(1000 * nearest.distance_m), between: nearest.between.join(" – ") })
      : word("closest_none");
    return `${word("takes", { seconds: plan.duration_s.toFixed(1) })} ${distance} ${plan.note}`;
  }

  async execute() {
    const plan = this.plan;
    this.plan = null;
    this.mark();
    this.say(() => word("moving", { name: this.name ?? "" }));
    try {
      const answer = await this.api.post("/execute", { plan_id: plan.plan_id });
      this.end(() => (answer.success ? word("arrived") : answer.message));
    } catch (error) {
      this.end(() => error.message);
    }
  }

  end(words) {
    this.discard();
    this.say(words);
  }

  discard() {
    this.asked += 1;
    this.plan = this.name = this.again = null;
    this.preview(null);
    this.mark();
    this.say(() => word("plan_hint"));
  }

  mark() {
    element("execute").disabled = !this.plan?.duration_s;
    element("discard").disabled = !this.plan;
    for (const button of element("positions").children) {
      button.setAttribute("aria-pressed", String(button.dataset.position === this.name));
    }
  }

  say(words) {
    this.words = words;
    element("plan").textContent = words();
  }
}
