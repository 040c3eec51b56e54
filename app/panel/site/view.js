// The arm in 3D. It is drawn when something has changed, not otherwise.
import { OrbitControls } from "../three/OrbitControls.js";
import * as THREE from "../three/three.module.min.js";
import { clearanceLine, grid, line, points, remove, shadow } from "./drawings.js";
import { Gizmo } from "./gizmo.js";
import { Pointing } from "./pointing.js";
import { Drawn, drawnPart } from "./shapes.js";

const [PLANNED, RUNNING] = [0x12a150, 0xc2410c];
const TRACED = 0x7c3aed;
const MAX_TRACED = 2000; // points, 80 s of motion
const SAME_RAD = 0.01; // rad or m: a ghost that is where the arm is hides it
const UP = new THREE.Vector3(0, 0, 1);
// Where the camera is, from the middle of an arm whose box has this diagonal, m.
const VIEWS = { iso: [1.55, -1.5, 0.65], front: [2.25, 0, 0.1], top: [0.001, 0, 2.3] };
const [SIZE, HANDLES] = [1.3, 0.35]; // of the arm that VIEWS are for, and the height of the handles at the TCP, m
const GIZMO_PX = 84;

export class View {
  constructor(place) {
    this.place = place;
    this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.camera = new THREE.PerspectiveCamera(40, 1, 0.05, 50);
    this.camera.up.copy(UP);
    this.scene = new THREE.Scene();
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x8890a0, 2.0));
    const sun = new THREE.DirectionalLight(0xffffff, 2.2);
    sun.position.set(2, -3, 4);
    this.scene.add(sun, grid(), shadow());
    this.gizmo = new THREE.Scene();
    this.gizmo.add(new THREE.AxesHelper(1));
    this.gizmoCamera = new THREE.OrthographicCamera(-1.3, 1.3, 1.3, -1.3, 0, 10);
    this.gizmoCamera.up.copy(UP);
    place.prepend(this.renderer.domElement);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.target.set(0, 0, 0.5);
    this.camera.position.copy(this.controls.target).add(new THREE.Vector3(...VIEWS.iso));
    this.controls.addEventListener("change", () => this.draw());
    this.controls.update();
    this.blamed = ""; // names of the links that are red because of a fault
    this.framed = false;
    this.spare = null; // the next ghost, made in advance
    this.arm = this.ghost = this.path = this.way = this.map = this.plan = this.still = this.joints = null;
    this.parts = new Map(); // of a simulated cell, by name and shape
    this.looks = new Map(); // what the links look like, by name
    this.collision = false; // the shapes of the collision checks are shown in place of the looks
    this.handles = new Gizmo();
    this.scene.add(this.handles.root);
    this.pointing = new Pointing(this);
    this.trace = null; // the points that the TCP has passed, while they are shown
    this.traceLine = null;
    this.clearances = new Map(); // lines between the nearest points: of the arm, and of a plan
    this.frames = 0;
    this.asked = false;
    new ResizeObserver(() => this.resize()).observe(place);
    this.resize();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.place;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  describe(geometry) {
    const { plan, still } = this;
    this.preview(null);
    this.arm?.dispose();
    this.geometry = geometry;
    this.arm = new Drawn(geometry, this.looks);
    this.makeSpare();
    this.arm.showCollision(this.collision);
    this.arm.cover(this.partNames ?? []);
    this.arm.closed = this.closed;
    this.arm.blame(this.blamed);
    this.scene.add(this.arm.root);
    if (this.joints?.length === geometry.joints.length) this.arm.place(this.joints);
    if (plan) this.preview(plan);
    this.still = still;
    this.draw();
  }

  show(state) {
    if (!this.arm || state.position.length !== this.geometry.joints.length) return;
    if (this.joints?.every((value, index) => Math.abs(value - state.position[index]) < 1e-5)) return;
    this.joints = state.position;
    this.arm.place(state.position);
    if (!this.framed) this.look("iso");
    if (this.trace) this.followTcp();
    this.draw();
  }

  // Names of links or joints, between commas; "" for none.
  blame(names) {
    if (names === this.blamed) return;
    this.arm?.blame((this.blamed = names));
    this.draw();
  }

  // How much narrower than open the fingers are, m.
  grip(closed) {
    if (!this.arm || !this.joints || Math.abs(closed - (this.closed ?? 0)) < 1e-5) return;
    this.closed = this.arm.closed = closed;
    this.arm.place(this.joints);
    this.draw();
  }

  wear(looks) {
    this.looks = looks;
    if (this.geometry) this.describe(this.geometry);
  }

  showCollision(shown) {
    this.collision = shown;
    this.arm?.showCollision(shown);
    this.draw();
  }

  // Begins a trace of the TCP, or removes it.
  showTrace(shown) {
    this.trace = shown ? [] : null;
    this.followTcp();
    this.draw();
  }

  followTcp() {
    remove(this.traceLine);
    this.traceLine = null;
    if (!this.trace) return;
    this.trace = [...this.trace.slice(1 - MAX_TRACED), this.arm.tcpPosition()];
    this.traceLine = this.line(this.trace, TRACED);
  }

  // From this side, as far away as the size of the arm needs; "fit": from where the camera is.
  look(view) {
    if (!this.arm) return;
    const box = new THREE.Box3().setFromObject(this.arm.groups[this.geometry.base]);
    if (this.map) box.expandByObject(this.map);
    if (box.isEmpty()) return;
    box.max.z = Math.max(box.max.z, this.arm.tcpPosition()[2] + HANDLES); // they are seen too
    this.framed = true;
    const from = VIEWS[view] ? new THREE.Vector3(...VIEWS[view]) : this.camera.position.clone().sub(this.controls.target);
    from.setLength(new THREE.Vector3(...VIEWS.iso).length() * box.getSize(new THREE.Vector3()).length() / SIZE);
    box.getCenter(this.controls.target);
    this.camera.position.copy(this.controls.target).add(from);
    this.controls.update();
    this.draw();
  }

  line(points, color) {
    const made = line(points, color);
    this.scene.add(made);
    return made;
  }

  // The loose parts of the cell where they are.
  showParts(parts) {
    const shown = JSON.stringify(parts, (field, value) => (field === "mesh" ? Boolean(value) : value));
    if (shown === this.shownParts) return;
    this.shownParts = shown;
    const keys = parts.map(({ name, shape, size_m: size }) => `${name} ${shape} ${size}`);
    for (const [key, mesh] of this.parts) {
      if (keys.includes(key)) continue;
      remove(mesh);
      this.parts.delete(key);
    }
    parts.forEach((part, index) => {
      if (!this.parts.has(keys[index])) {
        if (part.shape === "mesh" && !part.mesh) return; // it comes with the next answer
        this.parts.set(keys[index], drawnPart(part));
        this.scene.add(this.parts.get(keys[index]));
      }
      const mesh = this.parts.get(keys[index]);
      mesh.position.set(...part.position);
      mesh.quaternion.set(...part.quaternion);
    });
    this.partNames = parts.map(({ name }) => name);
    this.arm?.cover(this.partNames);
    this.draw();
  }

  // A map: its points, their colours as sRGB with opacity, and the distance of neighbours. null for none.
  showMap(map) {
    const fit = !map !== !this.map;
    this.map?.removeFromParent();
    for (const part of this.map ? [this.map.geometry, this.map.material] : []) part.dispose();
    this.map = map && points(map);
    if (this.map) this.scene.add(this.map);
    if (fit) this.look("fit");
    this.draw();
  }

  // The way of the motion that runs: points of the TCP; none for no motion.
  follow(points) {
    remove(this.way);
    this.way = points.length ? this.line(points, RUNNING) : null;
    this.draw();
  }

  // The planned path, and a ghost that goes along it again and again; null for none.
  preview(plan) {
    this.ghost?.root.removeFromParent();
    remove(this.path);
    this.ghost = this.path = this.plan = null;
    this.still = null;
    this.showClearance("plan", plan?.duration_s ? plan.closest_environment : null);
    if (plan?.duration_s && this.geometry) {
      this.plan = plan;
      this.ghost = this.spare;
      this.path = this.line(plan.path.map((point) => point.position), PLANNED);
      this.scene.add(this.ghost.root);
    }
    this.draw();
  }

  // A ghost takes a while to make and its shaders to compile: it is there before it is shown, and is kept.
  makeSpare() {
    const before = this.spare;
    this.spare = new Drawn(this.geometry, this.looks, true);
    this.renderer.compile(this.spare.root, this.camera, this.scene);
    before?.dispose(); // afterwards, so that the compiled shaders are used again
  }

  // A line between the nearest points, visible through everything; null for none. of: "arm" or "plan".
  showClearance(of, nearest) {
    const before = this.clearances.get(of);
    if (!before && !nearest) return;
    before?.removeFromParent();
    before?.traverse((each) => each.geometry?.dispose());
    before?.children[0].material.dispose();
    this.clearances.delete(of);
    if (nearest) {
      this.clearances.set(of, clearanceLine(nearest));
      this.scene.add(this.clearances.get(of));
    }
    this.draw();
  }

  // The handles of the TCP: at a pose in the base frame; null hides them, and undefined leaves them where they are.
  showHandles(pose) {
    const { root } = this.handles;
    const shown = JSON.stringify(pose);
    if (pose === undefined || shown === this.shownHandles) return;
    this.shownHandles = shown;
    root.visible = pose !== null;
    if (pose) this.handles.place(new THREE.Vector3(...pose.position), new THREE.Quaternion(...pose.quaternion));
    this.draw();
  }

  // The ghost stays where it is at this time, s.
  hold(time) {
    this.still = time;
    this.draw();
  }

  haunt() {
    const { path, duration_s: duration } = this.plan;
    const time = this.still ?? Math.min(duration, (performance.now() / 1000) % (duration + 0.5));
    const next = Math.max(1, path.findIndex((point) => point.time_s >= time));
    const [before, after] = [path[next - 1], path[next]];
    const share = (time - before.time_s) / (after.time_s - before.time_s || 1);
    const joints = before.joints.map((value, joint) => value + share * (after.joints[joint] - value));
    this.ghost.place(joints);
    this.ghost.root.visible = !this.joints || joints.some((value, joint) => Math.abs(value - this.joints[joint]) > SAME_RAD);
  }

  draw() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      if (this.plan) this.haunt();
      this.pointing.outline();
      this.handles.fit(this.camera);
      this.renderer.render(this.scene, this.camera);
      this.drawGizmo();
      this.frames += 1;
      if (this.plan && this.still === null) this.draw();
    });
  }

  // The axes of the base frame in the corner: x red, y green, z blue.
  drawGizmo() {
    const { renderer, camera, controls, gizmoCamera } = this;
    gizmoCamera.position.copy(camera.position).sub(controls.target).setLength(5);
    gizmoCamera.lookAt(0, 0, 0);
    const { clientWidth: width, clientHeight: height } = this.place;
    renderer.autoClear = false;
    renderer.setViewport(4, 4, GIZMO_PX, GIZMO_PX);
    renderer.clearDepth();
    renderer.render(this.gizmo, gizmoCamera);
    renderer.setViewport(0, 0, width, height);
    renderer.autoClear = true;
  }
}
