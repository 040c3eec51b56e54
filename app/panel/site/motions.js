// Go to a named position: plan, look at it, execute.
import { allow } from "./able.js";
import { moved } from "./follow.js";
import { ID, idOf } from "./ids.js";
import { oneAtATime } from "./once.js";
import { reasonOf, whyOf } from "./reasons.js";
import { followed } from "./sequence.js";
import { keep, keptList } from "./store.js";
import { inEachLanguage, word } from "./words.js";

const LATCHED = ["ESTOP", "FAULT"];
const SAMPLES = 100;
const SAMPLES_OF_MANY = 400;
const SELF_NEAR_M = 0.01; // an arm is always near to itself: only this little is worth a sentence
const MADE = "cobot.plans"; // the plans of this tab, also after it was loaded again
const element = (id) => document.getElementById(id);

// How a plan differs from the request, in words. That the direct way is free is no news.
function noticed({ notices, note }) {
  const kinds = notices.filter(({ kind, values }) => kind !== "auto" || values.planner !== "ptp");
  if (!notices.length && note) return [word("notice_other")];
  return kinds.map(({ kind, values }) => word(`notice_${kind === "auto" ? values.planner : kind}`, values, word("notice_other")));
}

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
    this.rehearsing = this.latched = false;
    this.made = keptList("sessionStorage", MADE);
    this.renew = oneAtATime(() => this.load());
    this.words = () => word("plan_hint");
    element("execute").addEventListener("click", () => this.execute());
    element("rehearse").addEventListener("click", () => this.rehearse());
    element("discard").addEventListener("click", () => this.discard());
    element("motion-speed").addEventListener("change", () => this.again?.());
    element("position-teach").addEventListener("click", () => this.teach());
    element("position-forget").addEventListener("click", () => this.forget());
    element("position-name").addEventListener("input", () => this.mark());
    element("position-name").addEventListener("focus", ({ target }) => target.select());
    element("position-name").addEventListener("keydown", ({ key, repeat }) => key === "Enter" && !repeat && this.teach());
    inEachLanguage(() => {
      this.say(this.words);
      this.mark();
    });
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
    this.say(() => this.described(plan));
    this.mark();
  }

  get speed() {
    return this.speeds.share;
  }

  // Its name is in the field too, to teach it again or to delete it.
  press(name, label) {
    element("position-name").value = label;
    this.choose(name, label);
  }

  choose(name, label = name) {
    return this.ask(label, () => this.planned("/plan/named", { name, speed: this.speed, samples: SAMPLES }));
  }

  toJoints(name, joints) {
    return this.ask(name, () => this.planned("/plan/joints", { joints, speed: this.speed, samples: SAMPLES }));
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
    this.made = [...this.made, plan.plan_id].slice(-1000);
    keep("sessionStorage", MADE, JSON.stringify(this.made));
    return { ...plan, ids: [plan.plan_id] };
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
      this.say(() => this.described(plan), plan.note);
    } catch (error) {
      if (asked === this.asked) this.say(() => reasonOf(error), error.message);
    }
    this.mark();
    return plan;
  }

  described(plan) {
    if (!plan.duration_s) return word("there_already");
    const { closest_environment: around, closest_self: own } = plan;
    const self = own && own.distance_m < SELF_NEAR_M ? own : null; // farther away it says nothing to a person
    const nearest = [around, self].filter(Boolean).sort((one, other) => one.distance_m - other.distance_m)[0];
    const distance = nearest
      ? word("closest", { mm: Math.round(1000 * nearest.distance_m), between: nearest.between.join(" – ") })
      : word("closest_none");
    const name = this.name ? word("plan_to", { name: this.name }) : "";
    return [name, word("takes", { seconds: plan.duration_s.toFixed(1) }), distance, ...noticed(plan)].filter(Boolean).join(" ");
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

  // On a simulated copy of the robot, each motion after the other. Nothing moves, and the plan stays.
  async rehearse() {
    const { asked, plan } = this;
    const say = (words, title) => asked === this.asked && this.say(words, title);
    this.rehearsing = true;
    this.mark();
    say(() => word("rehearsing"));
    try {
      let [seconds, effort] = [0, 0];
      for (const id of plan.ids) {
        const found = await this.api.post(`/plans/${id}/rehearse`);
        if (!found.runs_through) {
          const { problem } = found;
          const says = () => whyOf({ ...problem, reason: problem.says });
          say(() => word("rehearsed_not", { seconds: (seconds + problem.time_s).toFixed(1), says: says() }), problem.says);
          return;
        }
        seconds += found.duration_s;
        effort = Math.max(effort, ...found.effort);
      }
      say(() => `${word("rehearsed", { seconds: seconds.toFixed(1), percent: Math.round(100 * effort) })} ${this.described(plan)}`);
    } catch (error) {
      say(() => reasonOf(error), error.message);
    } finally {
      this.rehearsing = false;
      this.mark();
    }
  }

  discard() {
    this.asked += 1;
    this.plan = this.name = this.again = null;
    this.looked = false;
    this.preview(null);
    this.mark();
    this.say(() => word("plan_hint"));
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
    allow(element("rehearse"), this.rehearsing ? "rehearsing" : planned);
    allow(element("discard"), this.plan || this.looked ? "" : "why_no_plan");
    allow(element("position-forget"), this.labelled?.taught ? "" : "why_not_taught");
    for (const button of element("positions").children) {
      button.setAttribute("aria-pressed", String(button.textContent === this.name));
    }
  }

  // title: the sentence of the service.
  say(words, title = "") {
    this.words = words;
    element("plan").textContent = words();
    element("plan").title = title;
  }
}
