// Bodies, joints and shapes of GET /robot/geometry as objects of three.js, with the looks of GET /robot/visuals.
import * as THREE from "../three/three.module.min.js";
import { readGlb } from "./glb.js";
import { localPose } from "./kinematics.js";

const BLAMED = 0xb00020;
const ROUND = 28; // sides of what is round

function solid({ shape, size, mesh }, meshes) {
  switch (shape) {
    case "box": return new THREE.BoxGeometry(...size);
    case "sphere": return new THREE.SphereGeometry(size[0], ROUND, ROUND / 2);
    case "ellipsoid": return new THREE.SphereGeometry(1, ROUND, ROUND / 2).scale(...size);
    case "cylinder": return new THREE.CylinderGeometry(size[0], size[0], size[1], ROUND).rotateX(Math.PI / 2);
    case "capsule": return new THREE.CapsuleGeometry(size[0], size[1], 8, ROUND).rotateX(Math.PI / 2);
    case "mesh": {
      const made = new THREE.BufferGeometry();
      made.setAttribute("position", new THREE.Float32BufferAttribute(meshes[mesh].vertices, 3));
      made.setIndex(meshes[mesh].triangles);
      const flat = made.toNonIndexed();
      flat.computeVertexNormals();
      return flat;
    }
    default: return null; // a plane is drawn as the grid
  }
}

function material([red, green, blue, alpha], ghost, vertexColors = false) {
  if (ghost) {
    const look = { color: 0x12a150, transparent: true, opacity: 0.35, depthWrite: false };
    const behind = { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 4 }; // the arm where both are
    return new THREE.MeshLambertMaterial({ ...look, ...behind });
  }
  const color = new THREE.Color().setRGB(red, green, blue, THREE.SRGBColorSpace);
  return new THREE.MeshLambertMaterial({ color, transparent: alpha < 1, opacity: alpha, vertexColors });
}

// Of GET /robot/visuals, by link: [{geometry, rgba, position, quaternion, scale}]. A mesh that does not come is left out.
export async function loadLooks(api) {
  const { visuals } = await api.get("/visuals");
  const meshes = new Map();
  const mesh = (number) => {
    if (!meshes.has(number)) meshes.set(number, api.bytes(`/visuals/${number}`).then(readGlb).catch(() => []));
    return meshes.get(number);
  };
  const looks = new Map();
  await Promise.all(visuals.map(async ({ link, shape, size, rgba, mesh: number, position, quaternion }) => {
    const parts = shape === "mesh" ? await mesh(number) : [{ geometry: solid({ shape, size }, []), rgba: [0.8, 0.8, 0.8, 1] }];
    const scale = shape === "mesh" ? size : [1, 1, 1];
    const made = parts.map((part) => ({ geometry: part.geometry, rgba: rgba ?? part.rgba, position, quaternion, scale }));
    if (made.length) looks.set(link, [...(looks.get(link) ?? []), ...made]);
  }));
  return looks;
}

// A part of the cell: GET /cell has the sizes of its shapes as the cell file has them.
export function drawnPart({ shape, size_m: size, mesh }) {
  return new THREE.Mesh(solid({ shape, size, mesh: 0 }, [mesh]), material([0.85, 0.51, 0.17, 1]));
}

// The fingers of a cell's hand, with the direction in which each opens along its x axis. They are drawn open.
const FINGERS = { "hand.finger1": 1, "hand.finger2": -1 };

