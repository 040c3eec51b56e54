// Positions and velocities of each joint over time, with their limits: of a file, or of a planned motion.
import { withShortNames } from "./joint-names.js";
import { curve } from "./lines.js";
import { inEachLanguage, word } from "./words.js";

const element = (id) => document.getElementById(id);

// range: the joint, of GET /robot/geometry; positions and velocities: [time, value] each.
export function row({ range, positions, velocities, more = "" }) {
  const { name, min_position: low, max_position: high, max_velocity: most } = range;
  const joint = withShortNames(name);
  const label = document.createElement("b");
  label.textContent = `${joint} ${more}`.trim();
  label.title = name;
  return [
    label,
    curve(positions, [low, high], word("plot_position", { name: joint })),
    curve(velocities, [-most, most], word("plot_velocity", { name: joint })),
  ];
}

// Of what the ghost shows: as it was planned, with the share of its velocity limit that each joint takes.
export class Planned {
  constructor(ranges) {
    this.ranges = ranges;
    this.plan = null;
    inEachLanguage(() => this.write());
  }

  show(plan) {
    this.plan = plan?.duration_s ? plan : null;
    this.write();
  }

  write() {
    const { path = [], utilisation } = this.plan ?? {};
    element("planned").hidden = !path.length;
    const over = (values, joint) => path.map((point) => [point.time_s, point[values][joint]]);
    const rows = (path.length ? this.ranges() : []).flatMap((range, joint) => row({
      range, positions: over("joints", joint), velocities: over("velocities", joint),
      more: `${Math.round(100 * utilisation.velocity.share[joint])} %`,
    }));
    element("planned-plots").replaceChildren(...rows);
  }
}
