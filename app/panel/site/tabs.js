// A tab for each robot. Left and right, Home and End go from one to the next, as in every list of tabs.
const STEPS = { ArrowLeft: -1, ArrowRight: 1 };

export class Tabs {
  // chosen: called with the robot.
  constructor(robots, chosen) {
    this.robots = robots;
    this.chosen = chosen;
    const list = document.getElementById("robots");
    list.hidden = robots.length < 2;
    this.tabs = robots.map((robot) => {
      const tab = document.createElement("button");
      tab.type = "button";
      tab.textContent = robot.name;
      tab.dataset.robot = robot.name;
      tab.setAttribute("role", "tab");
      tab.addEventListener("click", () => this.choose(robot));
      return tab;
    });
    list.replaceChildren(...this.tabs);
    list.onkeydown = (event) => this.press(event);
  }

  begin() {
    return this.choose(this.robots.find((robot) => robot.default) ?? this.robots[0]);
  }

  choose(robot) {
    for (const tab of this.tabs) {
      const selected = tab.dataset.robot === robot.name;
      tab.setAttribute("aria-selected", String(selected));
      tab.tabIndex = selected ? 0 : -1;
    }
    return this.chosen(robot);
  }

  press(event) {
    const { length } = this.tabs;
    const now = this.tabs.indexOf(document.activeElement);
    const ends = { Home: 0, End: length - 1 };
    const next = event.key in STEPS ? (now + STEPS[event.key] + length) % length : ends[event.key];
    if (now < 0 || next === undefined) return;
    event.preventDefault();
    this.tabs[next].focus();
    this.choose(this.robots[next]);
  }
}
