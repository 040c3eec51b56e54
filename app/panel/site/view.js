// The arm in 3D. It is drawn when something has changed, not otherwise.
import { OrbitControls } from "/three/OrbitControls.js";
import * as THREE from "/three/three.module.min.js";
import { Drawn, drawnPart } from "./shapes.js";

const [PLANNED, RUNNING] = [0x12a150, 0xc2410c];
const UP = new THREE.Vector3(0, 0, 1);
const FROM = new THREE.Vector3(1.55, -1.5, 0.65); // the camera, seen from the middle of an arm of this size:
const SIZE = 1.3; // m, diagonal of the box around it

export class View {
  constructor(place) {
    this.place = place;
    this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.camera = new THREE.PerspectiveCamera(40, 1, 0.05, 50);
    this.camera.up.copy(UP);
    this.scene = new THREE.Scene();
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x8890a0, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 1.8);
    sun.position.set(2, -3, 4);
    this.scene.add(sun, this.grid());
    place.prepend(this.renderer.domElement);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.target.set(0, 0, 0.5);
    this.camera.position.copy(this.controls.target).add(FROM);
    this.controls.addEventListener("change", () => this.draw());
    this.controls.update();
    this.framed = false;
    this.arm = this.ghost = this.path = this.way = this.plan = this.still = this.joints = null;
    this.parts = new Map(); // of a simulated cell, by name and shape
    this.frames = 0;
    this.asked = false;
    new ResizeObserver(() => this.resize()).observe(place);
    this.resize();
  }

  grid() {
    const grid = new THREE.GridHelper(4, 40, 0x8090a0, 0x8090a0);
    grid.rotation.x = Math.PI / 2;
    grid.material.transparent = true;
    grid.material.opacity = 0.35;
    return grid;
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
    this.arm = new Drawn(geometry);
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
    if (!this.framed) this.frame();
    this.draw();
  }

  // The camera as far from the arm as its size wants it; once, as people move the camera then.
  frame() {
    const box = new THREE.Box3().setFromObject(this.arm.root);
    if (box.isEmpty()) return;
    this.framed = true;
    box.getCenter(this.controls.target);
    const distance = box.getSize(new THREE.Vector3()).length() / SIZE;
    this.camera.position.copy(FROM).multiplyScalar(distance).add(this.controls.target);
    this.controls.update();
  }

  line(points, color) {
    const shape = new THREE.BufferGeometry().setFromPoints(points.map((point) => new THREE.Vector3(...point)));
    const made = new THREE.Line(shape, new THREE.LineBasicMaterial({ color }));
    this.scene.add(made);
    return made;
  }

  // The loose parts of the cell where they are.
  showParts(parts) {
    const shown = JSON.stringify(parts);
    if (shown === this.shownParts) return;
    this.shownParts = shown;
    const keys = parts.map(({ name, shape, size_m: size }) => `${name} ${shape} ${size}`);
    for (const [key, mesh] of this.parts) {
      if (keys.includes(key)) continue;
      mesh.removeFromParent();
      mesh.geometry.dispose();
      this.parts.delete(key);
    }
    parts.forEach((part, index) => {
      if (!this.parts.has(keys[index])) {
        this.parts.set(keys[index], drawnPart(part));
        this.scene.add(this.parts.get(keys[index]));
      }
      const mesh = this.parts.get(keys[index]);
      mesh.position.set(...part.position);
      mesh.quaternion.set(...part.quaternion);
    });
    this.draw();
  }

  // The way of the motion that runs: points of the TCP; none for no motion.
  follow(points) {
    this.way?.removeFromParent();
    this.way?.geometry.dispose();
    this.way = points.length ? this.line(points, RUNNING) : null;
    this.draw();
  }

  // The planned path, and a ghost that goes along it again and again; null for none.
  preview(plan) {
    this.ghost?.dispose();
    this.path?.removeFromParent();
    this.path?.geometry.dispose();
    this.ghost = this.path = this.plan = null;
    this.still = null;
    if (plan?.duration_s && this.geometry) {
      this.plan = plan;
      this.ghost = new Drawn(this.geometry, true);
      this.path = this.line(plan.path.map((point) => point.position), PLANNED);
      this.scene.add(this.ghost.root);
    }
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
    this.ghost.place(before.joints.map((value, joint) => value + share * (after.joints[joint] - value)));
  }

  draw() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      if (this.plan) this.haunt();
      this.renderer.render(this.scene, this.camera);
      this.frames += 1;
      if (this.plan && this.still === null) this.draw();
    });
  }
}
