// A Lua program. The service checks and runs it and names the line of an error. Its output is shown next to it.
import { reasonOf } from "./reasons.js";
import { speak, word } from "./words.js";

const NAME = "panel.lua";
const WRONG = new RegExp(`${NAME.replace(".", "[.]")}:(\\d+):`);
const LINES = 300;
const PRINTED = /^program: /;
const SHOWN = /^(program: |error: | {4}\| )/; // the last: another line of the same text
const MOMENT = /^\S+ /; // when a line was printed
const element = (id) => document.getElementById(id);

export class Lua {
  constructor(api, page) {
    this.api = api;
    this.page = page;
    this.own = null; // the number of the program that was started here
    element("lua-run").addEventListener("click", () => this.run());
  }

  hear(event) {
    if (event.type === "sequence" && event.data.what === "ended" && event.data.sequence === this.own) this.ended(event.data);
  }

  async run() {
    const body = new FormData();
    body.append("config", new File([this.page.program.text], NAME));
    body.append("n_iterations", "1");
    body.append("delay_between_iterations", "0");
    element("lua-log").textContent = "";
    try {
      this.own = (await this.api.post("/sequences/start", body)).sequence_id;
      this.say(() => word("lua_runs"));
      const { status, sequence_id: number, returncode } = await this.api.get("/sequences/status");
      if (status === "finished" && number === this.own) this.ended({ returncode }); // before its number was known here
    } catch (error) {
      this.say(() => reasonOf(error));
    }
  }

  async ended({ returncode }) {
    const { own } = this;
    this.own = null;
    const { lines: all, missing } = await this.api.get(`/sequences/logs?n=${LINES}`).catch((error) => ({ lines: [], missing: reasonOf(error) }));
    const lines = ofRun(all, own);
    element("lua-log").textContent = lines.join("\n");
    element("lua-log").scrollTop = element("lua-log").scrollHeight;
    const wrong = returncode ? lines.findLast((line) => WRONG.test(line)) : null;
    if (wrong) this.page.editor.mark(Number(WRONG.exec(wrong)[1]));
    const why = wrong ?? lines.at(-1) ?? missing ?? "";
    this.say(() => (returncode ? word("lua_failed", { code: returncode, why }) : word("lua_done")));
  }

  say(words) {
    speak("lua-why", words);
  }
}

// The output and the error of this run. The log also has the lines of other runs and of the runner.
function ofRun(lines, number) {
  const begun = lines.findLastIndex((line) => line.includes(` sequence ${number} started, `));
  return lines.slice(begun + 1).map((line) => line.replace(MOMENT, "")).filter((line) => SHOWN.test(line)).map((line) => line.replace(PRINTED, ""));
}
