// The page Setup: the tool, the limits of the joints and the surroundings, as the service has them.
import { inEachLanguage, word } from "./words.js";

const LOOKED_AT = ["hello", "scene", "tool"];
const element = (id) => document.getElementById(id);

function cell(tag, text) {
  const made = document.createElement(tag);
  made.textContent = text;
  return made;
}

const millimetres = (values) => `${values.map((value) => (1000 * value).toFixed(1)).join(", ")} mm`;

export class Setup {
  constructor(api) {
    this.api = api;
    this.tool = this.scene = null;
    this.ranges = [];
    inEachLanguage(() => this.write());
  }

  hear(event) {
    if (LOOKED_AT.includes(event.type)) this.look();
  }

  describe(ranges) {
    this.ranges = ranges;
    this.write();
  }

  async look() {
    const { robot } = this.api;
    const [tool, scene] = await Promise.all([
      this.api.get("/tool").catch(() => null),
      this.api.get("/scene").catch(() => null),
    ]);
    if (robot !== this.api.robot) return;
    [this.tool, this.scene] = [tool, scene];
    this.write();
  }

  write() {
    if (this.tool) this.writeTool(this.tool);
    this.writeLimits();
    if (this.scene) this.writeScene(this.scene.objects);
  }

  writeTool({ name, mass, centre, position }) {
    const lines = [
      ["tool_name", name || word("tool_none")],
      ["tool_tcp", millimetres(position)],
      ["tool_mass", `${mass.toFixed(2)} kg`],
      ["tool_centre", millimetres(centre)],
    ];
    element("tool-all").replaceChildren(...lines.flatMap(([name, text]) => [cell("dt", word(name)), cell("dd", text)]));
  }

  writeLimits() {
    const head = document.createElement("tr");
    head.append(...["limit_joint", "limit_range", "limit_velocity", "limit_effort"].map((name) => cell("th", word(name))));
    const rows = this.ranges.map(({ name, slides, min_position: low, max_position: high, max_velocity: speed, max_effort: effort }) => {
      const [scale, unit] = slides ? [1000, "mm"] : [180 / Math.PI, "°"];
      const row = document.createElement("tr");
      row.append(
        cell("td", name),
        cell("td", `${(scale * low).toFixed(1)} … ${(scale * high).toFixed(1)} ${unit}`),
        cell("td", `${(scale * speed).toFixed(0)} ${unit}/s`),
        cell("td", `${effort.toFixed(0)} ${slides ? "N" : "N·m"}`),
      );
      return row;
    });
    element("limits").replaceChildren(head, ...rows);
  }

  writeScene(objects) {
    const rows = objects.map(({ name, shape }) => cell("li", `${name} (${word(`shape_${shape}`, {}, shape)})`));
    element("scene-all").replaceChildren(...(rows.length ? rows : [cell("li", word("scene_none"))]));
  }
}
