// The page of a fleet: a tile per robot, filters, commands, and stops with a confirmation.
const POLL_MS = 500;
const TIMEOUT_MS = 4000;
const PROGRAMS_MS = 3000;
const COMMAND_TIMEOUT_MS = 15000; // the hub waits for cells for up to 8 s
const PICTURE_TIMEOUT_MS = 40000;
const SPEEDS = [10, 25, 50, 75, 100];
const TOKEN = "cobot.fleet.token";
const STATES = ["ready", "moving", "paused", "stopping", "estop", "fault", "silent", "gone"];
const FIELDS = ["robot", "zone", "mode", "job", "program", "control", "speed_override", "backend", "bundle", "version", "age"];
const ALARMS = ["estop", "fault", "silent", "gone"];
const ALARM_LENGTH = 160; // the tile has the whole reason
const byId = (id) => document.getElementById(id);
const words = await (await fetch("page/words.json")).json();
const tiles = new Map();
let chosen = new Set();
let robots = [];
let known = false; // whether the hub has answered
let panels = false; // whether the hub shows the panels of cells
let polled = Date.now();
let language = localStorage.getItem("cobot.language") ?? navigator.language.slice(0, 2);
if (!(language in words)) language = "en";
const word = (name) => words[language][name] ?? words.en[name] ?? name;

function translate() {
  document.documentElement.lang = language;
  for (const each of document.querySelectorAll("[data-word]")) each.textContent = word(each.dataset.word);
  byId("language").value = language;
  tiles.clear();
  byId("tiles").replaceChildren();
  byId("filters").replaceChildren(...STATES.map(filterOf));
  draw();
}

function filterOf(state) {
  const button = document.createElement("button");
  button.type = "button";
  button.dataset.filter = state;
  button.setAttribute("aria-pressed", chosen.has(state));
  button.onclick = () => {
    chosen.has(state) ? chosen.delete(state) : chosen.add(state);
    button.setAttribute("aria-pressed", chosen.has(state));
    draw();
  };
  return button;
}

function element(name, attributes = {}, text = "") {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.textContent = text;
  return made;
}

function tileOf(robot) {
  const tile = element("article");
  const head = element("div", { class: "head" });
  head.append(element("h2", {}, robot.cell), element("span", { class: "state" }));
  const list = element("dl");
  for (const field of FIELDS) list.append(element("dt", {}, word(field)), element("dd", { "data-field": field }));
  const foot = element("div", { class: "foot" });
  const panel = element("button", { type: "button", class: "open-panel" }, word("panel"));
  panel.onclick = () => openPanel(robot.cell);
  const link = element("a", { target: "_blank", rel: "noopener noreferrer" }, word("panel_there"));
  const stop = element("button", { type: "button", class: "stop" }, word("stop"));
  stop.setAttribute("aria-label", `${word("stop")} ${robot.cell} ${robot.robot}`);
  const path = `cells/${encodeURIComponent(robot.cell)}/robots/${encodeURIComponent(robot.robot)}/stop`;
  stop.onclick = () => ask(word("stop_one").replace("{name}", `${robot.cell} / ${robot.robot}`), () => command(path));
  const look = element("button", { type: "button", class: "look" }, word("picture"));
  look.onclick = () => showPicture(robot);
  const forget = element("button", { type: "button", class: "forget" }, word("forget"));
  forget.onclick = () => ask(word("forget_question").replace("{cell}", robot.cell), () => remove(robot.cell), word("forget"));
  foot.append(panel, link, look, forget, stop);
  tile.append(head, list, element("p", { class: "faults" }), commandsOf(robot), foot);
  return tile;
}

function commandsOf(robot) {
  const place = `cells/${encodeURIComponent(robot.cell)}/robots/${encodeURIComponent(robot.robot)}`;
  const path = `${place}/commands`;
  const name = `${robot.cell} / ${robot.robot}`;
  const box = element("details", { class: "commands" });
  const button = (kind, action, sure = false) => {
    const made = element("button", { type: "button", "data-kind": kind }, word(kind));
    const go = () => command(path, action());
    made.onclick = () => (sure ? ask(word("start_question").replace("{name}", name).replace("{program}", programs.value), go, word(kind)) : go());
    return made;
  };
  const programs = element("select", { "aria-label": `${word("program")} ${name}` });
  const speed = element("select", { "aria-label": `${word("speed_override")} ${name}` });
  for (const each of SPEEDS) speed.append(element("option", { value: each }, `${each} %`));
  speed.value = 100;
  const start = button("start", () => ({ kind: "start", program: programs.value }), true);
  box.ontoggle = () => { if (box.open) listPrograms(box, `${place}/programs`, programs, start); };
  start.disabled = true;
  box.append(
    element("summary", {}, word("commands")),
    programs, start,
    button("pause", () => ({ kind: "pause" })), button("resume", () => ({ kind: "resume" })),
    speed, button("speed", () => ({ kind: "speed", fraction: Number(speed.value) / 100 })),
    button("take_control", () => ({ kind: "take_control" })), button("release_control", () => ({ kind: "release_control" })),
  );
  return box;
}

