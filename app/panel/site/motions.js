// Go to a named position: plan, look at it, execute.
import { allow } from "./able.js";
import { moved } from "./follow.js";
import { ID, idOf } from "./ids.js";
import { oneAtATime } from "./once.js";
import { described, gained, isSearched } from "./plan-words.js";
import { reasonOf } from "./reasons.js";
import { rehearsed } from "./rehearsal.js";
import { followed } from "./sequence.js";
import { keep, keptList } from "./store.js";
import { inEachLanguage, speak, word } from "./words.js";

const LATCHED = ["ESTOP", "FAULT"];
const SAMPLES = 100;
const SAMPLES_OF_MANY = 400;
const IMPROVE_S = 1.0;
const MADE = "cobot.plans"; // the plans of this tab, also after it was loaded again
const HINT = () => word("plan_hint");
const element = (id) => document.getElementById(id);

export class Motions {
  constructor(api, preview, state, speeds) {
    this.api = api;
    this.speeds = speeds;
    this.state = state;
    this.positions = [];
    this.offered = "";
    this.preview = preview;
    this.plan = null;
    this.name = null;
    this.again = null;
    this.asked = 0;
    this.busy = ""; // the word for what is computed for the plan
    this.latched = false;
    this.made = keptList("sessionStorage", MADE);
    this.renew = oneAtATime(() => this.load());
    element("execute").addEventListener("click", () => this.execute());
    element("rehearse").addEventListener("click", () => this.rehearse());
    element("improve").addEventListener("click", () => this.improve());
    element("discard").addEventListener("click", () => this.discard());
    element("motion-speed").addEventListener("change", () => this.again?.());
    element("position-teach").addEventListener("click", () => this.teach());
    element("position-forget").addEventListener("click", () => this.forget());
    element("position-name").addEventListener("input", () => this.mark());
    element("position-name").addEventListener("focus", ({ target }) => target.select());
    element("position-name").addEventListener("keydown", ({ key, repeat }) => key === "Enter" && !repeat && this.teach());
    this.say(HINT);
    inEachLanguage(() => this.mark());
  }

  // What the field says, and the position that is shown under this name, if there is one.
  get label() {
    return element("position-name").value.trim();
  }

  get labelled() {
    return this.positions.find(({ label }) => label === this.label);
  }

  own(id) {
    return this.made.includes(id);
  }

  hear(event) {
    if (event.type === "positions" || event.type === "hello") this.renew();
  }

  async load() {
    const { robot } = this.api;
    try {
      const positions = await this.api.get("/positions");
      if (robot === this.api.robot) this.offer(positions);
    } catch (error) {
      this.say(() => reasonOf(error), error.message);
    }
  }

  // Buttons are replaced only after a change, because a finger may be on one.
  offer(positions) {
    const offered = JSON.stringify(positions);
    if (offered === this.offered) return;
    this.offered = offered;
    this.positions = positions;
    element("positions").replaceChildren(
      ...positions.map(({ name, label, description }) => {
        const button = document.createElement("button");
        button.type = "button";
        button.textContent = label;
        button.title = description;
        button.dataset.position = name;
        button.setAttribute("aria-pressed", "false");
        button.addEventListener("click", () => this.press(name, label));
        return button;
      }),
    );
    this.mark();
  }

  // Where the arm is gets a name, which is kept by the service; one that was taught before may be moved.
  async teach() {
    const label = this.label;
    const name = this.labelled?.name ?? (ID.test(label) ? label : idOf(label, "position"));
    const joints = this.state()?.commanded_position;
    if (!joints) {
      this.say(() => word("silence"));
      return;
    }
    try {
      await this.api.post("/positions", { name, joints, ...(name === label ? {} : { label }) });
      await this.load();
      if (document.activeElement === element("position-name")) element("position-name").select(); // for the next name
      this.say(() => word("position_taught", { name: label }));
    } catch (error) {
      this.say(() => reasonOf(error), error.message);
    }
  }

  async forget() {
    const { name, label } = this.labelled;
    try {
      const left = await this.api.ask("DELETE", this.api.address(`/positions/${encodeURIComponent(name)}`));
      this.offer(await left.json());
      this.say(() => word("position_forgotten", { name: label }));
    } catch (error) {
      this.say(() => reasonOf(error), error.message);
    }
  }

  // A plan of somebody else: shown, not to be run from here.
  look(plan) {
    this.discard();
    this.looked = true;
    this.preview(plan);
    this.say(() => described(plan, this.name));
    this.mark();
  }

  get speed() {
    return this.speeds.share;
  }

  // The name of a taught position is in the field too, to replace or to delete it; that of another one cannot be saved.
  press(name, label) {
    element("position-name").value = this.positions.some((each) => each.name === name && each.taught) ? label : "";
    this.choose(name, label);
  }

  // The direct way, and only if that is blocked a way around.
  choose(name, label = name) {
    return this.ask(label, () => this.planned("/plan/named", { name, planner: "auto", speed: this.speed, samples: SAMPLES }));
  }

  toJoints(name, joints) {
    return this.ask(name, () => this.planned("/plan/joints", { joints, planner: "auto", speed: this.speed, samples: SAMPLES }));
  }

