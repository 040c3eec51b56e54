// Plans that somebody else has made, as agents do, and who lets an agent run them.
import { oneAtATime } from "./once.js";
import { reasonOf } from "./reasons.js";
import { inEachLanguage, speak, word } from "./words.js";

const EVERY_MS = 10_000; // how long a plan is kept is no event
const element = (id) => document.getElementById(id);

export class Approvals {
  constructor(api, motions) {
    this.api = api;
    this.motions = motions;
    this.rows = new Map();
    this.look = oneAtATime(() => this.ask());
    inEachLanguage(() => {
      element("plans-none").textContent = word("plans_none");
      for (const row of this.rows.values()) this.write(row);
    });
    setInterval(() => {
      if (!document.hidden && this.api.robot) this.look();
    }, EVERY_MS);
  }

  hear(event) {
    if (["plan", "hello", "job"].includes(event.type) && this.api.robot) this.look();
  }

  async ask() {
    const robot = this.api.robot;
    try {
      const plans = await this.api.get("/plans");
      if (robot === this.api.robot) this.show(plans.filter((plan) => !this.motions.own(plan.plan_id)));
    } catch (error) {
      speak("plans-why", () => reasonOf(error));
    }
  }

  // Rows stay where they are, so that no other plan comes under a finger: new ones go to the end, and who is
  // about to press sees one that is gone until then.
  show(plans) {
    const there = new Set(plans.map((plan) => plan.plan_id));
    for (const [id, row] of this.rows) {
      if (there.has(id)) continue;
      row.button.disabled = row.show.disabled = true;
      if (element("plans").matches(":hover, :focus-within")) continue;
      row.made.remove();
      this.rows.delete(id);
    }
    for (const plan of plans) {
      const row = this.rows.get(plan.plan_id) ?? this.row(plan.plan_id);
      row.plan = plan;
      this.write(row);
    }
    element("plans-none").hidden = this.rows.size > 0;
  }

  row(id) {
    const row = { made: document.createElement("li"), text: document.createElement("span"), button: document.createElement("button"), show: document.createElement("button") };
    row.button.type = row.show.type = "button";
    row.button.addEventListener("click", () => this.toggle(row));
    row.show.addEventListener("click", () => this.present(row));
    row.made.append(row.text, row.button, row.show);
    row.made.dataset.plan = id;
    element("plans").append(row.made);
    this.rows.set(id, row);
    return row;
  }

  // Its ghost goes the way; it is for whoever may run it.
  async present({ plan }) {
    try {
      this.motions.look(await this.api.get(`/plans/${plan.plan_id}`));
      speak("plans-why", () => "");
    } catch (error) {
      speak("plans-why", () => reasonOf(error));
    }
  }

  write({ made, text, button, show, plan }) {
    const { plan_id: id, by, planners, duration_s: duration, expires_in_s: left, approved_by: approved } = plan;
    const about = { id: id.slice(0, 8), by, planners: planners.join(", ") || word("gripper"), seconds: duration.toFixed(1) };
    const who = approved ? word("plan_approved", { by: approved }) : word("plan_left", { minutes: Math.ceil(left / 60) });
    const said = [word("plan_of", about), ...plan.signals.map((each) => `${each}.`), who].join(" ");
    if (text.textContent !== said) text.textContent = said;
    const act = word(approved ? "plan_withdraw" : "plan_approve");
    if (button.textContent !== act) button.textContent = act;
    button.setAttribute("aria-label", `${act}: ${about.id}`);
    show.textContent = word("plan_show");
    show.setAttribute("aria-label", `${word("plan_show")}: ${about.id}`);
    made.toggleAttribute("data-approved", Boolean(approved));
  }

  async toggle(row) {
    const { plan_id, approved_by } = row.plan;
    try {
      row.plan = await this.api.post("/approve", { plan_id, approved: !approved_by });
      this.write(row);
      speak("plans-why", () => "");
    } catch (error) {
      speak("plans-why", () => reasonOf(error));
    }
    this.look();
  }
}