// While the commands are open, so that a program that was just stored appears.
async function listPrograms(box, path, select, start) {
  try {
    const response = await fetch(path, { headers: identity(), signal: AbortSignal.timeout(TIMEOUT_MS) });
    const answer = await response.json();
    if (!response.ok) throw new Error(answer.detail);
    const options = answer.programs.map((each) => element("option", { value: each.id }, `${each.label} (${each.version})`));
    const key = JSON.stringify(answer.programs);
    if (box.dataset.programs !== key) {
      const chosen = select.value;
      select.replaceChildren(...options);
      if (answer.programs.some((each) => each.id === chosen)) select.value = chosen;
      box.dataset.programs = key;
    }
    start.disabled = !answer.programs.length;
  } catch {
    start.disabled = true; // the tile says what is wrong with the cell
  }
  if (box.open && box.isConnected) setTimeout(() => listPrograms(box, path, select, start), PROGRAMS_MS);
}

function valueOf(robot, field) {
  if (field === "age") return `${robot.age_s.toFixed(robot.age_s < 10 ? 1 : 0)} s`;
  if (field === "speed_override") return robot.speed_override === null ? "" : `${Math.round(robot.speed_override * 100)} %`;
  return robot[field];
}

function faultsOf(robot) {
  const found = robot.used_twice ? [word("used_twice")] : [];
  if (robot.reason && ["estop", "fault", "silent"].includes(robot.state)) found.push(robot.reason);
  if (robot.drift.length) found.push(word("drift").replace("{programs}", robot.drift.join(", ")));
  return [...found, ...robot.problems].join("\n");
}

function fill(tile, robot) {
  tile.dataset.state = robot.state;
  tile.querySelector(".state").textContent = word(robot.state);
  for (const each of tile.querySelectorAll("dd")) {
    const value = valueOf(robot, each.dataset.field) || "–";
    if (each.textContent !== value) each.textContent = value;
  }
  const faults = tile.querySelector(".faults");
  faults.textContent = faultsOf(robot);
  faults.hidden = !faults.textContent;
  tile.querySelector(".open-panel").hidden = !panels;
  tile.querySelector(".forget").hidden = robot.state !== "gone";
  const link = tile.querySelector("a");
  link.hidden = !/^https?:\/\//.test(robot.panel);
  if (!link.hidden) link.href = robot.panel;
}

function draw() {
  const wanted = byId("find").value.trim().toLowerCase();
  const shown = robots.filter((robot) => (!chosen.size || chosen.has(robot.state))
    && (!wanted || `${robot.cell} ${robot.robot} ${robot.zone} ${robot.program} ${robot.job}`.toLowerCase().includes(wanted)));
  const names = new Set(shown.map((robot) => `${robot.cell}/${robot.robot}`));
  for (const [name, tile] of tiles) if (!names.has(name)) { tile.remove(); tiles.delete(name); }
  shown.forEach((robot, place) => {
    const name = `${robot.cell}/${robot.robot}`;
    const tile = tiles.get(name) ?? tileOf(robot);
    tiles.set(name, tile);
    fill(tile, robot);
    const main = byId("tiles");
    if (main.children[place] !== tile) main.insertBefore(tile, main.children[place] ?? null);
  });
  for (const button of byId("filters").children) {
    const count = robots.filter((robot) => robot.state === button.dataset.filter).length;
    button.textContent = `${word(button.dataset.filter)} ${count}`;
    button.hidden = !count && !chosen.has(button.dataset.filter);
  }
  byId("empty").hidden = !known || robots.length > 0;
  drawAlarms();
}

// All alarms are listed, also those of tiles that a filter hides. A click shows the tile.
function drawAlarms() {
  const found = robots.filter((robot) => ALARMS.includes(robot.state));
  const key = JSON.stringify([language, found.map((robot) => [robot.cell, robot.robot, robot.state, robot.reason])]);
  document.title = `${found.length ? `(${found.length}) ` : ""}${byId("fleet").textContent} – cobot`;
  const list = byId("alarms");
  list.hidden = !found.length;
  if (list.dataset.key === key) return;
  list.dataset.key = key;
  list.replaceChildren(...found.map((robot) => {
    const name = `${robot.cell} / ${robot.robot}`;
    const reason = robot.state !== "gone" && robot.reason ? ` – ${robot.reason.slice(0, ALARM_LENGTH)}` : "";
    const row = element("button", { type: "button" }, `${name}: ${word(robot.state)}${reason}`);
    row.onclick = () => {
      chosen.clear();
      byId("find").value = "";
      translate();
      tiles.get(`${robot.cell}/${robot.robot}`)?.scrollIntoView({ block: "center" });
    };
    const item = element("li");
    item.append(row);
    return item;
  }));
}

function tellConnection(text, bad) {
  byId("connection").textContent = text;
  byId("connection").toggleAttribute("data-bad", bad);
  byId("tiles").toggleAttribute("data-old", bad);
}

