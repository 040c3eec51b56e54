// Programs that the service stores: opened into the list of waypoints, saved from it. A save on top of a version
// of another person is refused by the service: the person loads theirs, or saves under another name.
import { oneAtATime } from "./once.js";
import { inEachLanguage, named, word } from "./words.js";

const CHANGED = 412;
const MAX_LABEL = 100;
const element = (id) => document.getElementById(id);

// For addresses: what the label has of a to z and 0 to 9, and an end that makes it unique.
function idOf(label) {
  const plain = label.normalize("NFKD").toLowerCase().replace(/[^a-z0-9]+/g, "-").replace(/^-+|-+$/g, "");
  return `${plain.slice(0, 48) || "program"}-${crypto.getRandomValues(new Uint32Array(1))[0].toString(36)}`;
}

export class Stored {
  constructor(api, waypoints) {
    this.api = api;
    this.waypoints = waypoints;
    this.list = [];
    this.current = null; // {id, label, version}: what was opened or saved last
    this.words = () => "";
    this.look = oneAtATime(() => this.ask());
    element("stored").addEventListener("change", () => this.choose());
    element("stored-open").addEventListener("click", () => this.open(element("stored").value, element("stored-version").value));
    element("stored-save").addEventListener("click", () => this.save());
    element("stored-delete").addEventListener("click", () => this.remove());
    element("stored-theirs").addEventListener("click", () => this.open(this.current.id, ""));
    element("stored-other").addEventListener("click", () => this.saveAsOther());
    inEachLanguage(() => this.say(this.words));
  }

  // Of another robot.
  load() {
    this.current = null;
    this.list = [];
    element("stored-name").value = "";
    this.say(() => "");
  }

  hear({ type }) {
    if (["hello", "program"].includes(type)) this.look();
  }

  async ask() {
    const { robot } = this.api;
    const found = await this.api.get("/programs").catch(() => null);
    if (!found || robot !== this.api.robot) return;
    this.list = found.filter((each) => each.kind === "sequence");
    const chosen = element("stored").value;
    element("stored").replaceChildren(...this.list.map((each) => new Option(each.label, each.id)));
    if (this.list.some((each) => each.id === chosen)) element("stored").value = chosen;
    await this.choose();
  }

  // The versions of the one that is chosen; the first is the newest.
  async choose() {
    const id = element("stored").value;
    for (const each of ["stored", "stored-version", "stored-open", "stored-delete"]) element(each).disabled = !id;
    const versions = id ? await this.api.get(`/programs/${id}/versions`).catch(() => []) : [];
    if (id !== element("stored").value) return;
    const shown = ({ version, author, time }) => `${version} · ${named(author)} · ${new Date(time).toLocaleString(document.documentElement.lang)}`;
    const select = element("stored-version");
    const chosen = select.dataset.of === id && select.selectedIndex > 0 ? select.value : ""; // the newest one stays the newest
    select.replaceChildren(...versions.map((each) => new Option(shown(each), String(each.version))));
    select.dataset.of = id;
    if (versions.some((each) => String(each.version) === chosen)) select.value = chosen;
  }

  // An old version is shown as it was; saved, it is the newest one.
  async open(id, version) {
    try {
      const newest = await this.api.get(`/programs/${id}`);
      const found = version ? await this.api.get(`/programs/${id}?version=${version}`) : newest;
      this.know({ ...newest, label: found.label });
      this.waypoints.open(found.text, found.label);
      this.say(() => word("stored_opened", found));
    } catch (error) {
      this.say(() => error.message);
    }
  }

  know({ id, label, version }) {
    this.current = { id, label, version };
    element("stored-name").value = label;
  }

  // Under the name of the program that is open it is the next version of that one; under another name a new one.
  async save() {
    const label = element("stored-name").value.trim();
    if (!label || !this.waypoints.any) return void this.say(() => word(label ? "run_none" : "stored_nameless"));
    const known = this.current?.label === label ? this.current : null;
    const id = known?.id ?? idOf(label);
    const headers = known ? { "If-Match": `"${known.version}"` } : {};
    try {
      const body = { label, text: this.waypoints.text };
      const made = await (await this.api.ask("PUT", this.api.address(`/programs/${id}`), body, { headers })).json();
      this.know(made);
      this.say(() => word("stored_saved", made));
    } catch (error) {
      this.say(() => named(error.message));
      element("stored-conflict").hidden = !known || error.status !== CHANGED;
    }
  }

  saveAsOther() {
    const field = element("stored-name");
    const labels = new Set(this.list.map((each) => each.label));
    const free = [...labels, ""].map((_, index) => ` (${index + 2})`).find((end) => !labels.has(this.current.label.slice(0, MAX_LABEL - end.length) + end));
    field.value = this.current.label.slice(0, MAX_LABEL - free.length) + free;
    return this.save();
  }

  async remove() {
    const id = element("stored").value;
    const { label, version } = this.list.find((each) => each.id === id) ?? {};
    try {
      await this.api.ask("DELETE", this.api.address(`/programs/${id}`), undefined, { headers: { "If-Match": `"${version}"` } });
      if (this.current?.id === id) this.current = null;
      this.say(() => word("stored_deleted", { label }));
    } catch (error) {
      this.say(() => named(error.message));
    }
  }

  say(words) {
    this.words = words;
    element("stored-why").textContent = words();
    element("stored-conflict").hidden = true;
  }
}
