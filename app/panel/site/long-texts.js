// The texts under the picture have room for three lines. A longer one gets a button that shows all of it, over the
// picture, so that nothing else moves.
import { inEachLanguage, word } from "./words.js";

const TEXTS = ["plan", "job-part"];

function follow(text) {
  const button = document.createElement("button");
  button.type = "button";
  button.className = "more";
  button.textContent = "…";
  text.after(button);
  const show = (whole) => {
    text.toggleAttribute("data-whole", whole);
    button.setAttribute("aria-expanded", String(whole));
  };
  const look = () => {
    if (!text.hasAttribute("data-whole")) button.hidden = text.scrollHeight <= text.clientHeight + 1;
  };
  const changed = () => {
    show(false);
    look();
  };
  button.addEventListener("click", () => show(!text.hasAttribute("data-whole")));
  new MutationObserver(changed).observe(text, { childList: true, characterData: true, subtree: true });
  new ResizeObserver(look).observe(text);
  inEachLanguage(() => {
    button.title = word("whole_text");
    button.setAttribute("aria-label", button.title);
  });
  changed();
}

export function followLongTexts() {
  for (const id of TEXTS) follow(document.getElementById(id));
}