async function poll() {
  try {
    const response = await fetch("cells", { headers: identity(), signal: AbortSignal.timeout(TIMEOUT_MS) });
    if (response.status === 401) askToken();
    if (!response.ok) throw new Error(response.statusText);
    const answer = await response.json();
    ({ robots, panels } = answer);
    known = true;
    byId("fleet").textContent = answer.fleet;
    tellConnection(`${robots.filter((robot) => robot.alive).length} / ${robots.length} ${word("connected")}`, false);
  } catch {
    tellConnection(word("no_hub"), true);
    for (const robot of robots) robot.age_s += (Date.now() - polled) / 1000;
  }
  polled = Date.now();
  draw();
  setTimeout(poll, POLL_MS);
}

async function showPicture(robot) {
  const name = `${robot.cell} / ${robot.robot}`;
  const place = `cells/${encodeURIComponent(robot.cell)}/robots/${encodeURIComponent(robot.robot)}`;
  const image = byId("picture-shown");
  byId("picture-of").textContent = `${name} …`;
  byId("picture-again").onclick = () => showPicture(robot);
  if (!byId("picture").open) byId("picture").showModal();
  try {
    const response = await fetch(`${place}/picture`, { headers: identity(), signal: AbortSignal.timeout(PICTURE_TIMEOUT_MS) });
    if (!response.ok) throw new Error((await response.json()).detail);
    URL.revokeObjectURL(image.src);
    image.src = URL.createObjectURL(await response.blob());
    image.alt = name;
    byId("picture-of").textContent = `${name} – ${new Date().toLocaleTimeString(language)}`;
  } catch (error) {
    byId("picture-of").textContent = `${name}: ${word("no_picture")} ${error.message}`;
  }
}

// In a window of another origin, which knows neither this page nor the token.
async function openPanel(cell) {
  const opened = window.open("", "_blank");
  if (!opened) { tell(word("no_window"), true); return; }
  opened.opener = null;
  try {
    const response = await fetch(`cells/${encodeURIComponent(cell)}/panel`, { method: "POST", headers: identity(), signal: AbortSignal.timeout(TIMEOUT_MS) });
    const answer = await response.json();
    if (!response.ok) throw new Error(answer.detail);
    opened.location = answer.url;
  } catch (error) {
    opened.close();
    tell(`${cell}: ${error.message}`, true);
  }
}

function ask(question, go, label = word("stop")) {
  byId("question").textContent = question;
  byId("sure").textContent = label;
  byId("sure").classList.toggle("stop", label === word("stop"));
  byId("sure").onclick = () => { byId("confirm").close(); go(); };
  byId("confirm").showModal();
  byId("sure").focus();
}

function identity() {
  const token = sessionStorage.getItem(TOKEN);
  return { "X-Client-Name": "panel", ...(token ? { Authorization: `Bearer ${token}` } : {}) };
}

function askToken() {
  if (byId("login").open) return;
  byId("wrong-token").hidden = !sessionStorage.getItem(TOKEN);
  byId("login").showModal();
}

byId("login").onsubmit = () => sessionStorage.setItem(TOKEN, byId("token").value.trim());

async function command(path, action) {
  const id = crypto.randomUUID?.() ?? `${Date.now()}-${Math.random().toString(16).slice(2)}`;
  const [waiting, done, failed] = action ? ["sending", "done", "not_done"] : ["stopping_now", "all_stopped", "not_all_stopped"];
  tell(word(waiting), false);
  try {
    const response = await fetch(path, {
      method: "POST", headers: { "Content-Type": "application/json", ...identity() }, body: JSON.stringify(action ? { id, action } : { id }),
      signal: AbortSignal.timeout(COMMAND_TIMEOUT_MS),
    });
    const answer = await response.json();
    if (!response.ok) throw new Error(answer.detail);
    const bad = answer.robots.filter((robot) => robot.code !== "ok");
    const shown = action ? answer.robots : bad;
    const lines = shown.map((robot) => `${robot.cell} / ${robot.robot}: ${robot.text}`);
    tell([word(bad.length || !answer.robots.length ? failed : done), ...lines].join("\n"), bad.length > 0 || !answer.robots.length);
  } catch (error) {
    tell(`${word(failed)}\n${error.message}`, true);
  }
}

async function remove(cell) {
  try {
    const response = await fetch(`cells/${encodeURIComponent(cell)}`, { method: "DELETE", headers: identity(), signal: AbortSignal.timeout(TIMEOUT_MS) });
    if (!response.ok) throw new Error((await response.json()).detail);
  } catch (error) {
    tell(`${word("not_done")}\n${error.message}`, true);
  }
}

function tell(text, bad) {
  const result = byId("result");
  result.textContent = text;
  result.toggleAttribute("data-bad", bad);
  result.hidden = false;
}

byId("stop-all").onclick = () => ask(word("stop_all_question").replace("{count}", robots.length), () => command("stop"));
byId("cancel").onclick = () => byId("confirm").close();
byId("picture-close").onclick = () => byId("picture").close();
byId("picture").onclose = () => byId("picture-shown").removeAttribute("src");
byId("find").oninput = draw;
byId("language").onchange = (event) => {
  language = event.target.value;
  localStorage.setItem("cobot.language", language);
  translate();
};
translate();
poll();
