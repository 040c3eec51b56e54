// Stored programs: opened and saved here. The service rejects a save over a version that another client has made:
// the user loads that version or saves under another name. Unsaved changes stay in this browser.
import { allow } from "./able.js";
import { idOf } from "./ids.js";
import { oneAtATime } from "./once.js";
import { reasonOf } from "./reasons.js";
import { inEachLanguage, named, speak, word } from "./words.js";

const CHANGED = 412;
const MAX_LABEL = 100;
const element = (id) => document.getElementById(id);

export class Stored {
  constructor(api, page) {
    this.api = api;
    this.page = page;
    this.program = page.program;
    this.list = [];
    this.saving = false;
    this.listeners = [];
    this.conflict = null; // returns why a save would be refused; null for no reason
    this.look = oneAtATime(() => this.ask());
    element("stored").addEventListener("change", () => this.choose());
    element("stored-open").addEventListener("click", () => this.open(element("stored").value, element("stored-version").value));
    element("stored-delete").addEventListener("click", () => this.remove());
    element("program-save").addEventListener("click", () => this.save());
    element("stored-copy").addEventListener("click", () => this.saveAsOther());
    element("stored-theirs").addEventListener("click", () => this.open(this.program.document.id, ""));
    element("stored-other").addEventListener("click", () => this.saveAsOther());
    page.onChange(() => this.write());
    inEachLanguage(() => this.write());
  }

  // Another robot was chosen.
  load() {
    this.list = [];
    this.conflict = null;
    element("stored").dataset.shown = "";
  }

  // heard: called after each change of the list.
  onList(heard) {
    this.listeners.push(heard);
  }

  hear({ type }) {
    if (["hello", "program"].includes(type)) this.look();
  }

  async ask() {
    const { robot } = this.api;
    const found = await this.api.get("/programs").catch(() => null);
    if (!found || robot !== this.api.robot) return;
    this.list = found;
    for (const heard of this.listeners) heard();
    const chosen = element("stored").value;
    element("stored").replaceChildren(...found.map((each) => new Option(this.title(each), each.id)));
    if (found.some((each) => each.id === chosen)) element("stored").value = chosen;
    await this.choose();
    this.compare();
  }

  title({ label, kind, example }) {
    const about = [kind === "lua" ? "Lua" : "", example ? word("example") : ""].filter(Boolean).join(", ");
    return about ? `${label} (${about})` : label;
  }

  // Whether another client has saved or deleted the open program.
  async compare() {
    const { id, version } = this.program.document;
    if (!id || this.saving) return;
    const newest = this.list.find((each) => each.id === id);
    this.conflict = null;
    if (newest && newest.version <= version) return void this.write();
    if (newest && !this.program.isChanged) return void (await this.open(id, ""));
    this.conflict = () => (newest ? word("stored_newer", { ...newest, author: named(newest.author) }) : word("stored_gone"));
    this.write();
  }

  // The versions of the one that is chosen; the first is the newest.
  async choose() {
    const id = element("stored").value;
    for (const each of ["stored", "stored-version", "stored-open"]) element(each).disabled = !id;
    const isExample = Boolean(this.list.find((each) => each.id === id)?.example);
    allow(element("stored-delete"), isExample ? "why_example" : id ? "" : "why_none_chosen");
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
    element("program-menu").open = false;
    try {
      const newest = await this.api.get(`/programs/${id}`);
      const found = version ? await this.api.get(`/programs/${id}?version=${version}`) : newest;
      this.conflict = null;
      if (found.example) {
        this.program.open({ ...found, id: null, version: null, example: id });
        this.write();
        return void this.page.say(() => word("example_opened", found));
      }
      this.program.open({ ...found, version: newest.version });
      if (found.version !== newest.version) this.program.document.saved = "";
      this.write();
      this.page.say(() => word("stored_opened", found));
    } catch (error) {
      this.page.say(() => reasonOf(error));
    }
  }

  // Saves the next version of the open program, or the first one of a new program.
  async save() {
    const { label, id, version, kind, opened } = this.program.document;
    if (!label.trim() || this.program.isEmpty) {
      if (!label.trim()) element("program-name").focus();
      return void this.page.say(() => word(label.trim() ? "run_none" : "stored_nameless"));
    }
    const made = id ?? idOf(label, "program");
    const headers = id ? { "If-Match": `"${version}"` } : {};
    const { state, text } = this.program;
    this.saving = true;
    this.write();
    try {
      const saved = await (await this.api.ask("PUT", this.api.address(`/programs/${made}`), { label: label.trim(), kind, text }, { headers })).json();
      this.conflict = null;
      this.program.savedAs(saved, { state, opened });
      this.page.say(() => word("stored_saved", saved));
    } catch (error) {
      if (error.status === CHANGED) this.conflict = () => reasonOf(error);
      this.page.say(() => word("stored_unsaved", { why: reasonOf(error) }));
      if (kind === "sequence" && !this.program.content) this.page.markWrong(error.message);
    }
    this.saving = false;
    this.write();
    this.look();
  }

  // Saves the program as a new one, under a name that is free.
  saveAsOther() {
    element("program-menu").open = false;
    const { label } = this.program.document;
    const labels = new Set(this.list.map((each) => each.label));
    const cut = (end) => label.slice(0, MAX_LABEL - end.length) + end;
    const free = ["", ...[...labels, ""].map((_, index) => ` (${index + 2})`)].find((end) => label && !labels.has(cut(end))) ?? "";
    this.conflict = null;
    this.program.becomeNew(cut(free));
    return this.save();
  }

  async remove() {
    element("program-menu").open = false;
    const id = element("stored").value;
    const { label, version } = this.list.find((each) => each.id === id) ?? {};
    try {
      await this.api.ask("DELETE", this.api.address(`/programs/${id}`), undefined, { headers: { "If-Match": `"${version}"` } });
      if (this.program.document.id === id) this.program.becomeNew(this.program.document.label);
      this.page.say(() => word("stored_deleted", { label }));
    } catch (error) {
      this.page.say(() => reasonOf(error));
    }
  }

  write() {
    const { id, version } = this.program.document;
    const { isChanged, isEmpty } = this.program;
    const state = [id ? word("stored_as", { version }) : "", isChanged ? word("stored_changed") : "", this.saving ? word("stored_saving") : ""];
    element("program-state").textContent = state.filter(Boolean).join(" · ") || word(isEmpty ? "stored_new" : "stored_kept");
    element("program-save").disabled = this.saving || !isChanged;
    element("stored-conflict").hidden = !this.conflict;
    speak("stored-why", this.conflict ?? (() => ""));
    element("stored-theirs").hidden = !this.list.some((each) => each.id === id);
  }
}
