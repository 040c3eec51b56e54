// Downloads a backup or a support bundle, and uploads a backup that the next start restores.
import { LONG_MS } from "./api.js";
import { reasonOf } from "./reasons.js";
import { speak, word } from "./words.js";

const element = (id) => document.getElementById(id);

export class Archives {
  constructor(api) {
    this.api = api;
    element("backup-make").addEventListener("click", () => this.fetch("backup"));
    element("support-make").addEventListener("click", () => this.fetch("support"));
    element("backup-choose").addEventListener("click", () => element("backup-file").click());
    element("backup-file").addEventListener("change", () => this.restore(element("backup-file").files[0]));
  }

  // kind: "backup" or "support"; both are of the whole service.
  async fetch(kind) {
    this.say(kind, () => "…");
    try {
      const answer = await this.api.ask("GET", `/admin/${kind}`, undefined, { waitMs: LONG_MS });
      const name = /filename="([\w.-]+)"/.exec(answer.headers.get("Content-Disposition"))?.[1] ?? `cobot-${kind}.zip`;
      const content = await answer.blob();
      const link = document.createElement("a");
      link.href = URL.createObjectURL(content);
      link.download = name;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), LONG_MS);
      this.say(kind, () => word("archive_made", { name, kb: Math.ceil(content.size / 1000) }), "good");
    } catch (error) {
      this.say(kind, () => reasonOf(error), "warn");
    }
  }

  async restore(file) {
    element("backup-file").value = ""; // the same file may be chosen again
    if (!file) return;
    const body = new FormData();
    body.append("file", file);
    this.say("backup", () => "…");
    try {
      const answer = await this.api.ask("POST", "/admin/restore", body, { waitMs: LONG_MS });
      const { created, contents } = await answer.json();
      const when = () => new Date(created).toLocaleString(document.documentElement.lang);
      this.say("backup", () => word("backup_staged", { when: when(), contents: contents.join("; ") }), "good");
    } catch (error) {
      this.say("backup", () => reasonOf(error), "warn");
    }
  }

  say(kind, words, level = "") {
    speak(`${kind}-why`, words);
    element(`${kind}-why`).dataset.level = level;
  }
}
