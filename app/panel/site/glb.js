// Reads a GLB file as /robot/visuals/{mesh} has it: triangles and colours, without textures and animations.
import * as THREE from "../three/three.module.min.js";

const [MAGIC, JSON_CHUNK, BINARY_CHUNK] = [0x46546c67, 0x4e4f534a, 0x004e4942];
const NUMBERS = { 5121: Uint8Array, 5123: Uint16Array, 5125: Uint32Array, 5126: Float32Array };
const ITEMS = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 };
const TRIANGLES = 4;

function chunks(buffer) {
  const view = new DataView(buffer);
  if (view.getUint32(0, true) !== MAGIC) throw new Error("this is no GLB file");
  const found = {};
  for (let at = 12; at < buffer.byteLength; ) {
    const [length, kind] = [view.getUint32(at, true), view.getUint32(at + 4, true)];
    found[kind] = buffer.slice(at + 8, at + 8 + length);
    at += 8 + length;
  }
  return [JSON.parse(new TextDecoder().decode(found[JSON_CHUNK])), found[BINARY_CHUNK]];
}

function numbersOf(file, binary, index) {
  const { bufferView, byteOffset = 0, componentType, count, type } = file.accessors[index];
  const { byteOffset: begin = 0 } = file.bufferViews[bufferView];
  const Kind = NUMBERS[componentType];
  const [from, length] = [begin + byteOffset, count * ITEMS[type]];
  return [new Kind(binary.slice(from, from + length * Kind.BYTES_PER_ELEMENT)), ITEMS[type]];
}

function geometryOf(file, binary, { attributes, indices }) {
  const made = new THREE.BufferGeometry();
  made.setAttribute("position", new THREE.BufferAttribute(...numbersOf(file, binary, attributes.POSITION)));
  if (indices !== undefined) made.setIndex(new THREE.BufferAttribute(...numbersOf(file, binary, indices)));
  if (attributes.NORMAL === undefined) made.computeVertexNormals();
  else made.setAttribute("normal", new THREE.BufferAttribute(...numbersOf(file, binary, attributes.NORMAL)));
  if (attributes.COLOR_0 !== undefined) {
    const [values, items] = numbersOf(file, binary, attributes.COLOR_0);
    made.setAttribute("color", new THREE.BufferAttribute(values, items, !(values instanceof Float32Array)));
  }
  return made;
}

function matrixOf({ matrix, translation = [0, 0, 0], rotation = [0, 0, 0, 1], scale = [1, 1, 1] }) {
  if (matrix) return new THREE.Matrix4().fromArray(matrix);
  const [place, turn, size] = [new THREE.Vector3(...translation), new THREE.Quaternion(...rotation), new THREE.Vector3(...scale)];
  return new THREE.Matrix4().compose(place, turn, size);
}

// [{geometry, rgba}], in metres, in the frame of the file; rgba: red, green, blue and opacity from 0 to 1.
export function readGlb(buffer) {
  const [file, binary] = chunks(buffer);
  const found = [];
  const visit = (index, above) => {
    const node = file.nodes[index];
    const here = above.clone().multiply(matrixOf(node));
    for (const primitive of file.meshes?.[node.mesh]?.primitives ?? []) {
      if ((primitive.mode ?? TRIANGLES) !== TRIANGLES) continue;
      const { baseColorFactor: rgba } = file.materials?.[primitive.material]?.pbrMetallicRoughness ?? {};
      found.push({ geometry: geometryOf(file, binary, primitive).applyMatrix4(here), rgba: rgba ?? [0.8, 0.8, 0.8, 1] });
    }
    for (const child of node.children ?? []) visit(child, here);
  };
  for (const root of file.scenes[file.scene ?? 0].nodes) visit(root, new THREE.Matrix4());
  return found;
}
