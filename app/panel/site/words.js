// Words in the language that was chosen, or that the browser prefers; the catalogue is words.json.
const STORED = "cobot.language";
let catalogue = { en: {} };
let language = "en";
const listeners = new Set();

export function word(name, values = {}) {
  const text = catalogue[language]?.[name] ?? catalogue.en[name] ?? name;
  return text.replace(/\{(\w+)\}/g, (whole, key) => values[key] ?? whole);
}

// Called now and whenever another language is chosen.
export function inEachLanguage(write) {
  listeners.add(write);
  write();
}

export async function installLanguages() {
  catalogue = await (await fetch("/panel/words.json")).json();
  const select = document.getElementById("language");
  const wanted = [localStorage.getItem(STORED), ...navigator.languages.map((each) => each.slice(0, 2))];
  choose(wanted.find((each) => each in catalogue) ?? "en");
  select.value = language;
  select.addEventListener("change", () => {
    localStorage.setItem(STORED, select.value);
    choose(select.value);
  });
}

function choose(wanted) {
  language = wanted;
  document.documentElement.lang = wanted;
  for (const each of document.querySelectorAll("[data-word]")) each.textContent = word(each.dataset.word);
  for (const each of document.querySelectorAll("[data-word-label]")) {
    each.setAttribute("aria-label", word(each.dataset.wordLabel));
  }
  for (const write of listeners) write();
}
