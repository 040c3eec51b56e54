// The handles at the TCP: three arrows and three rings, which the mouse or a finger drags. They only give a pose.
import * as THREE from "../three/three.module.min.js";

const SIZE = 0.16; // of the distance of the camera
const COLOURS = [0xd6293e, 0x2e9e3f, 0x2f6fd6]; // x, y, z, as those of the axes
const HELD = 0xf5b400;
const AXES = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((axis) => new THREE.Vector3(...axis));
const Y = new THREE.Vector3(0, 1, 0);
const FLAT = 0.15; // sine of the least angle between the view and an arrow or the plane of a ring, to drag it

export class Gizmo {
  // pose: {position, quaternion} of three.js, in the base frame.
  constructor() {
    this.root = new THREE.Group();
    this.root.visible = false;
    this.handles = AXES.flatMap((axis, index) => [arrow(axis, index), ring(axis, index)]);
    this.root.add(...this.handles.map((each) => each.shown), ...this.handles.map((each) => each.touched));
    this.held = null;
  }

  place(position, quaternion) {
    this.root.position.copy(position);
    this.root.quaternion.copy(quaternion);
  }

  // As large on the screen from near as from far away.
  fit(camera) {
    this.root.scale.setScalar(SIZE * camera.position.distanceTo(this.root.position));
    this.root.updateMatrixWorld(true);
  }

  // The handle that a ray meets, an arrow rather than a ring; or null.
  at(ray) {
    if (!this.root.visible) return null;
    const caster = new THREE.Raycaster(ray.origin, ray.direction);
    const met = caster.intersectObjects(this.handles.map((each) => each.touched)).map(({ object }) => this.handles.find((each) => each.touched === object));
    return met.find((each) => !each.turns) ?? met[0] ?? null;
  }

  mark(handle) {
    for (const { shown, index } of this.handles) {
      shown.traverse((each) => each.material?.color.setHex(shown === handle?.shown ? HELD : COLOURS[index]));
    }
  }

  // Returns whether this handle can be dragged from here; `drag` then gives the pose for each ray.
  hold(handle, ray) {
    const axis = AXES[handle.index].clone().applyQuaternion(this.root.quaternion);
    this.held = { handle, axis, position: this.root.position.clone(), quaternion: this.root.quaternion.clone(), last: 0 };
    this.held.from = this.measure(ray);
    if (this.held.from === null) this.held = null;
    return this.held !== null;
  }

  // How far the handle is moved, m, or turned, rad: {way, axis, turns}.
  drag(ray) {
    const { handle, axis, from } = this.held;
    const now = this.measure(ray);
    if (now === null) return null;
    const way = handle.turns ? this.unwound(now - from) : now - from;
    return { way, axis, turns: handle.turns };
  }

  unwound(angle) {
    const turn = 2 * Math.PI;
    this.held.last = angle + turn * Math.round((this.held.last - angle) / turn);
    return this.held.last;
  }

  // Where a ray is along the held arrow, or about the held ring; null if the view is too flat to tell.
  measure({ origin, direction }) {
    const { handle, axis, position } = this.held;
    const along = direction.dot(axis);
    const offset = position.clone().sub(origin);
    if (handle.turns) {
      if (Math.abs(along) < FLAT) return null;
      const arm = direction.clone().multiplyScalar(offset.dot(axis) / along).sub(offset);
      const [u, v] = across(axis);
      return Math.atan2(arm.dot(v), arm.dot(u));
    }
    const square = 1 - along * along;
    return square < FLAT * FLAT ? null : (along * offset.dot(direction) - offset.dot(axis)) / square;
  }
}

// Two axes that are at right angles to this one and to each other.
function across(axis) {
  const u = new THREE.Vector3(...(Math.abs(axis.x) < 0.9 ? [1, 0, 0] : [0, 1, 0])).cross(axis).normalize();
  return [u, axis.clone().cross(u)];
}

function look(index) {
  return new THREE.MeshBasicMaterial({ color: COLOURS[index], depthTest: false, transparent: true, opacity: 0.85 });
}

const unseen = new THREE.MeshBasicMaterial({ visible: false });

function arrow(axis, index) {
  const shown = new THREE.Group();
  const shaft = new THREE.Mesh(new THREE.CylinderGeometry(0.012, 0.012, 0.8, 8), look(index));
  const tip = new THREE.Mesh(new THREE.ConeGeometry(0.05, 0.2, 12), look(index));
  shaft.position.y = 0.6;
  tip.position.y = 1.1;
  shown.add(shaft, tip);
  const touched = new THREE.Mesh(new THREE.CylinderGeometry(0.09, 0.09, 1, 6).translate(0, 0.75, 0), unseen);
  return handle(shown, touched, axis, index, false);
}

function ring(axis, index) {
  const shown = new THREE.Mesh(new THREE.TorusGeometry(0.7, 0.012, 6, 48).rotateX(Math.PI / 2), look(index));
  const touched = new THREE.Mesh(new THREE.TorusGeometry(0.7, 0.07, 4, 32).rotateX(Math.PI / 2), unseen);
  return handle(shown, touched, axis, index, true);
}

function handle(shown, touched, axis, index, turns) {
  for (const each of [shown, touched]) each.quaternion.setFromUnitVectors(Y, axis);
  shown.traverse((each) => (each.renderOrder = 2));
  return { shown, touched, index, turns };
}
