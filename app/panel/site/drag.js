// Dragging the TCP in the picture: the handles move the target, and the typed values follow. Releasing them plans
// the motion and shows it; nothing moves before Execute is pressed.
import { abcOf, multiply, tcpOf } from "./kinematics.js";
import { inEachLanguage, word } from "./words.js";

const element = (id) => document.getElementById(id);

export class Drag {
  // now: {state, geometry, view, readouts, freedrive}; each of the first three may be missing.
  constructor(motions, now) {
    this.motions = motions;
    this.now = now;
    this.target = null; // {position, quaternion} while a place is dragged, planned or shown
    this.pointer = null; // which drags
    this.planning = false;
    const place = element("view");
    const listen = (type, hear) => place.addEventListener(type, hear, { capture: true });
    listen("pointerdown", (event) => this.press(event));
    listen("pointermove", (event) => this.move(event));
    listen("pointerup", (event) => this.release(event));
    listen("pointercancel", () => this.cancel(""));
    listen("lostpointercapture", (event) => event.pointerId === this.pointer && this.cancel(""));
    element("jog-frame").addEventListener("change", () => this.place());
    element("view-drag").addEventListener("click", () => this.toggle());
    document.addEventListener("cobot-stop", () => {
      if (this.planning) this.motions.discard(); // or the plan would come after the stop, and Enter would run it
      this.cancel("drag_stopped");
    });
    inEachLanguage(() => (this.name = word("drag_name")));
  }

  toggle() {
    const on = element("view-drag").getAttribute("aria-pressed") !== "true";
    element("view-drag").setAttribute("aria-pressed", String(on));
    this.cancel("");
    this.place();
  }

  // The handles are at the target, or else at the commanded TCP.
  place() {
    const { state, geometry, view, readouts, freedrive } = this.now();
    if (this.pointer === null && !this.planning && !this.motions.plan) readouts.aim(null); // the arm is on its way
    if (!view) return;
    const shown = state && geometry && document.body.dataset.page === "move" && !freedrive.on && element("view-drag").getAttribute("aria-pressed") === "true";
    if (!shown || this.pointer !== null) return void view.showHandles(shown ? undefined : null);
    const { position, quaternion } = this.pose(state, geometry);
    view.showHandles({ position, quaternion: element("jog-frame").value === "tool" ? quaternion : [0, 0, 0, 1] });
  }

  press(event) {
    const { state, geometry, view } = this.now();
    if (event.button !== 0 || !event.isPrimary || this.pointer !== null || !view || !state || !geometry) return;
    if (!view.pointing.holdHandle(event)) return;
    event.stopPropagation(); // the camera stays
    const from = this.pose(state, geometry);
    this.motions.discard(); // which forgets the target
    [this.pointer, this.from, this.target] = [event.pointerId, from, from];
    event.target.setPointerCapture(event.pointerId);
    this.motions.say(() => word("drag_hint"));
    this.now().readouts.aim(from);
  }

  move(event) {
    const { view, readouts } = this.now();
    if (!view) return;
    if (event.pointerId !== this.pointer) return void (this.pointer === null && view.pointing.hoverHandle(event));
    event.stopPropagation();
    const moved = view.pointing.dragHandle(event);
    if (!moved) return;
    const [x, y, z] = moved.axis.toArray();
    const { position, quaternion } = this.from;
    if (moved.turns) {
      const sine = Math.sin(moved.way / 2);
      this.target = { position, quaternion: multiply([x * sine, y * sine, z * sine, Math.cos(moved.way / 2)], quaternion) };
    } else {
      this.target = { position: position.map((each, axis) => each + moved.way * [x, y, z][axis]), quaternion };
    }
    const turned = element("jog-frame").value === "tool" ? this.target.quaternion : [0, 0, 0, 1];
    view.showHandles({ position: this.target.position, quaternion: turned });
    readouts.aim(this.target);
  }

  release(event) {
    if (event.pointerId !== this.pointer) return;
    event.stopPropagation();
    const moved = this.target !== this.from;
    this.letGo();
    if (moved) this.plan();
    else this.forget();
  }

  // Where the TCP is, or is to go next: {position, quaternion}.
  pose(state, geometry) {
    return this.target ?? tcpOf(geometry, state.commanded_position);
  }

  // A target from elsewhere, as if the handles had been dragged there.
  take(target, name, planner) {
    this.cancel("");
    this.motions.discard();
    this.target = target;
    this.place();
    this.plan(name, planner);
    this.now().readouts.aim(target);
  }

  async plan(name = this.name, planner = "lin") {
    const { target } = this;
    const [[x, y, z], [a, b, c]] = [target.position, abcOf(target.quaternion)];
    this.planning = true;
    const plan = await this.motions.toPose(name, { x, y, z, a, b, c }, planner);
    this.planning = false;
    if (!plan || target !== this.target) return void (target === this.target && this.forget());
    this.motions.again = () => this.plan(name, planner); // with another speed
    if (document.activeElement === document.body) element("execute").focus({ preventScroll: true }); // so that Enter runs it
  }

  // The plan that was shown is not shown any more.
  previewed(plan) {
    if (!plan && !this.planning && this.pointer === null) this.forget();
  }

  // why: a word, for a drag that ends without a plan; "" for none.
  cancel(why) {
    if (this.pointer === null) return;
    this.letGo();
    this.forget();
    this.motions.say(() => word(why || "plan_hint"));
  }

  letGo() {
    const canvas = element("view").querySelector("canvas");
    const { pointer } = this;
    this.pointer = null;
    if (canvas.hasPointerCapture(pointer)) canvas.releasePointerCapture(pointer);
    this.now().view?.pointing.releaseHandle();
  }

  forget() {
    this.target = null;
    this.now().readouts.aim(null);
    this.place();
  }
}
