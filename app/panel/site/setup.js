// The page Setup: its parts, and the limits of the joints as the service has them.
import { Archives } from "./archives.js";
import { shortNames } from "./joint-names.js";
import { tcpOf } from "./kinematics.js";
import { People } from "./people.js";
import { Surroundings } from "./solids.js";
import { Studies } from "./studies.js";
import { Tabs } from "./tabs.js";
import { Tool } from "./tool.js";
import { inEachLanguage, word } from "./words.js";

const LOOKED_AT = ["hello", "scene", "tool"];
const element = (id) => document.getElementById(id);

function cell(tag, text) {
  const made = document.createElement(tag);
  made.textContent = text;
  return made;
}

export class Setup {
  // now: {state, geometry, view}; each may be missing.
  constructor(api, now) {
    this.tool = new Tool(api, () => now().state);
    this.surroundings = new Surroundings(api, () => {
      const { state, geometry } = now();
      return state && geometry ? tcpOf(geometry, state.commanded_position) : null;
    });
    this.archives = new Archives(api);
    this.people = new People(api);
    this.studies = new Studies(api, () => now().view);
    this.ranges = [];
    const tabs = [...element("parts").children];
    this.parts = new Tabs(element("parts"), tabs, (chosen) => {
      for (const tab of tabs) element(tab.getAttribute("aria-controls")).hidden = tab !== chosen;
      this.people.look();
    });
    this.parts.select(tabs[0]);
    inEachLanguage(() => this.write());
  }

  // Another robot was chosen.
  choose() {
    this.tool.choose();
    this.surroundings.choose();
    this.studies.clear();
  }

  hear(event) {
    if (LOOKED_AT.includes(event.type)) this.look();
    this.studies.hear(event);
  }

  describe(ranges) {
    this.ranges = ranges;
    this.write();
  }

  look() {
    this.tool.look();
    this.surroundings.look();
  }

  write() {
    const head = document.createElement("tr");
    head.append(...["limit_joint", "limit_range", "limit_velocity", "limit_effort"].map((name) => cell("th", word(name))));
    const names = shortNames(this.ranges.map(({ name }) => name));
    const rows = this.ranges.map(({ name, slides, min_position: low, max_position: high, max_velocity: speed, max_effort: effort }, index) => {
      const [scale, unit] = slides ? [1000, "mm"] : [180 / Math.PI, "°"];
      const row = document.createElement("tr");
      row.append(
        cell("td", names[index] === name ? name : `${names[index]} (${name})`),
        cell("td", `${(scale * low).toFixed(1)} … ${(scale * high).toFixed(1)} ${unit}`),
        cell("td", `${(scale * speed).toFixed(0)} ${unit}/s`),
        cell("td", `${effort.toFixed(0)} ${slides ? "N" : "N·m"}`),
      );
      return row;
    });
    element("limits").replaceChildren(head, ...rows);
  }
}
