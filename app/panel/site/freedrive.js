// The arm, moved by hand: for as long as this page is there to say so. Who guides it looks at the arm, so a
// page that loses the focus goes on; one that is hidden or left ends it, and the service when it hears nothing.
import { reasonOf, whyOf } from "./reasons.js";
import { inEachLanguage, speak, word } from "./words.js";

const TIMEOUT_S = 2;
const EVERY_MS = 500;
const element = (id) => document.getElementById(id);

export class Freedrive {
  constructor(api) {
    this.api = api;
    this.session = null;
    this.timer = 0;
    element("freedrive").addEventListener("click", () => this.toggle());
    window.addEventListener("pagehide", () => this.end());
    document.addEventListener("visibilitychange", () => document.hidden && this.end());
    inEachLanguage(() => this.write());
  }

  get on() {
    return this.session !== null;
  }

  async toggle() {
    if (this.on) {
      this.end();
      return;
    }
    element("freedrive").disabled = true;
    await this.ask({ timeout_s: TIMEOUT_S });
    element("freedrive").disabled = false;
  }

  // Begins, or goes on; the next time is half a second after the answer.
  async ask(body) {
    const robot = this.api.robot;
    const renewed = body.session ?? null;
    try {
      const answer = await this.api.post("/freedrive", body);
      if (robot !== this.api.robot || this.session !== renewed || document.hidden) {
        if (answer.session) this.leave(robot);
        return;
      }
      this.session = answer.session;
      this.say(() => whyOf({ ...answer, reason: answer.limited_by }) || word(element("simulation").hidden ? "freedrive_hint" : "pull_hint"));
      this.timer = setTimeout(() => this.ask({ session: this.session, timeout_s: TIMEOUT_S }), EVERY_MS);
    } catch (error) {
      if (this.session !== renewed) return; // it has been ended here meanwhile
      this.session = null;
      this.say(() => reasonOf(error));
    }
    this.write();
  }

  end() {
    if (!this.on) return;
    clearTimeout(this.timer);
    this.session = null;
    this.leave(this.api.robot);
    this.say(() => "");
    this.write();
  }

  // Also while the page goes away: `keepalive` has the browser send it all the same.
  leave(robot) {
    this.api.ask("DELETE", `${robot.path}/freedrive`, undefined, { keepalive: true }).catch((error) => this.say(() => reasonOf(error)));
  }

  write() {
    const button = element("freedrive");
    button.setAttribute("aria-pressed", String(this.on));
    button.textContent = word(this.on ? "freedrive_end" : "freedrive");
  }

  say(words) {
    speak("freedrive-why", words);
  }
}
