// Programs as files: opened from a dialog or dropped on the page, and downloaded.
import { isTree } from "./steps.js";
import { word } from "./words.js";

const MAX_BYTES = 2_000_000;
const MAX_LABEL = 100;
const element = (id) => document.getElementById(id);

// Whether a text is a sequence file.
function isSequence(text) {
  try {
    return isTree(JSON.parse(text));
  } catch {
    return false;
  }
}

// Downloads a file.
function download(name, text) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: "text/plain" }));
  link.download = name;
  link.click();
  URL.revokeObjectURL(link.href);
}

// A file that is dropped on a card is opened there. Elsewhere a drop must not replace this page.
function acceptFiles(card, open) {
  for (const kind of ["dragover", "drop"]) document.addEventListener(kind, (event) => event.preventDefault());
  card.addEventListener("dragover", () => card.toggleAttribute("data-over", true));
  card.addEventListener("dragleave", () => card.removeAttribute("data-over"));
  card.addEventListener("drop", ({ dataTransfer }) => {
    card.removeAttribute("data-over");
    if (dataTransfer.files[0]) open(dataTransfer.files[0]);
  });
}

export class ProgramFiles {
  constructor(page) {
    this.page = page;
    const acts = {
      "program-new": () => this.begin("sequence"), "program-lua": () => this.begin("lua"),
      "program-import": () => element("program-file").click(), "program-export": () => download(page.program.fileName, page.program.text),
    };
    for (const [id, act] of Object.entries(acts)) {
      element(id).addEventListener("click", () => {
        element("program-menu").open = false;
        act();
      });
    }
    element("program-file").addEventListener("change", ({ target }) => {
      const [file] = target.files;
      target.value = ""; // the same file may be chosen again
      if (file) this.read(file);
    });
    acceptFiles(element("program-card"), (file) => this.read(file));
  }

  begin(kind) {
    this.page.program.startNew(kind);
    this.page.say(() => word(kind === "lua" ? "lua_hint" : "steps_hint"));
  }

  async read(file) {
    const { name, size } = file;
    if (size > MAX_BYTES) return void this.page.say(() => word("file_large", { name, mb: MAX_BYTES / 1e6 }));
    const text = await file.text();
    const kind = name.endsWith(".lua") ? "lua" : "sequence";
    if (kind === "sequence" && !isSequence(text)) return void this.page.say(() => word("file_none", { name }));
    this.page.program.open({ kind, text, label: name.replace(/\.\w+$/, "").slice(0, MAX_LABEL) });
    this.page.say(() => word("file_opened", { name }));
  }
}
