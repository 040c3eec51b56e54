// Tab lists: robots, pages of the panel, parts of the page Setup. Arrow keys, Home and End move the focus.
import { WRITING } from "./stop.js";
import { keep, keptText } from "./store.js";

const STEPS = { ArrowLeft: -1, ArrowRight: 1 };
const PAGE = "cobot.page";
const element = (id) => document.getElementById(id);

export class Tabs {
  // chosen: called with the button that is selected.
  constructor(list, tabs, chosen) {
    this.tabs = tabs;
    this.chosen = chosen;
    for (const tab of tabs) tab.addEventListener("click", () => this.select(tab));
    list.onkeydown = (event) => this.press(event);
  }

  select(selected) {
    for (const tab of this.tabs) {
      tab.setAttribute("aria-selected", String(tab === selected));
      tab.tabIndex = tab === selected ? 0 : -1;
    }
    return this.chosen(selected);
  }

  press(event) {
    const { length } = this.tabs;
    const now = this.tabs.indexOf(document.activeElement);
    const ends = { Home: 0, End: length - 1 };
    const next = event.key in STEPS ? (now + STEPS[event.key] + length) % length : ends[event.key];
    if (now < 0 || next === undefined) return;
    event.preventDefault();
    this.tabs[next].focus();
    this.select(this.tabs[next]);
  }
}

export class Robots extends Tabs {
  // chosen: called with the robot.
  constructor(robots, chosen) {
    const list = element("robots");
    const tabs = robots.map((robot) => {
      const tab = document.createElement("button");
      tab.type = "button";
      tab.textContent = tab.dataset.robot = robot.name;
      tab.setAttribute("role", "tab");
      return tab;
    });
    list.hidden = robots.length < 2;
    list.replaceChildren(...tabs);
    super(list, tabs, (tab) => chosen(robots[tabs.indexOf(tab)]));
    this.first = tabs[Math.max(0, robots.findIndex((robot) => robot.default))];
  }

  begin() {
    return this.select(this.first);
  }
}

// Move, Program, Run, Diagnose, Setup, each with its chapter of the manual. The browser keeps which one was open.
export class Pages extends Tabs {
  // changed: called after another page is shown.
  constructor(changed) {
    const list = element("pages");
    super(list, [...list.children], (tab) => {
      for (const each of this.tabs) element(each.getAttribute("aria-controls")).hidden = each !== tab;
      document.body.dataset.page = tab.dataset.page;
      element("help").href = `manual/panel.html#${tab.dataset.page}`;
      keep("localStorage", PAGE, tab.dataset.page);
      changed();
    });
    document.addEventListener("keydown", (event) => {
      if (event.key === "?" && !event.target.closest?.(WRITING)) element("help").click();
    });
    const kept = keptText("localStorage", PAGE);
    this.select(this.tabs.find((tab) => tab.dataset.page === kept) ?? this.tabs[0]);
  }
}
