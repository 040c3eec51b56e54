// REST: one place for addresses, the token and errors.
const STORED = "cobot.token";

export class Refused extends Error {
  constructor(status, detail) {
    super(detail);
    this.status = status;
  }
}

export class Api {
  constructor() {
    this.robot = null;
    this.control = ""; // the token of a lease, see lease.js
    this.onToken = () => {};
    this.form = document.getElementById("token-form");
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      sessionStorage.setItem(STORED, document.getElementById("token").value.trim());
      this.onToken();
    });
  }

  get token() {
    return sessionStorage.getItem(STORED) || "";
  }

  // Of a WebSocket, which has no other place for a token.
  get protocols() {
    return this.token ? ["cobot", `cobot.token.${this.token}`] : [];
  }

  // Of a robot's endpoint, as "/plan/named"; one of the service begins with its whole path.
  address(path) {
    return this.robot ? `${this.robot.path}${path}` : path;
  }

  async ask(method, address, body, headers = {}, keepalive = false) {
    const options = { method, headers: { ...headers }, keepalive };
    if (this.token) options.headers.Authorization = `Bearer ${this.token}`;
    if (this.control && method !== "GET") options.headers["X-Control-Token"] = this.control;
    if (body instanceof FormData) options.body = body;
    else if (body !== undefined) {
      options.headers["Content-Type"] = "application/json";
      options.body = JSON.stringify(body);
    }
    const answer = await fetch(address, options);
    if (answer.ok || answer.status === 304) return answer;
    const said = await answer.json().catch(() => ({}));
    const why = typeof said.detail === "string" ? said.detail : `HTTP ${answer.status}`;
    if (answer.status === 401 || answer.status === 403) this.askForToken(why);
    throw new Refused(answer.status, why);
  }

  async get(path) {
    return (await this.ask("GET", this.address(path))).json();
  }

  async post(path, body) {
    return (await this.ask("POST", this.address(path), body)).json();
  }

  async robots() {
    return (await this.ask("GET", "/robots")).json();
  }

  // All robots, whichever is shown.
  stop() {
    return this.ask("POST", "/stop");
  }

  // null if it is still what the tag says.
  async geometry(tag) {
    const answer = await this.ask("GET", this.address("/geometry"), undefined, tag ? { "If-None-Match": tag } : {});
    if (answer.status === 304) return null;
    return { tag: answer.headers.get("ETag"), geometry: await answer.json() };
  }

  askForToken(why) {
    this.form.hidden = false;
    document.getElementById("token-why").textContent = why;
  }
}
