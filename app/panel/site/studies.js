// The studies of the service: how far they are, the map of a reach study around the arm, and the best placement.
import { allow } from "./able.js";
import { oneAtATime } from "./once.js";
import { reasonOf } from "./reasons.js";
import { inEachLanguage, speak, word } from "./words.js";

const EVERY_MS = 2000; // while they are shown: progress is no event
const REACHED = 0.85; // opacity of the points
const MISSED = [0.55, 0.58, 0.62, 0.15]; // colour and opacity of a place that is not reached
const COUNTS = ["done", "tasks"]; // in an answer, and shown above it
const element = (id) => document.getElementById(id);

// The colour of a share of the scale, RGB, 0 to 1.
function colourOf(scale, share) {
  const place = Math.min(Math.max(share, 0), 1) * (scale.length - 1);
  const index = Math.min(Math.floor(place), scale.length - 2);
  return scale[index].map((low, channel) => (low + (place - index) * (scale[index + 1][channel] - low)) / 255);
}

export class Studies {
  constructor(api, view) {
    this.api = api;
    this.view = view;
    this.list = [];
    this.map = null; // the one that is shown
    this.look = oneAtATime(() => this.ask());
    element("study").addEventListener("change", () => this.choose());
    element("study-cancel").addEventListener("click", () => this.cancel());
    element("study-map").addEventListener("click", () => (this.map ? this.show(null) : this.fetch()));
    element("study-metric").addEventListener("change", () => this.draw());
    element("study-tool").addEventListener("click", () => this.setTcp());
    setInterval(() => element("studies-title").checkVisibility() && this.look(), EVERY_MS);
    inEachLanguage(() => this.write());
  }

  // Also after another robot was chosen.
  clear() {
    this.list = [];
    this.choose();
  }

  hear({ type, data }) {
    if (type === "hello" || (type === "job" && data.kind === "study")) this.look();
  }

  get chosen() {
    return this.list.find((each) => each.id === element("study").value);
  }

  async ask() {
    const { robot } = this.api;
    const found = await this.api.get("/studies").catch(() => null);
    if (!found || robot !== this.api.robot) return;
    this.list = found.studies;
    const before = element("study").value;
    fill(element("study"), this.list.map(({ id, question }) => [id, question]));
    if (element("study").value === before) this.write();
    else this.show(null);
  }

  choose() {
    this.show(null);
    this.say(() => "");
  }

  cancel() {
    return this.act(() => this.api.post(`/jobs/${this.chosen.job}/cancel`));
  }

  fetch() {
    const { id } = this.chosen;
    return this.act(async () => {
      const map = await this.api.get(`/studies/${id}/map`);
      if (id === this.chosen?.id) this.show(map);
    });
  }

  async setTcp() {
    const [x, y, z, w, ...vector] = this.chosen.placement.tcp;
    await this.act(async () => {
      await this.api.post("/tool", { tcp: { x, y, z, quaternion: [...vector, w] } });
      this.say(() => word("tip_is_set"));
    });
  }

  async act(what) {
    this.say(() => "");
    try {
      await what();
    } catch (error) {
      this.say(() => reasonOf(error));
    }
  }

  // map: null for none.
  show(map) {
    this.map = map;
    this.write();
    this.draw();
  }

  // The points and the scale in the colours of the chosen result.
  draw() {
    if (!this.map) return void this.view()?.showMap(null);
    const { x, y, z, values, ranges, scale, spacing } = this.map;
    const metric = element("study-metric").value;
    const [low, high] = ranges[metric];
    const colours = values[metric].map((value) => (value === null ? MISSED : [...colourOf(scale, (value - low) / (high - low || 1)), REACHED]));
    this.view()?.showMap({ positions: x.map((each, index) => [each, y[index], z[index]]), colours, spacing });
    element("study-low").textContent = low.toPrecision(3);
    element("study-high").textContent = high.toPrecision(3);
    const bar = element("study-scale");
    const pen = bar.getContext("2d");
    for (let column = 0; column < bar.width; column += 1) {
      pen.fillStyle = `rgb(${colourOf(scale, column / (bar.width - 1)).map((each) => Math.round(255 * each)).join(",")})`;
      pen.fillRect(column, 0, 1, bar.height);
    }
  }

  say(words) {
    speak("study-why", words);
    this.write();
  }

  write() {
    const { chosen, map } = this;
    element("study-choice").hidden = !chosen;
    allow(element("study-cancel"), chosen?.state === "running" ? "" : "study_idle");
    element("study-state").textContent = chosen ? stateText(chosen) : word("study_none");
    const answer = Object.entries(chosen?.answer ?? {}).filter(([name]) => !COUNTS.includes(name));
    element("study-answer").replaceChildren(...answer.flatMap(([name, value]) => row(name, value)));
    this.writeMap(chosen, map);
    this.writePlacement(chosen);
  }

  writeMap(chosen, map) {
    element("map-card").hidden = !chosen?.maps;
    element("study-map").textContent = word(map ? "study_hide" : "study_show");
    element("study-legend").hidden = !map;
    if (!map) return;
    fill(element("study-metric"), map.metrics.map((name) => [name, word(`study_${name}`, {}, name)]));
    element("study-thinned").textContent = map.every > 1 ? word("study_thinned", map) : "";
  }

  writePlacement(chosen) {
    const placement = chosen?.placement;
    element("placement-card").hidden = !placement;
    const varied = Object.keys(chosen?.document.space ?? {});
    element("study-base").hidden = !varied.some((name) => name.startsWith("base_"));
    element("study-tool").hidden = !varied.some((name) => name.startsWith("tcp_"));
    if (placement) element("study-base").textContent = baseText(placement);
  }
}

function stateText({ state, left_s: left, ...study }) {
  const rest = typeof left === "number" ? word("job_left", { seconds: left.toFixed(0) }) : "";
  return [word(`study_${state}`, study), rest].filter(Boolean).join(" · ");
}

// No setting has the pose of the base: everything is given in its frame.
function baseText({ base: [x, y, z, w, , , sine] }) {
  const [forward, left, up] = [x, y, z].map((each) => (1000 * each).toFixed(1));
  return word("study_base", { x: forward, y: left, z: up, yaw: ((360 / Math.PI) * Math.atan2(sine, w)).toFixed(2) });
}

// options: [value, text]. A list that is open stays open unless they change.
function fill(select, options) {
  const same = ([value, text], index) => select.options[index]?.value === value && select.options[index].text === text;
  if (options.length === select.options.length && options.every(same)) return;
  const before = select.value;
  select.replaceChildren(...options.map(([value, text]) => new Option(text, value)));
  if (options.some(([value]) => value === before)) select.value = before;
}

function row(name, value) {
  const [term, text] = ["dt", "dd"].map((tag) => document.createElement(tag));
  term.textContent = name;
  text.textContent = shown(value);
  return [term, text];
}

// Numbers with four digits, and lists and objects in one line.
function shown(value) {
  if (typeof value === "number") return String(Number.isInteger(value) ? value : Number(value.toPrecision(4)));
  if (Array.isArray(value)) return value.map(shown).join(", ");
  if (value && typeof value === "object") return Object.entries(value).map(([name, each]) => `${name}: ${shown(each)}`).join(", ");
  return value === null ? "–" : String(value);
}
