// The tool: its name, mass and TCP. Only edited fields are sent, so that two
// users who change different fields do not overwrite each other.
import { abcOf } from "./kinematics.js";
import { changed, placeFields, poseFields } from "./numbers.js";
import { reasonOf } from "./reasons.js";
import { Tip } from "./tip.js";
import { speak, word } from "./words.js";

const element = (id) => document.getElementById(id);

export class Tool {
  constructor(api, state) {
    this.api = api;
    this.tool = null; // as the fields have it
    this.tcp = poseFields(element("tool-tcp"));
    this.centre = placeFields(element("tool-centre"));
    this.tip = new Tip(api, state, async (position) => this.put({ tcp: this.pointed(position, await api.get("/tool")) }));
    element("tool").addEventListener("submit", (event) => {
      event.preventDefault();
      this.save();
    });
    element("tool-undo").addEventListener("click", () => this.look(true));
  }

  // Another robot was chosen.
  choose() {
    this.tool = null;
    this.tip.clear();
    this.say(() => "");
  }

  get typed() {
    return [element("tool-name"), element("tool-mass")].some(changed) || this.tcp.changed || this.centre.changed;
  }

  // discard: drop edits that were not saved.
  async look(discard = false) {
    const { robot } = this.api;
    const tool = await this.api.get("/tool").catch(() => null);
    if (!tool || robot !== this.api.robot) return;
    if (this.tool && this.typed && !discard) {
      if (tool.version !== this.tool.version) this.say(() => word("tool_changed"), "warn");
      return;
    }
    this.fill(tool);
    if (discard) this.say(() => "");
  }

  fill(tool) {
    this.tool = tool;
    for (const [id, value] of [["tool-name", tool.name], ["tool-mass", Number(tool.mass.toFixed(4))]]) {
      element(id).value = element(id).defaultValue = value;
    }
    this.tcp.set([...tool.position, ...abcOf(tool.quaternion)]);
    this.centre.set(tool.centre);
  }

  // The orientation stays.
  pointed([x, y, z], { quaternion }) {
    return { x, y, z, quaternion };
  }

  // tool: the newest one. Fields that were not edited show its values.
  changes(tool) {
    const found = {};
    const mass = element("tool-mass");
    if (changed(element("tool-name"))) found.name = element("tool-name").value.trim();
    if (changed(mass) || this.centre.changed) {
      found.mass = changed(mass) ? mass.valueAsNumber : tool.mass;
      if (found.mass) found.centre = this.centre.values(tool.centre);
      if (found.mass && !changed(mass) && tool.inertia) found.inertia = tool.inertia;
    }
    if (this.tcp.changed) {
      const [x, y, z, a, b, c] = this.tcp.values([...tool.position, ...abcOf(tool.quaternion)]);
      const turned = this.tcp.rows.slice(3).some(({ field }) => changed(field));
      found.tcp = turned ? { x, y, z, a, b, c } : this.pointed([x, y, z], tool);
    }
    return found;
  }

  async save() {
    if (!this.tool || !this.typed) return;
    const numbers = [...this.tcp.values(), ...this.centre.values(), element("tool-mass").valueAsNumber];
    if (!numbers.every(Number.isFinite)) return void this.say(() => word("number_missing"), "warn");
    try {
      const tool = await this.api.get("/tool");
      const changes = this.changes(tool);
      await this.put(changes);
      const lost = tool.inertia && "mass" in changes && !changes.inertia;
      this.say(() => word(lost ? "tool_point_mass" : "tool_saved"), "good");
    } catch (error) {
      this.say(() => reasonOf(error), "warn");
    }
  }

  async put(changes) {
    this.fill(await this.api.post("/tool", changes));
  }

  say(words, level = "") {
    speak("tool-why", words);
    element("tool-why").dataset.level = level;
  }
}
