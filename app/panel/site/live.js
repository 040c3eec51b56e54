// The last 20 s of each joint: position, velocity or torque. Drawn as long as somebody can see it.
import { inEachLanguage, word } from "./words.js";

const SPAN_S = 20;
const EVERY_MS = 200;
const HEIGHT = 40;
const ROOM = 0.15; // above and below the curve
const DEGREES = 180 / Math.PI;
// Of each quantity: its field of the state, its unit and factor for what turns and for what slides, and how much
// of it is drawn at the least.
const QUANTITIES = {
  position: { turns: ["°", DEGREES], slides: ["mm", 1000], least: 1, word: "live_position" },
  velocity: { turns: ["°/s", DEGREES], slides: ["mm/s", 1000], least: 1, word: "live_velocity" },
  effort: { turns: ["N·m", 1], slides: ["N", 1], least: 0.5, word: "live_effort" },
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
    this.seen = false;
    element("live-what").addEventListener("change", () => this.name());
    new IntersectionObserver(([entry]) => (this.seen = entry.isIntersecting)).observe(element("live"));
    inEachLanguage(() => this.name());
    setInterval(() => this.draw(), EVERY_MS);
  }

  get quantity() {
    return element("live-what").value;
  }

  clear() {
    this.states = [];
  }

  describe(ranges) {
    if (ranges.map(({ name }) => name).join() === this.ranges.map(({ name }) => name).join()) return;
    this.ranges = ranges;
    this.lanes = ranges.map(() => {
      const [label, picture, value] = ["span", "canvas", "b"].map((tag) => document.createElement(tag));
      picture.setAttribute("role", "img");
      return { label, picture, value };
    });
    element("live").replaceChildren(...this.lanes.flatMap(({ label, picture, value }) => [label, picture, value]));
    this.name();
  }

  name() {
    this.lanes.forEach(({ label, picture }, index) => {
      const { name } = this.ranges[index];
      label.textContent = name;
      picture.setAttribute("aria-label", word("live_of", { name, what: word(QUANTITIES[this.quantity].word) }));
    });
  }

  // The robot's own clock counts: a busy page bends no curve. After a restart it begins again.
  show({ robot_time_s: time, position, velocity, effort }) {
    const last = this.states.at(-1);
    if (last && time < last.time) this.clear();
    if (last?.time !== time) this.states.push({ time, position, velocity, effort });
    const old = this.states.findIndex((state) => state.time >= time - SPAN_S);
    if (old > 0) this.states.splice(0, old);
  }

  draw() {
    if (!this.seen || document.hidden || this.states.length < 2) return;
    this.lanes.forEach((lane, index) => this.drawLane(lane, index));
  }

  drawLane({ picture, value }, index) {
    const { slides } = this.ranges[index];
    const { least, ...units } = QUANTITIES[this.quantity];
    const [unit, factor] = slides ? units.slides : units.turns;
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
    value.textContent = `${values.at(-1).toFixed(1)} ${unit}`;
  }
}
