// A Lua program: written here, kept in this browser, checked and run by the service, which says where it is wrong.
import { keep, keptText } from "./store.js";
import { inEachLanguage, word } from "./words.js";

const STORED = "cobot.lua";
const FIRST = 'movej({ 0, 0.4, 0, -1.57, 0, 1.2, 0 }, 0.3)\nmove_named("home", 0.3)\n';
const NAME = "panel.lua";
const WRONG = new RegExp(`${NAME.replace(".", "[.]")}:(\\d+):`);
const LINES = 50;
const element = (id) => document.getElementById(id);

export class Lua {
  constructor(api) {
    this.api = api;
    this.own = null; // the number of the program that was started here
    this.words = () => word("lua_hint");
    this.text = element("lua-text");
    this.text.value = keptText("localStorage", STORED) ?? FIRST;
    this.text.addEventListener("input", () => this.changed());
    this.text.addEventListener("scroll", () => (element("lua-lines").scrollTop = this.text.scrollTop));
    element("lua-run").addEventListener("click", () => this.run());
    element("lua-save").addEventListener("click", () => this.save());
    element("lua-choose").addEventListener("click", () => element("lua-file").click());
    element("lua-file").addEventListener("change", () => this.open());
    this.changed();
    inEachLanguage(() => this.write());
  }

  changed() {
    keep("localStorage", STORED, this.text.value);
    const count = this.text.value.split("\n").length;
    element("lua-lines").textContent = Array.from({ length: count }, (_, line) => line + 1).join("\n");
  }

  hear(event) {
    if (event.type === "sequence" && event.data.what === "ended" && event.data.sequence === this.own) this.ended(event.data);
  }

  async run() {
    const body = new FormData();
    body.append("config", new File([this.text.value], NAME));
    body.append("n_iterations", "1");
    body.append("delay_between_iterations", "0");
    element("lua-log").textContent = "";
    try {
      this.own = (await this.api.post("/sequences/start", body)).sequence_id;
      this.say(() => word("lua_runs"));
      const { status, sequence_id: number, returncode } = await this.api.get("/sequences/status");
      if (status === "finished" && number === this.own) this.ended({ returncode }); // before its number was known here
    } catch (error) {
      this.say(() => error.message);
    }
  }

  async ended({ returncode }) {
    this.own = null;
    const { lines, missing } = await this.api.get(`/sequences/logs?n=${LINES}`).catch((error) => ({ lines: [], missing: error.message }));
    element("lua-log").textContent = lines.join("\n");
    element("lua-log").scrollTop = element("lua-log").scrollHeight;
    const wrong = returncode ? lines.findLast((line) => WRONG.test(line)) : null;
    if (wrong) this.mark(Number(WRONG.exec(wrong)[1]));
    const why = wrong ?? lines.at(-1) ?? missing ?? "";
    this.say(() => (returncode ? word("lua_failed", { code: returncode, why }) : word("lua_done")));
  }

  // The line that is wrong, selected.
  mark(line) {
    const before = this.text.value.split("\n").slice(0, line - 1);
    const begin = before.reduce((sum, each) => sum + each.length + 1, 0);
    this.text.focus();
    this.text.setSelectionRange(begin, begin + (this.text.value.split("\n")[line - 1] ?? "").length);
  }

  save() {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([this.text.value], { type: "text/x-lua" }));
    link.download = "program.lua";
    link.click();
    URL.revokeObjectURL(link.href);
  }

  async open() {
    const file = element("lua-file").files[0];
    element("lua-file").value = "";
    if (!file) return;
    this.text.value = await file.text();
    this.changed();
  }

  say(words) {
    this.words = words;
    this.write();
  }

  write() {
    element("lua-why").textContent = this.words();
  }
}
