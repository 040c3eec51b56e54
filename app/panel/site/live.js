// The last 20 s: position, velocity, torque or tracking error of each joint, the external wrench at the TCP, or the
// cycle times. It is drawn only while it is visible.
import { shortNames } from "./joint-names.js";
import { inEachLanguage, word } from "./words.js";

const SPAN_S = 20;
const EVERY_MS = 200;
const HEIGHT = 40;
const ROOM = 0.15; // above and below the curve
const DEGREES = 180 / Math.PI;
// How much is drawn at the least, and either the unit and the factor of each joint, one that turns and one that
// slides, or the lanes by name and unit.
const QUANTITIES = {
  position: { turns: ["°", DEGREES], slides: ["mm", 1000], least: 1 },
  velocity: { turns: ["°/s", DEGREES], slides: ["mm/s", 1000], least: 1 },
  effort: { turns: ["N·m", 1], slides: ["N", 1], least: 0.5 },
  error: { turns: ["°", DEGREES], slides: ["mm", 1000], least: 0.05, digits: 3 },
  wrench: { lanes: [["Fx", "N"], ["Fy", "N"], ["Fz", "N"], ["Mx", "N·m"], ["My", "N·m"], ["Mz", "N·m"]], least: 1 },
  cycle: { lanes: [["live_period", "µs"], ["live_late", ""]], least: 10 },
};
const element = (id) => document.getElementById(id);

// As a share of the height from the top; drawn from the least to the greatest value, but no less than `least`.
function scaled(values, least) {
  const low = values.reduce((one, other) => Math.min(one, other));
  const high = values.reduce((one, other) => Math.max(one, other));
  const half = Math.max(high - low, least) * (0.5 + ROOM);
  const middle = 0.5 * (low + high);
  return (value) => 0.5 - (0.5 * (value - middle)) / half;
}

export class Live {
  constructor() {
    this.states = [];
    this.ranges = [];
    this.lanes = [];
    this.last = null; // the newest state
    this.seen = false;
    element("live-what").addEventListener("change", () => this.build());
    new IntersectionObserver(([entry]) => (this.seen = entry.isIntersecting)).observe(element("live"));
    inEachLanguage(() => this.name());
    setInterval(() => this.draw(), EVERY_MS);
  }

  get quantity() {
    return element("live-what").value;
  }

  clear() {
    this.states = [];
    this.last = null;
  }

  describe(ranges) {
    if (ranges.map(({ name }) => name).join() === this.ranges.map(({ name }) => name).join()) return;
    this.ranges = ranges;
    this.build();
  }

  build() {
    const { lanes, turns, slides } = QUANTITIES[this.quantity];
    const each = lanes ?? this.ranges.map((range) => [range.name, ...(range.slides ? slides : turns)]);
    const short = lanes ? [] : shortNames(each.map(([name]) => name));
    this.lanes = each.map(([name, unit, factor = 1], index) => {
      const [label, picture, value] = ["span", "canvas", "b"].map((tag) => document.createElement(tag));
      picture.setAttribute("role", "img");
      return { said: () => (lanes ? word(name) : name), short: short[index], unit, factor, label, picture, value };
    });
    element("live").replaceChildren(...this.lanes.flatMap(({ label, picture, value }) => [label, picture, value]));
    this.name();
  }

  name() {
    for (const { said, short, label, picture } of this.lanes) {
      const name = said();
      label.textContent = short ?? name;
      label.title = name;
      picture.setAttribute("aria-label", word("live_of", { name, what: word(`live_${this.quantity}`) }));
    }
  }

  // The robot's own clock counts: a busy page bends no curve. After a restart it begins again.
  show(state) {
    const { robot_time_s: time, position, velocity, effort, wrench, commanded_position: commanded, overruns } = state;
    if (this.last && time < this.last.robot_time_s) this.clear();
    if (this.last?.robot_time_s !== time) {
      const error = commanded.map((value, joint) => value - position[joint]);
      this.states.push({ time, position, velocity, effort, error, wrench, cycle: [this.period(state), overruns] });
    }
    this.last = state;
    const old = this.states.findIndex((each) => each.time >= time - SPAN_S);
    if (old > 0) this.states.splice(0, old);
  }

  // Of the cycles since the newest state, on average, µs.
  period({ cycle, monotonic_ns: now }) {
    const cycles = this.last ? cycle - this.last.cycle : 0;
    return cycles > 0 ? (now - this.last.monotonic_ns) / 1000 / cycles : (this.states.at(-1)?.cycle[0] ?? 0);
  }

  draw() {
    if (!this.seen || document.hidden || this.states.length < 2) return;
    this.lanes.forEach((lane, index) => this.drawLane(lane, index));
  }

  drawLane({ picture, value, unit, factor }, index) {
    const { least, digits = 1 } = QUANTITIES[this.quantity];
    const end = this.states.at(-1).time;
    const values = this.states.map((state) => factor * (state[this.quantity][index] ?? 0));
    const width = picture.clientWidth;
    const sharp = Math.min(devicePixelRatio, 2);
    [picture.width, picture.height] = [width * sharp, HEIGHT * sharp]; // which empties it
    const down = scaled(values, least);
    const pen = picture.getContext("2d");
    pen.scale(sharp, sharp);
    pen.strokeStyle = getComputedStyle(picture).color;
    pen.lineWidth = 1.5;
    pen.beginPath();
    values.forEach((each, point) => {
      pen.lineTo(width * (1 - (end - this.states[point].time) / SPAN_S), HEIGHT * down(each));
    });
    pen.stroke();
    const shown = values.at(-1).toFixed(unit ? digits : 0).replace(/^-(0(?:\.0+)?)$/, "$1"); // never -0.0
    value.textContent = `${shown} ${unit}`;
  }
}
