// What moves the robot: what it can do, how it says that it is, and what the first contact with it has found.
import { withShortNames } from "./joint-names.js";
import { reasonOf } from "./reasons.js";
import { inEachLanguage, speak, word } from "./words.js";

const element = (id) => document.getElementById(id);

export class Device {
  constructor(api) {
    this.api = api;
    this.told = null;
    this.shown = "";
    element("acknowledge").addEventListener("click", () => this.acknowledge());
    inEachLanguage(() => this.write());
  }

  // Of GET /robots; null while it cannot be read.
  tell(device) {
    this.told = device ?? null;
    this.write();
  }

  write() {
    const shown = `${JSON.stringify(this.told)} ${document.documentElement.lang}`;
    if (shown === this.shown) return;
    this.shown = shown;
    this.writeStatus(this.told?.status);
    element("device-card").hidden = !this.told;
    element("device-all").replaceChildren(...(this.told ? this.rows(this.told) : []).flat());
    const found = this.told?.unacknowledged ?? "";
    element("contact").hidden = !found;
    element("contact-found").textContent = withShortNames(found);
  }

  // In the head of the page, of which a simulation says nothing.
  writeStatus(status) {
    const place = element("device");
    element("device-part").hidden = !status;
    if (!status) return;
    const { connection, quality, operation_mode: mode, drives, safety_stop: stop, text } = status;
    const parts = stop ? [mode, stop] : [mode, connection, quality, drives && word("device_drives_are", { drives })];
    place.textContent = parts.filter(Boolean).join(", ");
    place.dataset.level = stop ? "bad" : "";
    place.title = text;
  }

  rows({ backend, hardware, able, measured, stops, periods_s: periods, speed_share: share, drives_off: off, status }) {
    const categories = Object.entries(stops).map(([category, confirms]) => word(confirms ? "device_confirms" : "device_does", { category }));
    const lines = [
      ["device_backend", `${backend}: ${word(hardware ? "device_real" : "device_simulated")}`],
      ["device_able", able.map((each) => word(`able_${each}`)).join(", ")],
      ["device_measured", measured.map((each) => word(`measured_${each}`)).join(", ")],
      ["device_stops", categories.join(", ")],
      ["device_periods", periods.map((each) => `${1000 * each} ms`).join(", ")],
      ["device_share", `${Math.round(100 * share)} %`],
      ["device_off", off ? word("device_off_by_stop") : ""],
      ["device_connection", [status?.connection, status?.quality].filter(Boolean).join(", ")],
      ["device_mode", status?.operation_mode],
      ["device_stop", status?.safety_stop],
      ["device_drives", status?.drives],
      ["device_brakes", status?.brakes],
      ["device_scaling", status && `${Math.round(100 * status.speed_scaling)} %`],
      ["device_lost", status && String(status.packets_lost)],
      ["device_text", status?.text],
    ];
    return lines.filter(([, text]) => text).map(([name, text]) => {
      const [term, said] = ["dt", "dd"].map((tag) => document.createElement(tag));
      [term.textContent, said.textContent] = [word(name), text];
      said.dataset.about = name;
      return [term, said];
    });
  }

  // Who presses it says to have compared the arm with what was found.
  async acknowledge() {
    const button = element("acknowledge");
    button.disabled = true;
    speak("contact-why", () => "");
    try {
      await this.api.post("/acknowledge", { payload_checked: element("contact-payload").checked });
      element("contact-payload").checked = false;
      this.tell({ ...this.told, unacknowledged: "" });
    } catch (error) {
      speak("contact-why", () => reasonOf(error));
    }
    button.disabled = false;
  }
}
