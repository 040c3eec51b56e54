// A trajectory of a CSV or JSON file. It is shown first, each joint with its limits, and then sent.
import { LONG_MS } from "./api.js";
import { withShortNames } from "./joint-names.js";
import { row } from "./plots.js";
import { fromRest, read, readJson, velocityCurve } from "./points.js";
import { reasonOf } from "./reasons.js";
import { speak, word } from "./words.js";

const OPTIONS = { move_to_start: "csv-start", retime: "csv-retime" };
const TOLERANCE = 1e-9; // of a limit
const isJson = (file) => file.name.toLowerCase().endsWith(".json");
const element = (id) => document.getElementById(id);

export class Csv {
  constructor(api, state, ranges) {
    this.api = api;
    this.state = state;
    this.ranges = ranges;
    element("csv-choose").addEventListener("click", () => element("csv-file").click());
    element("csv-file").addEventListener("change", () => this.open(element("csv-file").files[0]));
    element("csv-send").addEventListener("click", () => this.send());
    this.accept(element("csv-send").closest(".card"));
    this.forget();
  }

  accept(card) {
    card.addEventListener("dragover", (event) => {
      event.preventDefault();
      card.toggleAttribute("data-over", true);
    });
    card.addEventListener("dragleave", () => card.removeAttribute("data-over"));
    card.addEventListener("drop", (event) => {
      event.preventDefault();
      card.removeAttribute("data-over");
      this.open(event.dataTransfer.files[0]);
    });
  }

  forget() {
    this.file = this.shown = null;
    this.say(() => word("csv_hint"));
  }

  async open(file) {
    if (!file) return;
    element("csv-file").value = ""; // the same file may be chosen again
    const [ranges, state] = [this.ranges(), this.state()];
    const reads = isJson(file) ? readJson : read;
    const found = state && reads(await file.text(), ranges.length);
    if (!found) {
      this.file = this.shown = null;
      this.say(() => word("csv_none", { name: file.name, count: ranges.length }));
      return;
    }
    const { times, positions, velocities, accelerations } = fromRest(found, state.commanded_position);
    this.file = file;
    this.shown = ranges.map((range, joint) => ({
      range,
      positions: times.map((time, index) => [time, positions[joint][index]]),
      velocities: velocityCurve(times, positions[joint], velocities?.[joint], accelerations?.[joint]),
    }));
    const count = found.times.length;
    this.say(() => [word("csv_read", { name: file.name, count, seconds: times.at(-1).toFixed(2) }), ...this.beyond()].join(" "));
  }

  // What is beyond a limit, in words; the service says it more exactly.
  beyond() {
    return this.shown.flatMap(({ range, positions, velocities }) => {
      const most = velocities.reduce((one, [, value]) => Math.max(one, Math.abs(value)), 0);
      const [unit, scale] = range.slides ? ["mm", 1000] : ["°", 180 / Math.PI];
      const said = [];
      if (positions.some(([, value]) => value < range.min_position - TOLERANCE || value > range.max_position + TOLERANCE)) {
        said.push(word("csv_position", { name: withShortNames(range.name) }));
      }
      if (most > range.max_velocity + TOLERANCE) {
        const values = { name: withShortNames(range.name), unit, value: (scale * most).toFixed(1), limit: (scale * range.max_velocity).toFixed(1) };
        said.push(word("csv_velocity", values));
      }
      return said;
    });
  }

  async send() {
    element("csv-send").disabled = true;
    this.say(() => word("csv_sending"));
    try {
      const sent = await this.post(Object.keys(OPTIONS).filter((name) => element(OPTIONS[name]).checked));
      this.say(() => word("csv_sent", { seconds: sent.duration_s.toFixed(1), note: sent.note }));
    } catch (error) {
      this.say(() => reasonOf(error));
      element("csv-why").title = error.message;
    }
  }

  // options: names of those that are chosen. They are added to those in a JSON file.
  async post(options) {
    const chosen = Object.fromEntries(options.map((name) => [name, true]));
    if (isJson(this.file)) return this.api.post("/trajectory/send", { ...JSON.parse(await this.file.text()), ...chosen }, { waitMs: LONG_MS });
    const body = new FormData();
    body.append("file", this.file);
    return this.api.post(`/trajectory/send_csv?${new URLSearchParams(chosen)}`, body, { waitMs: LONG_MS });
  }

  say(words) {
    speak("csv-why", words);
    element("csv-why").title = "";
    this.write();
  }

  write() {
    element("csv-send").disabled = !this.file;
    element("csv-plots").replaceChildren(...(this.shown ?? []).flatMap(row));
  }
}
