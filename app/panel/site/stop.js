// STOP, on every page: the button, Space and Escape. It asks no question and waits for nothing. It is a script of
// its own, is loaded first and needs no other script, so that an error elsewhere cannot disable it.
export const WRITING = "input:not([type=range]), textarea, [contenteditable]";
const UNSURE_MS = 3000; // an arm comes to rest sooner
const GIVE_UP_MS = 11_000; // the service gives itself 10 s
const SHOWN_MS = 2000; // the confirmation, on the button
const SAME_MS = 2000;
export const requests = new Set(); // ids of the requests and connections by which this page stops the arm
const button = document.getElementById("stop");
const why = document.getElementById("stop-why");
let pressed = 0; // how often
let confirmed = 0; // the newest press after which the arm is known to be at rest
let failed = 0; // and the newest one that is told to have failed
let shown = 0; // the timer of the confirmation

// Whether two events `stop` are one press, which is sent in two ways.
export function isSamePress(before, { time, data }) {
  return before?.data.by === data.by && new Date(time) - new Date(before.time) < SAME_MS;
}

function succeed(press) {
  if (press > confirmed) confirm();
  confirmed = Math.max(confirmed, press);
  if (confirmed >= failed) why.hidden = true;
}

// On the button itself, where the person looks.
function confirm() {
  clearTimeout(shown);
  button.dataset.confirmed = "";
  shown = setTimeout(() => delete button.dataset.confirmed, SHOWN_MS);
}

// reason: one of those in the page, which has them in the language of the panel, or in English without the other
// scripts. says: the sentence of the service or the browser.
function fail(press, reason, says) {
  if (press <= confirmed) return; // another way has got there
  failed = Math.max(failed, press);
  for (const each of why.querySelectorAll("[data-why]")) each.hidden = each.dataset.why !== reason;
  why.hidden = false;
  why.title = says;
}

function headers() {
  try {
    const token = sessionStorage.getItem("cobot.token");
    if (token) return { Authorization: `Bearer ${token}` };
    const name = localStorage.getItem("cobot.name");
    return name ? { "X-Client-Name": encodeURIComponent(name) } : {};
  } catch {
    return {}; // a browser that keeps nothing
  }
}

// Every robot, whichever is shown.
async function send(press) {
  const id = `panel-${Math.random().toString(36).slice(2)}`;
  requests.add(id);
  const unsure = setTimeout(() => fail(press, "silent", ""), UNSURE_MS);
  let answer = null;
  try {
    answer = await fetch("stop", { method: "POST", headers: { ...headers(), "X-Request-Id": id }, signal: AbortSignal.timeout(GIVE_UP_MS) });
    const said = await answer.json();
    if (answer.ok && said.success) succeed(press);
    else fail(press, answer.ok ? "moving" : "error", said.message ?? said.detail ?? `HTTP ${answer.status}`);
  } catch (error) {
    fail(press, error.name === "TimeoutError" ? "silent" : answer ? "error" : "unreachable", error.message);
  } finally {
    clearTimeout(unsure);
  }
}

function stop() {
  pressed += 1;
  delete button.dataset.confirmed;
  button.dataset.pressed = String(pressed);
  send(pressed);
  document.dispatchEvent(new CustomEvent("cobot-stop", { detail: pressed })); // the rest of the page tells the service its own way
}

document.addEventListener("cobot-stopped", ({ detail }) => {
  if (detail.success) succeed(detail.number);
  else fail(detail.number, "moving", detail.message);
});
button.addEventListener("click", stop);
// First of all listeners, and on keydown: Space on a focused button shall stop, not press it.
document.addEventListener(
  "keydown",
  (event) => {
    const space = event.code === "Space" && !event.target.closest?.(WRITING);
    if (!space && event.key !== "Escape") return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (!event.repeat) stop();
  },
  { capture: true },
);
document.addEventListener(
  "keyup",
  (event) => {
    if (event.code === "Space" && !event.target.closest?.(WRITING)) event.preventDefault();
  },
  { capture: true },
);
