// Puts the panel together: it chooses the robot, and passes its state and events on to the parts of the page.
import { Api } from "./api.js";
import { Approvals } from "./approvals.js";
import { Banner } from "./banner.js";
import { Cell } from "./cell.js";
import { Clearance } from "./clearance.js";
import { Csv } from "./csv.js";
import { Device } from "./device.js";
import { Drag } from "./drag.js";
import { Events } from "./events.js";
import { Freedrive } from "./freedrive.js";
import { DeviceIo } from "./device-io.js";
import { Gripper } from "./gripper.js";
import { Guide } from "./guide.js";
import { Halt } from "./halt.js";
import { Io } from "./io.js";
import { Job } from "./job.js";
import { Jog } from "./jog.js";
import { Lease } from "./lease.js";
import { Live } from "./live.js";
import { followLongTexts } from "./long-texts.js";
import { Log } from "./log.js";
import { Lua } from "./lua.js";
import { installMenus } from "./menus.js";
import { Motions } from "./motions.js";
import { Names } from "./names.js";
import { oneAtATime } from "./once.js";
import { Parts } from "./parts.js";
import { Person } from "./person.js";
import { Planned } from "./plots.js";
import { ProgramFiles } from "./program-files.js";
import { ProgramPage } from "./program-page.js";
import { Pull } from "./pull.js";
import { Queue } from "./queue.js";
import { Readouts } from "./readouts.js";
import { reasonOf, saysMore } from "./reasons.js";
import { Recordings } from "./recordings.js";
import { Run } from "./run.js";
import { RunNow } from "./run-now.js";
import { Setup } from "./setup.js";
import { Simulation } from "./simulation.js";
import { Speed } from "./speed.js";
import { Status } from "./status.js";
import { requests } from "./stop.js";
import { Stored } from "./stored.js";
import { Stream } from "./stream.js";
import { Pages, Robots } from "./tabs.js";
import { Typed } from "./typed.js";
import { ViewTools } from "./view-tools.js";
import { Way } from "./way.js";
import { installLanguages, word } from "./words.js";

const GEOMETRY_EVERY_MS = 30_000; // no event tells of changed limits
const AGAIN_MS = 1000;
const DOORS = [401, 403];
const LATCHED = ["ESTOP", "FAULT"];
const LOOKED_AT = ["hello", "scene", "tool", "service"];
const element = (id) => document.getElementById(id);

class Panel {
  constructor(api) {
    this.api = api;
    this.view = this.state = this.geometry = this.tag = this.looks = null;
    this.readouts = new Readouts(element("joints"), element("tcp"));
    this.device = new Device(api);
    this.status = new Status(api, this.device, () => this.ownStream, () => this.job.job?.state === "paused");
    this.banner = new Banner(api);
    this.planned = new Planned(() => this.readouts.ranges);
    this.speed = new Speed();
    this.motions = new Motions(api, (plan, still) => this.preview(plan, still), () => this.state, this.speed);
    this.approvals = new Approvals(api, this.motions);
    this.freedrive = new Freedrive(api);
    this.programPage = new ProgramPage(api, this.motions, () => this, this.freedrive);
    this.files = new ProgramFiles(this.programPage);
    this.stored = new Stored(api, this.programPage);
    this.names = new Names(api);
    this.run = new Run(api, this.programPage, this.motions, this.stored);
    this.runNow = new RunNow(api, this.programPage, this.stored);
    this.stream = new Stream(api, {
      state: (state) => this.show(state),
      answer: (frame) => this.answered(frame),
      connected: (connected) => this.connected(connected),
      silent: (silent) => this.silent(silent),
    });
    this.job = new Job(api, this.speed);
    this.queue = new Queue(api);
    this.lua = new Lua(api, this.programPage);
    this.io = new Io(api);
    this.deviceIo = new DeviceIo(api);
    this.gripper = new Gripper(api, () => this.view);
    this.recordings = new Recordings(api, this.motions, () => this.view);
    this.csv = new Csv(api, () => this.state, () => this.readouts.ranges);
    this.live = new Live();
    this.setup = new Setup(api, () => this);
    this.simulation = new Simulation(api);
    this.typed = new Typed(this.motions, () => this);
    this.drag = new Drag(this.motions, () => this);
    this.viewTools = new ViewTools(() => this.view);
    this.pages = new Pages(() => this.turnPage());
    this.log = new Log((name) => this.runNow.labelOf(name));
    this.events = new Events(api, (event) => this.hear(event));
    this.jog = new Jog(api, this.stream, this.readouts, () => this, this.speed);
    this.pull = new Pull(this.stream, () => this);
    this.lease = new Lease(api, this.stream);
    this.guide = new Guide(() => this.stored.list.filter(({ example }) => example).map(({ label }) => label));
    this.halt = new Halt();
    this.person = new Person(api, (name) => {
      if (name) this.stream.connect();
      this.guide.offer();
    });
    this.way = new Way(api, () => this.view);
    this.parts = new Parts(api, () => this);
    this.cell = new Cell(api, () => this.view, (parts) => this.arranged(parts));
    this.clearance = new Clearance(api, () => this.view);
    this.lookAgain = oneAtATime(() => this.look());
    document.addEventListener("cobot-stop", ({ detail }) => {
      this.jog.release();
      this.stream.send({ type: "stop", number: detail });
    });
    setInterval(() => this.lookAgain(), GEOMETRY_EVERY_MS);
  }

  // The stream that this page sends: "jog", "freedrive", or null.
  get ownStream() {
    if (this.jog.held) return "jog";
    return this.freedrive.on ? "freedrive" : null;
  }

