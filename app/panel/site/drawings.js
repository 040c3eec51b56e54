// Things in the picture that are not the arm: the ground, lines, a map.
import * as THREE from "../three/three.module.min.js";
import { hueAt } from "./clearance.js";

const MAP_SHARE = 0.6; // size of a point of a map, as a share of the distance of neighbours
const SHADOW_M = 0.45; // radius of the soft shadow under the arm
const CLEARANCE_M = 0.004; // radius of the line of a clearance

// A soft shadow on the ground: cheap, unlike one that follows the shape.
export function shadow() {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 64;
  const pen = canvas.getContext("2d");
  const fade = pen.createRadialGradient(32, 32, 4, 32, 32, 32);
  fade.addColorStop(0, "rgba(20, 25, 35, 0.45)");
  fade.addColorStop(1, "rgba(20, 25, 35, 0)");
  pen.fillStyle = fade;
  pen.fillRect(0, 0, 64, 64);
  const map = new THREE.CanvasTexture(canvas);
  const made = new THREE.Mesh(new THREE.CircleGeometry(SHADOW_M, 32), new THREE.MeshBasicMaterial({ map, transparent: true, depthWrite: false }));
  made.position.z = 0.001;
  return made;
}

export function clearanceLine({ points: ends, distance_m: distance }) {
  const color = new THREE.Color().setHSL(hueAt(distance) / 360, 0.85, 0.4);
  const look = new THREE.MeshBasicMaterial({ color, depthTest: false, transparent: true });
  const made = new THREE.Group();
  const [from, to] = ends.map((end) => new THREE.Vector3(...end));
  const rod = new THREE.Mesh(new THREE.CylinderGeometry(CLEARANCE_M, CLEARANCE_M, from.distanceTo(to), 8), look);
  rod.position.lerpVectors(from, to, 0.5);
  rod.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), to.clone().sub(from).normalize());
  made.add(rod);
  for (const end of [from, to]) {
    const ball = new THREE.Mesh(new THREE.SphereGeometry(2.5 * CLEARANCE_M, 12, 8), look);
    ball.position.copy(end);
    made.add(ball);
  }
  for (const each of made.children) each.renderOrder = 1;
  return made;
}

export function points({ positions, colours, spacing }) {
  const shape = new THREE.BufferGeometry();
  const color = new THREE.Color();
  const linear = colours.flatMap(([red, green, blue, opacity]) => [...color.setRGB(red, green, blue, THREE.SRGBColorSpace), opacity]);
  shape.setAttribute("position", new THREE.Float32BufferAttribute(positions.flat(), 3));
  shape.setAttribute("color", new THREE.Float32BufferAttribute(linear, 4));
  const look = new THREE.PointsMaterial({ size: MAP_SHARE * spacing, vertexColors: true, transparent: true, depthWrite: false });
  return new THREE.Points(shape, look);
}

// A line or a mesh leaves the picture; null for none.
export function remove(drawn) {
  drawn?.removeFromParent();
  drawn?.geometry.dispose();
}

export function grid() {
  const made = new THREE.GridHelper(4, 40, 0x8090a0, 0x8090a0);
  made.rotation.x = Math.PI / 2;
  made.material.transparent = true;
  made.material.opacity = 0.35;
  return made;
}

export function line(points, color) {
  const shape = new THREE.BufferGeometry().setFromPoints(points.map((point) => new THREE.Vector3(...point)));
  return new THREE.Line(shape, new THREE.LineBasicMaterial({ color }));
}
