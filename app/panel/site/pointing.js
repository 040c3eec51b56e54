// What a pointer touches in the picture: the handles of the TCP, and the links, which it pulls.
import * as THREE from "../three/three.module.min.js";

const PULLED = 0xf5b400;
const CHOSEN = 0x0b5cad;

export class Pointing {
  constructor(view) {
    this.view = view;
    this.marked = this.pulled = this.box = null;
    this.chosen = ""; // the part or object that is outlined
  }

  // The ray from the camera through a pointer.
  ray({ clientX, clientY }) {
    const { left, top, width, height } = this.view.renderer.domElement.getBoundingClientRect();
    const caster = new THREE.Raycaster();
    caster.setFromCamera(new THREE.Vector2((2 * (clientX - left)) / width - 1, 1 - (2 * (clientY - top)) / height), this.view.camera);
    return caster.ray;
  }

  // Whether a handle is under the pointer and can be dragged; then it is held.
  holdHandle(event) {
    const ray = this.ray(event);
    const handle = this.view.handles.at(ray);
    if (!handle || !this.view.handles.hold(handle, ray)) return false;
    this.mark(handle);
    return true;
  }

  dragHandle(event) {
    return this.view.handles.drag(this.ray(event));
  }

  releaseHandle() {
    this.view.handles.held = null;
    this.mark(null);
  }

  hoverHandle(event) {
    if (event.pointerType === "mouse") this.mark(this.view.handles.at(this.ray(event)));
  }

  mark(handle) {
    if (handle === this.marked) return;
    this.marked = handle;
    this.view.handles.mark(handle);
    this.view.place.style.cursor = handle ? "grab" : "";
    this.view.draw();
  }

  // The name of the part of the cell or the object of the scene under a pointer; "" for none.
  pickThing(event) {
    const { arm, parts, geometry } = this.view;
    if (!arm) return "";
    const { origin, direction } = this.ray(event);
    const caster = new THREE.Raycaster(origin, direction);
    const [met] = caster.intersectObjects([arm.root, ...parts.values()]).filter(({ object }) => object.isMesh && object.visible);
    if (!met) return "";
    for (const [key, mesh] of parts) if (mesh === met.object) return key.split(" ")[0];
    const body = geometry.bodies[arm.groups.indexOf(met.object.parent)];
    return body?.part === "scene" ? body.name : "";
  }

  // Outlines a part of the cell or an object of the scene; "" for none.
  choose(name) {
    this.chosen = name;
    this.view.draw();
  }

  // Where the chosen one is now, before a picture is drawn.
  outline() {
    const { arm, parts, geometry } = this.view;
    const part = [...parts].find(([key]) => key.split(" ")[0] === this.chosen)?.[1];
    const body = arm && !part ? geometry.bodies.findIndex((each) => each.part === "scene" && each.name === this.chosen) : -1;
    const found = this.chosen ? part ?? arm?.groups[body] : null;
    if (found && !this.box) this.view.scene.add((this.box = new THREE.BoxHelper(found, CHOSEN)));
    if (!this.box) return;
    this.box.visible = Boolean(found);
    if (found) this.box.setFromObject(found);
  }

  // The link under a pointer that the joints move: {link, body, point, target}; point is in its frame, target where
  // it is, in the base frame. null for none.
  pickLink(event) {
    if (!this.view.arm) return null;
    const { origin, direction } = this.ray(event);
    const [met] = new THREE.Raycaster(origin, direction).intersectObject(this.view.arm.root).filter(({ object }) => object.isMesh && object.visible);
    if (!met) return null;
    const { bodies } = this.view.geometry;
    let group = met.object;
    while (group && !this.view.arm.groups.includes(group)) group = group.parent;
    let body = this.view.arm.groups.indexOf(group);
    while (body > 0 && bodies[body].part !== "robot") body = bodies[body].parent; // what it carries
    let moves = body;
    while (moves > 0 && !bodies[moves].joints.length) moves = bodies[moves].parent;
    if (moves <= 0) return null;
    const point = this.view.arm.groups[body].worldToLocal(met.point.clone()).toArray();
    return { link: bodies[body].name, body, point, target: met.point.toArray() };
  }

  // Where a pointer pulls to: as far away from the camera as the link was.
  besideLink(event, { target }) {
    const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(this.view.camera.getWorldDirection(new THREE.Vector3()), new THREE.Vector3(...target));
    return this.ray(event).intersectPlane(plane, new THREE.Vector3())?.toArray() ?? target;
  }

  // A line from the point of the link to where it is pulled; null for none.
  showPull(held) {
    this.pulled?.removeFromParent();
    this.pulled?.geometry.dispose();
    this.pulled = null;
    if (held && this.view.arm) {
      const from = this.view.arm.groups[held.body].localToWorld(new THREE.Vector3(...held.point)).toArray();
      this.pulled = this.view.line([from, held.target], PULLED);
      this.pulled.material.depthTest = false;
    }
    this.view.draw();
  }
}
