// Words in the language that was chosen, or that the browser prefers; the catalogue is words.json.
import { keep, keptText } from "./store.js";

const STORED = "cobot.language";
const AGAIN_MS = 2000;
let catalogue = { en: {} };
let language = "en";
const listeners = new Set();
const spoken = new Map(); // by the id of an element: returns its text

export function word(name, values = {}, otherwise = name) {
  const text = catalogue[language]?.[name] ?? catalogue.en[name] ?? otherwise;
  return text.replace(/\{(\w+)\}/g, (whole, key) => named(values[key] ?? whole));
}

// The service calls a client '"NAME"' or '"NAME" from ADDRESS', and a client without a token and a name "anonymous from ADDRESS".
export function named(text) {
  if (typeof text !== "string") return text;
  return text.replace(/^"([^"]*)"$/, "$1").replace(/"([^"]*)" from ([\w.:]+)/g, "$1 ($2)").replace(/\banonymous(?: from ([\w.:]+))?/g, (_, address) => word(address ? "unnamed_at" : "unnamed", { address }));
}

// Writes a text into an element, now and in each language that is chosen later. words: returns the text.
export function speak(id, words) {
  spoken.set(id, words);
  const [shown, text] = [document.getElementById(id), words()];
  if (shown.textContent !== text) shown.textContent = text;
}

export function timeOfDay(time) {
  return new Date(time).toLocaleTimeString(language, { hourCycle: "h23" });
}

// The time of day; for another day than today with the date.
export function dayAndTime(time) {
  const date = new Date(time);
  const isToday = date.toDateString() === new Date().toDateString();
  return isToday ? timeOfDay(time) : `${date.toLocaleDateString(language)} ${timeOfDay(time)}`;
}

// Called now and whenever another language is chosen.
export function inEachLanguage(write) {
  listeners.add(write);
  write();
}

// A page without its words works; it gets them later.
export async function installLanguages() {
  try {
    catalogue = await (await fetch(new URL("words.json", import.meta.url), { signal: AbortSignal.timeout(AGAIN_MS) })).json();
  } catch {
    setTimeout(installLanguages, AGAIN_MS);
    return;
  }
  const select = document.getElementById("language");
  const wanted = [keptText("localStorage", STORED), ...navigator.languages.map((each) => each.slice(0, 2))];
  choose(wanted.find((each) => each in catalogue) ?? "en");
  select.value = language;
  select.addEventListener("change", () => {
    keep("localStorage", STORED, select.value);
    choose(select.value);
  });
}

function choose(wanted) {
  language = wanted;
  document.documentElement.lang = wanted;
  for (const each of document.querySelectorAll("[data-word]")) each.textContent = word(each.dataset.word);
  for (const each of document.querySelectorAll("[data-word-label]")) {
    each.setAttribute("aria-label", word(each.dataset.wordLabel));
    if (each.matches("button")) each.title = word(each.dataset.wordLabel);
  }
  for (const each of document.querySelectorAll("[data-word-placeholder]")) each.placeholder = word(each.dataset.wordPlaceholder);
  for (const [id, words] of spoken) speak(id, words);
  for (const write of listeners) write();
}
