// REST: one place for addresses, the token, errors and how long an answer is waited for. A browser has six
// connections to a service: an answer that does not come shall not keep one for ever.
import { keptText } from "./store.js";
import { word } from "./words.js";

const STORED = "cobot.token";
export const PERSON = "cobot.name";
// A hub has the panel of each cell below a path of its own, so all addresses are relative to the page. It knows the
// person, and a token of the cell is of no use there.
export const THROUGH_HUB = location.pathname !== "/";
const READ_MS = 10_000;
const WRITE_MS = 30_000; // planning is given 20 s by the service
export const LONG_MS = 130_000; // what writes or reads a long file

// status: of HTTP; 0 without an answer. answer: its body, see reasons.js.
class Refused extends Error {
  constructor(status, detail, { code = "", explain = null, details = null } = {}) {
    super(detail);
    Object.assign(this, { status, code, explain, details });
  }
}

export class Api {
  constructor() {
    this.robot = null;
    this.control = ""; // the token of a lease, see lease.js
    this.onToken = () => {};
    this.form = document.getElementById("token-form");
    document.getElementById("through-hub").hidden = !THROUGH_HUB;
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      sessionStorage.setItem(STORED, document.getElementById("token").value.trim());
      this.onToken();
    });
  }

  get token() {
    try {
      return sessionStorage.getItem(STORED) || "";
    } catch {
      return ""; // a browser that keeps nothing
    }
  }

  // What the person called themselves, see person.js. A token has a name of its own.
  get name() {
    return this.token ? "" : keptText("localStorage", PERSON) || "";
  }

  // Of a WebSocket, which has no other place for a token.
  get protocols() {
    return this.token ? ["cobot", `cobot.token.${this.token}`] : [];
  }

  // Of a robot's endpoint, as "/plan/named"; one of the service begins with its whole path.
  address(path) {
    return this.robot ? `${this.robot.path}${path}` : path;
  }

  // quiet: without asking for another token where this one is too weak.
  async ask(method, address, body, { headers = {}, keepalive = false, quiet = false, waitMs = method === "GET" ? READ_MS : WRITE_MS } = {}) {
    const options = { method, headers: { ...headers }, keepalive, signal: AbortSignal.timeout(waitMs) };
    if (this.token) options.headers.Authorization = `Bearer ${this.token}`;
    if (this.name) options.headers["X-Client-Name"] = encodeURIComponent(this.name);
    if (this.control && method !== "GET") options.headers["X-Control-Token"] = this.control;
    if (body instanceof FormData) options.body = body;
    else if (body !== undefined) {
      options.headers["Content-Type"] = "application/json";
      options.body = JSON.stringify(body);
    }
    const answer = await fetch(`.${address}`, options).catch((error) => {
      throw new Refused(0, word("unanswered", { address, why: error.message }));
    });
    if (answer.ok || answer.status === 304) return answer;
    const said = await answer.json().catch(() => ({}));
    const why = typeof said.detail === "string" ? said.detail : `HTTP ${answer.status}`;
    if (!quiet && !THROUGH_HUB && (answer.status === 401 || answer.status === 403)) this.askForToken(why);
    throw new Refused(answer.status, why, said);
  }

  async get(path, options) {
    return (await this.ask("GET", this.address(path), undefined, options)).json();
  }

  async bytes(path) {
    return (await this.ask("GET", this.address(path))).arrayBuffer();
  }

  async post(path, body, options) {
    return (await this.ask("POST", this.address(path), body, options)).json();
  }

  async robots() {
    return (await this.ask("GET", "/robots")).json();
  }

  // null if it is still what the tag says.
  async geometry(tag) {
    const headers = tag ? { "If-None-Match": tag } : {};
    const answer = await this.ask("GET", this.address("/geometry"), undefined, { headers });
    if (answer.status === 304) return null;
    return { tag: answer.headers.get("ETag"), geometry: await answer.json() };
  }

  askForToken(why) {
    this.form.hidden = false;
    document.getElementById("name-form").hidden = true;
    document.getElementById("token-why").textContent = why;
  }
}
