// The access tokens of people and programs: administrators list, add and delete them. A new token is shown once.
import { allow } from "./able.js";
import { oneAtATime } from "./once.js";
import { reasonOf } from "./reasons.js";
import { inEachLanguage, speak, word } from "./words.js";

const ADDRESS = "/access/tokens";
const NAME = /^[A-Za-z0-9._@-]{1,48}$/;
const MAX_DAYS = 36_500;
const DOORS = [401, 403];
const element = (id) => document.getElementById(id);

function shownTime(text) {
  const format = { dateStyle: "short", timeStyle: "short", hourCycle: "h23" };
  return new Date(text).toLocaleString(document.documentElement.lang, format);
}

export class People {
  constructor(api) {
    this.api = api;
    this.tokens = [];
    this.sure = ""; // the name whose deletion waits for a second press
    this.made = ""; // the name of the new token that is shown
    this.refused = ""; // why no token can be added or deleted, as a word; "" if it can
    this.say(() => "");
    this.look = oneAtATime(() => this.ask());
    element("people-form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.add();
    });
    element("people-copy").addEventListener("click", () => this.copy());
    element("people-done").addEventListener("click", () => this.forget());
    inEachLanguage(() => this.write());
  }

  async ask() {
    if (!element("people-list").checkVisibility()) return;
    try {
      const { tokens, required } = await (await this.api.ask("GET", ADDRESS, undefined, { quiet: true })).json();
      this.tokens = tokens;
      this.refused = tokens.some(({ own }) => own) ? "" : "why_not_admin";
      element("people-first").hidden = required;
    } catch (error) {
      this.tokens = [];
      this.refused = DOORS.includes(error.status) ? "why_not_admin" : "";
      if (!this.refused) this.say(() => reasonOf(error), "warn");
    }
    this.write();
  }

  // The answer is the only one with the token. Its field is emptied when the token was handed over.
  async add() {
    const [name, days] = [element("people-name").value.trim(), element("people-days").value.trim()];
    if (!NAME.test(name)) return void this.say(() => word("token_name_wrong"), "warn");
    if (this.tokens.some((each) => each.name === name)) return void this.say(() => word("token_name_taken", { name }), "warn");
    if (days && !(Number(days) > 0 && Number(days) <= MAX_DAYS)) return void this.say(() => word("token_days_wrong"), "warn");
    const body = { name, role: element("people-role").value, ...(days ? { days: Number(days) } : {}) };
    try {
      const { token } = await (await this.api.ask("POST", ADDRESS, body, { quiet: true })).json();
      this.made = name;
      element("people-new").value = token;
      for (const id of ["people-name", "people-days"]) element(id).value = "";
      this.say(() => "");
    } catch (error) {
      this.say(() => reasonOf(error), "warn");
    }
    await this.look();
    if (this.made) element("people-new").select();
  }

  // Pages without TLS have no clipboard of their own: there, the selected text is copied.
  async copy() {
    const field = element("people-new");
    field.select();
    const copied = await (navigator.clipboard?.writeText(field.value).then(() => true).catch(() => false) ?? false);
    if (copied || document.execCommand("copy")) this.say(() => word("token_copied"), "good");
  }

  forget() {
    this.made = element("people-new").value = "";
    this.say(() => "");
    this.write();
  }

  // Deletes a token at the second press.
  async remove(name) {
    if (this.sure !== name) {
      this.sure = name;
      return void this.write();
    }
    this.sure = "";
    try {
      await this.api.ask("DELETE", `${ADDRESS}/${encodeURIComponent(name)}`, undefined, { quiet: true });
      if (this.made === name) this.forget();
      this.say(() => word("token_deleted", { name }), "good");
    } catch (error) {
      this.say(() => reasonOf(error), "warn");
    }
    await this.look();
  }

  row({ name, role, expires, last_used: used, own }) {
    const row = document.createElement("li");
    const [who, about, button] = ["strong", "span", "button"].map((tag) => document.createElement(tag));
    const isOver = expires && new Date(expires) <= new Date();
    const parts = [
      word(`role_${role}`),
      own ? word("token_own") : used ? word("token_used", { when: shownTime(used) }) : word("token_unused"),
      expires ? word(isOver ? "token_expired" : "token_ends", { when: shownTime(expires) }) : "",
    ];
    row.dataset.token = who.textContent = name;
    about.textContent = parts.filter(Boolean).join(" · ");
    button.type = "button";
    button.textContent = this.sure === name ? word("token_delete_sure", { name }) : word("stored_delete");
    button.setAttribute("aria-label", this.sure === name ? button.textContent : `${word("stored_delete")}: ${name}`);
    button.addEventListener("click", () => this.remove(name));
    button.addEventListener("blur", () => {
      if (this.sure !== name || !document.hasFocus()) return;
      this.sure = "";
      button.textContent = word("stored_delete");
    });
    row.append(who, about, button);
    allow(button, this.refused || (own ? "why_own_token" : ""));
    return row;
  }

  write() {
    const focused = document.activeElement?.closest?.("#people-list li")?.dataset.token;
    const sure = this.sure; // the focus leaves the row that is replaced
    const rows = this.tokens.map((each) => this.row(each));
    element("people-list").replaceChildren(...rows);
    this.sure = sure;
    rows.find((each) => each.dataset.token === focused)?.querySelector("button").focus();
    element("people-none").hidden = rows.length > 0 || this.refused !== "";
    element("people-made").hidden = !this.made;
    element("people-made-of").textContent = word("token_made", { name: this.made });
    for (const id of ["name", "role", "days", "add"]) allow(element(`people-${id}`), this.refused);
    element("people-refused").textContent = this.refused && word(this.refused);
  }

  say(words, level = "") {
    speak("people-why", words);
    element("people-why").dataset.level = level;
  }
}