export class Drawn {
  // looks: by link, see loadLooks. A ghost is the arm and what moves with it, in one colour.
  constructor(geometry, looks, ghost = false) {
    this.bodies = geometry.bodies;
    this.joints = geometry.joints.map(({ name }) => name);
    this.root = new THREE.Group();
    this.groups = geometry.bodies.map(() => new THREE.Group());
    this.hidden = []; // the collision shapes of bodies that have a look, and their looks
    const moves = [];
    geometry.bodies.forEach((body, index) => {
      const parent = index ? this.groups[body.parent] : this.root;
      parent.add(this.groups[index]);
      moves[index] = index > 0 && (moves[body.parent] || body.joints.length > 0);
      if (ghost && !moves[index]) return;
      this.add(index, body, geometry, looks.get(body.name) ?? [], ghost);
    });
    this.showCollision(false);
    this.tcp = new THREE.Group();
    this.tcp.position.set(...geometry.tcp.position);
    this.tcp.quaternion.set(...geometry.tcp.quaternion);
    if (!ghost) this.tcp.add(new THREE.AxesHelper(0.15));
    this.groups[geometry.tcp.body].add(this.tcp);
    this.place(new Array(geometry.joints.length).fill(0));
    // The base frame, in which all poses are, is where the page has its origin.
    this.root.updateMatrixWorld(true);
    this.root.applyMatrix4(this.groups[geometry.base].matrixWorld.clone().invert());
  }

  add(index, body, geometry, looks, ghost) {
    const looked = looks.length > 0 || body.shapes.some((shape) => !shape.collides);
    for (const shape of body.shapes) {
      const made = solid(shape, geometry.meshes);
      if (!made) continue;
      const mesh = new THREE.Mesh(made, material(shape.rgba, ghost));
      mesh.position.set(...shape.position);
      mesh.quaternion.set(...shape.quaternion);
      this.groups[index].add(mesh);
      if (looked) this.hidden.push([mesh, shape.collides]);
    }
    for (const { geometry: shared, rgba, position, quaternion, scale } of looks) {
      const mesh = new THREE.Mesh(shared, material(shared.attributes.color ? [1, 1, 1, 1] : rgba, ghost, Boolean(shared.attributes.color)));
      mesh.userData.shared = true;
      mesh.position.set(...position);
      mesh.quaternion.set(...quaternion);
      mesh.scale.set(...scale);
      this.groups[index].add(mesh);
      this.hidden.push([mesh, false]);
    }
  }

  // The shapes of the collision checks, or what the robot looks like.
  showCollision(shown) {
    for (const [mesh, collides] of this.hidden) mesh.visible = collides === shown;
    this.collision = shown;
    this.cover(this.covered ?? []);
  }

  // Objects with these names are drawn as parts of the cell, where they are. Here they are shapes of the checks only.
  cover(names) {
    this.covered = names;
    this.bodies.forEach(({ name, part }, index) => {
      if (part === "scene") this.groups[index].visible = this.collision || !names.includes(name);
    });
  }

  // Draws in red the bodies that a list or a sentence names, and those that a named joint moves; "" for none.
  blame(listed) {
    const said = listed.split(/[\s,:;]+/);
    const names = ({ name, joints }) => [name, ...joints.map(({ index }) => this.joints[index])];
    this.bodies.forEach((body, index) => {
      const blamed = index > 0 && names(body).some((each) => said.includes(each));
      for (const { material: own } of this.groups[index].children) own?.emissive?.setHex(blamed ? BLAMED : 0);
    });
  }

  place(joints) {
    this.bodies.forEach((body, index) => {
      const { position, quaternion } = localPose(body, joints);
      this.groups[index].position.set(...position);
      this.groups[index].quaternion.set(...quaternion);
      const side = body.part === "tool" ? FINGERS[body.name] : 0;
      if (side) this.groups[index].translateX(-0.5 * side * (this.closed ?? 0));
    });
  }

  // The TCP in the base frame: x, y, z, m.
  tcpPosition() {
    this.root.updateMatrixWorld(true);
    return this.tcp.getWorldPosition(new THREE.Vector3()).toArray();
  }

  dispose() {
    this.root.traverse((each) => {
      if (!each.userData.shared) each.geometry?.dispose();
      each.material?.dispose();
    });
    this.root.removeFromParent();
  }
}