  // As soon as the service answers.
  async begin() {
    try {
      this.tabs = new Robots(await this.api.robots(), (robot) => this.choose(robot));
      this.silent(false);
    } catch (error) {
      if (DOORS.includes(error.status)) return; // with a token the page is loaded again
      this.silent(true, reasonOf(error));
      setTimeout(() => this.begin(), AGAIN_MS);
      return;
    }
    await Promise.all([this.tabs.begin(), this.draw()]);
    if (this.person.form.hidden) this.guide.offer();
  }

  async choose(robot) {
    this.jog.clear();
    this.drag.cancel("");
    this.freedrive.end();
    this.api.robot = robot;
    this.status.name(robot);
    this.looks = null;
    this.motions.discard();
    this.stored.load();
    this.run.load();
    this.runNow.load();
    this.programPage.load(robot.name);
    this.csv.forget();
    this.setup.choose();
    this.recordings.close();
    this.tag = this.state = this.geometry = null;
    this.clearance.clear();
    await this.look();
    if (robot !== this.api.robot) return; // another one was chosen meanwhile
    this.state = null; // states of the robot before may have come until now
    this.stream.open();
    this.log.clear();
    this.halt.clear();
    this.parts.clear();
    this.live.clear();
    this.viewTools.clear();
    this.events.open(); // their first one has all parts look
  }

  connected(connected) {
    this.status.connected(connected);
    this.lease.lost();
    if (!connected) {
      this.jog.lose();
      this.drag.cancel("drag_lost");
      this.pull.release();
    }
    if (connected && !this.tag) this.lookAgain();
  }

  // No state has come for a second: what is shown is old.
  silent(silent, why) {
    document.body.toggleAttribute("data-silent", silent);
    this.banner.silent(silent, why);
    if (!silent) return;
    this.jog.lose();
    this.drag.cancel("drag_lost");
    this.state = null; // nothing may be planned from an old position
    this.clearance.clear();
  }

  answered(frame) {
    if (frame.type === "hello") requests.add(frame.request);
    if (frame.type === "stopped") document.dispatchEvent(new CustomEvent("cobot-stopped", { detail: frame }));
    this.jog.hear(frame);
    this.pull.hear(frame);
    this.lease.hear(frame);
  }

  // The surroundings of the arm, its tool and its limits may change at any time.
  async look() {
    const { robot } = this.api;
    if (robot && !this.looks) this.dress(robot);
    const found = robot && (await this.api.geometry(this.tag).catch(() => null));
    if (!found || robot !== this.api.robot) return;
    this.tag = found.tag;
    this.geometry = found.geometry;
    if (this.readouts.describe(found.geometry.joints)) this.jog.why = null;
    this.live.describe(found.geometry.joints);
    this.setup.describe(found.geometry.joints);
    this.programPage.tree.write(); // which shows where the TCP is at joints
    this.view?.describe(found.geometry);
    if (this.state) this.show(this.state);
  }

  // The arm is drawn by its collision shapes until its looks are here.
  async dress(robot) {
    if (!this.view) return;
    this.looks = new Map();
    const { loadLooks } = await import("./shapes.js");
    const looks = await loadLooks(this.api).catch(() => null);
    if (robot !== this.api.robot) return;
    if (looks) this.view.wear(looks);
    else this.looks = null; // asked for again with the next look
  }

  async draw() {
    const why = element("view-why");
    try {
      const { View } = await import("./view.js");
      this.view = new View(element("view"));
      if (this.geometry) this.view.describe(this.geometry);
      if (this.api.robot && !this.looks) this.dress(this.api.robot);
      this.way.look();
      if (this.state) this.view.show(this.state);
      this.clearance.draw();
      why.hidden = true;
    } catch (error) {
      why.dataset.word = "view_none";
      why.textContent = `${word("view_none")} ${reasonOf(error)}`;
    }
  }

  hear(event) {
    const heard = [this.job, this.queue, this.approvals, this.motions, this.lua, this.run, this.runNow, this.names, this.recordings, this.log, this.status, this.setup, this.way, this.stored, this.simulation];
    for (const each of [...heard, this.halt, this.parts]) each.hear(event);
    if (LOOKED_AT.includes(event.type)) this.lookAgain();
  }

  // The loose parts of a simulated cell are here.
  arranged(parts) {
    this.parts.show(parts);
    this.clearance.write(); // which says that they do not count
  }

  // What is planned, as a ghost and as curves; null for nothing. still: the time at which the ghost stays, s.
  preview(plan, still = null) {
    this.view?.preview(plan);
    if (still !== null) this.view?.hold(still);
    this.planned.show(plan);
    this.drag?.previewed(plan);
  }

  turnPage() {
    this.view?.resize();
    this.drag?.cancel("");
    this.drag?.place();
    this.setup?.people.look();
  }

  show(state) {
    this.state = state;
    this.readouts.show(state);
    this.live.show(state);
    this.status.show(state);
    this.banner.show(state);
    this.jog.show(state);
    this.motions.show(state);
    this.viewTools.show(state);
    this.view?.show(state);
    this.drag.place();
    this.clearance.show(state, this.tag);
    this.view?.blame(LATCHED.includes(state.mode) ? (saysMore(state) ? state.reason : state.reason_of) : "");
  }
}

const api = new Api();
api.onToken = () => location.reload();
installMenus();
followLongTexts();
await installLanguages();
const panel = new Panel(api);
window.cobotPanel = panel; // for the browser's console and the tests
await panel.begin();