  toPose(name, pose, planner = "lin") {
    return this.ask(name, () => this.planned("/plan/pose", { ...pose, planner, speed: this.speed, samples: SAMPLES }));
  }

  // Several motions one after the other: parts as POST /robot/plan/sequence takes them.
  through(name, parts) {
    return this.ask(name, async () => {
      let plan = null;
      for (const part of parts()) {
        const start = plan ? { start: plan.path.at(-1).joints } : {};
        const next = await this.planned("/plan/sequence", { ...part, ...start, samples: SAMPLES_OF_MANY });
        plan = plan ? followed(plan, next) : next;
      }
      return plan;
    });
  }

  async planned(path, body) {
    const plan = await this.api.post(path, body);
    if (!this.own(plan.plan_id)) this.made = [...this.made, plan.plan_id].slice(-1000);
    keep("sessionStorage", MADE, JSON.stringify(this.made));
    return { ...plan, ids: [plan.plan_id] };
  }

  // Searches for a faster motion. Nothing moves; this plan can be executed meanwhile, or another one made.
  async improve() {
    const { asked, plan } = this;
    const isShown = () => asked === this.asked && this.plan === plan;
    this.turn("improving");
    this.say(() => `${word("improving")} ${described(plan, this.name)}`);
    try {
      const found = await this.planned(`/plans/${plan.plan_id}/improve`, { budget_s: IMPROVE_S, samples: SAMPLES });
      if (!isShown()) return;
      this.plan = found;
      if (found.plan_id !== plan.plan_id) this.preview(found);
      const gain = gained(found) ? "" : found.planning.quality === "final" ? "why_fastest" : "improved_not";
      this.say(() => `${gain && word(gain)} ${described(found, this.name)}`.trim(), found.note);
    } catch (error) {
      if (isShown()) this.say(() => reasonOf(error), error.message);
    } finally {
      this.turn(""); // also when another plan is shown by now
    }
  }

  // Returns the plan; null if planning failed, or the user has asked for another plan meanwhile.
  async ask(name, planned) {
    this.discard();
    this.name = name;
    element("dock").scrollIntoView({ block: "nearest" }); // on a phone it may be elsewhere
    this.again = () => this.ask(name, planned);
    this.mark();
    const asked = this.asked;
    this.say(() => word("planning", { name }));
    let plan = null;
    try {
      plan = await planned();
      if (asked !== this.asked) return null;
      this.plan = plan;
      this.preview(plan);
      this.say(() => described(plan, this.name), plan.note);
    } catch (error) {
      if (asked === this.asked) this.say(() => reasonOf(error), error.message);
    }
    this.mark();
    return plan;
  }

  async execute() {
    if (this.latched) return void this.say(() => word("why_latched"));
    const plan = this.plan;
    this.plan = null;
    this.mark();
    const { asked, name } = this;
    this.say(() => word("moving", { name: name ?? "" }));
    this.preview(plan, plan.duration_s); // the ghost shows where the arm goes
    const why = await moved(this.api, "/execute", { plan_id: plan.plan_id }).catch((error) => error);
    if (asked !== this.asked) return; // somebody looks at another plan by now
    this.discard();
    this.say(() => (why ? reasonOf(why) : word("arrived")), why?.detail ?? why?.message);
  }

  // Nothing moves, and the plan stays.
  async rehearse() {
    const { asked, plan } = this;
    const say = (words, title) => asked === this.asked && this.say(words, title);
    this.turn("rehearsing");
    say(() => word("rehearsing"));
    try {
      const { words, problem } = await rehearsed(this.api, plan.ids);
      say(() => (problem ? words() : `${words()} ${described(plan, this.name)}`), problem);
    } catch (error) {
      say(() => reasonOf(error), error.message);
    }
    this.turn("");
  }

  turn(busy) {
    this.busy = busy;
    this.mark();
  }

  discard() {
    this.asked += 1;
    this.plan = this.name = this.again = null;
    this.looked = false;
    this.preview(null);
    this.mark();
    this.say(HINT);
  }

  // In an e-stop or a fault no plan is run.
  show({ mode }) {
    const latched = LATCHED.includes(mode);
    if (latched === this.latched) return;
    this.latched = latched;
    this.mark();
  }

  mark() {
    const planned = this.plan?.duration_s ? "" : "why_no_plan";
    const latched = this.latched ? "why_latched" : "";
    allow(element("execute"), latched || planned || (this.plan.plan_id ? "" : "why_shown_only"));
    allow(element("rehearse"), this.busy || planned);
    element("improve").hidden = Boolean(planned) || !isSearched(this.plan);
    allow(element("improve"), this.busy || (this.plan?.planning?.quality === "final" ? "why_fastest" : ""));
    allow(element("discard"), this.plan || this.looked ? "" : "why_no_plan");
    allow(element("position-forget"), this.labelled?.taught ? "" : "why_not_taught");
    const save = element("position-teach");
    save.dataset.word = this.labelled?.taught ? "position_replace" : "position_teach";
    save.textContent = word(save.dataset.word);
    for (const button of element("positions").children) {
      button.setAttribute("aria-pressed", String(button.textContent === this.name));
    }
  }

  // title: the sentence of the service.
  say(words, title = "") {
    speak("plan", words);
    element("plan").title = title;
    element("plan").toggleAttribute("data-idle", words === HINT);
  }
}
