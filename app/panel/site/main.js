// Puts the panel together: which robot is shown, and who is told of its state.
import { Api } from "./api.js";
import { Approvals } from "./approvals.js";
import { Banner } from "./banner.js";
import { Csv } from "./csv.js";
import { Events } from "./events.js";
import { Freedrive } from "./freedrive.js";
import { Io } from "./io.js";
import { Job } from "./job.js";
import { Jog } from "./jog.js";
import { Lease } from "./lease.js";
import { Live } from "./live.js";
import { Log } from "./log.js";
import { Lua } from "./lua.js";
import { Motions } from "./motions.js";
import { oneAtATime } from "./once.js";
import { Planned } from "./plots.js";
import { Queue } from "./queue.js";
import { Readouts } from "./readouts.js";
import { Recordings } from "./recordings.js";
import { Status } from "./status.js";
import { installStop } from "./stop.js";
import { Stream } from "./stream.js";
import { Waypoints } from "./waypoints.js";
import { installLanguages, word } from "./words.js";

const GEOMETRY_EVERY_MS = 30_000; // the limits are no event
const LOOKED_AT = ["hello", "scene", "tool", "service"];
const element = (id) => document.getElementById(id);

class Panel {
  constructor(api) {
    this.api = api;
    this.readouts = new Readouts(element("joints"), element("tcp"));
    this.status = new Status(api);
    this.banner = new Banner(api);
    this.planned = new Planned(() => this.readouts.ranges);
    this.motions = new Motions(api, (plan) => this.preview(plan), () => this.state);
    this.approvals = new Approvals(api, this.motions);
    this.freedrive = new Freedrive(api);
    this.waypoints = new Waypoints(api, this.motions, () => this.state, this.freedrive);
    this.stream = new Stream(api, {
      state: (state) => this.show(state),
      answer: (frame) => {
        this.jog.hear(frame);
        this.lease.hear(frame);
      },
      connected: (connected) => {
        this.status.connected(connected);
        this.lease.lost();
        if (!connected) this.jog.release();
      },
    });
    this.job = new Job(api);
    this.queue = new Queue(api);
    this.lua = new Lua(api);
    this.io = new Io(api);
    this.recordings = new Recordings(api, this.motions, () => this.view);
    this.csv = new Csv(api, () => this.state, () => this.readouts.ranges);
    this.live = new Live();
    this.log = new Log();
    this.events = new Events(api, (event) => this.hear(event));
    this.jog = new Jog(api, this.stream, this.readouts);
    this.lease = new Lease(api, this.stream);
    this.view = null;
    this.state = null;
    this.tag = null;
    this.lookAgain = oneAtATime(() => this.look());
  }

  async begin() {
    installStop(this.api, () => this.jog.release());
    const robots = await this.api.robots();
    this.tabs(robots);
    await this.choose(robots.find((robot) => robot.default));
    setInterval(() => this.lookAgain(), GEOMETRY_EVERY_MS);
    await this.draw();
  }

  tabs(robots) {
    const list = element("robots");
    list.hidden = robots.length < 2;
    list.replaceChildren(
      ...robots.map((robot) => {
        const tab = document.createElement("button");
        tab.type = "button";
        tab.textContent = robot.name;
        tab.dataset.robot = robot.name;
        tab.setAttribute("role", "tab");
        tab.addEventListener("click", () => this.choose(robot));
        return tab;
      }),
    );
  }

  async choose(robot) {
    this.jog.release();
    this.freedrive.end();
    this.api.robot = robot;
    for (const tab of element("robots").children) {
      tab.setAttribute("aria-selected", String(tab.dataset.robot === robot.name));
    }
    this.motions.discard();
    this.waypoints.load(robot.name);
    this.csv.forget();
    this.recordings.close();
    this.tag = this.state = null;
    await this.look();
    await this.motions.load();
    this.stream.open();
    this.log.clear();
    this.live.clear();
    this.events.open();
    this.approvals.look();
  }

  // What stands around the arm, its tool and its limits may change at any time.
  async look() {
    const found = await this.api.geometry(this.tag).catch(() => null);
    if (!found) return;
    this.tag = found.tag;
    this.geometry = found.geometry;
    this.readouts.describe(found.geometry.joints);
    this.live.describe(found.geometry.joints);
    this.view?.describe(found.geometry);
    if (this.state) this.show(this.state);
  }

  async draw() {
    const why = element("view-why");
    try {
      const { View } = await import("./view.js");
      this.view = new View(element("view"));
      if (this.geometry) this.view.describe(this.geometry);
      if (this.state) this.view.show(this.state);
      why.hidden = true;
    } catch (error) {
      why.dataset.word = "view_none";
      why.textContent = `${word("view_none")} ${error.message}`;
    }
  }

  hear(event) {
    for (const each of [this.job, this.queue, this.approvals, this.lua, this.waypoints, this.recordings]) each.hear(event);
    this.log.hear(event);
    this.status.hear(event);
    if (LOOKED_AT.includes(event.type)) this.lookAgain();
  }

  // What is planned, as a ghost and as curves; null for nothing.
  preview(plan) {
    this.view?.preview(plan);
    this.planned.show(plan);
  }

  show(state) {
    this.state = state;
    this.readouts.show(state);
    this.live.show(state);
    this.status.show(state);
    this.banner.show(state);
    this.view?.show(state);
  }
}

await installLanguages();
const api = new Api();
const panel = new Panel(api);
window.cobotPanel = panel; // for the browser's console and the tests
api.onToken = () => location.reload();
try {
  await panel.begin();
} catch (error) {
  element("view-why").textContent = error.message;
}
