// The surroundings of the arm and the named frames: chosen from a list, edited in fields, saved for all clients.
import { PlacedList } from "./placed-list.js";
import { Numbers } from "./numbers.js";
import { reasonOf } from "./reasons.js";
import { word } from "./words.js";

const MAX_FILE_BYTES = 30_000_000; // a larger one is not even read; the service says what it takes
const SIZES = {
  box: [["X", "mm"], ["Y", "mm"], ["Z", "mm"]],
  cylinder: [["size_radius", "mm"], ["size_length", "mm"]],
  sphere: [["size_radius", "mm"]],
  capsule: [["size_radius", "mm"], ["size_length", "mm"]],
  mesh: [],
};
const FIRST_M = { box: [0.2, 0.2, 0.2], cylinder: [0.05, 0.2], sphere: [0.1], capsule: [0.05, 0.2], mesh: [] };

function asBase64(file) {
  return new Promise((resolve, reject) => {
    const reader = new FileReader();
    reader.addEventListener("load", () => resolve(reader.result.split(",", 2)[1] ?? ""));
    reader.addEventListener("error", () => reject(reader.error));
    reader.readAsDataURL(file);
  });
}

class Frames extends PlacedList {
  get empty() {
    return word("frame_none");
  }

  title({ name }) {
    return name;
  }

  async save() {
    const read = this.read();
    if (!read) return;
    const { name, place } = read;
    const { sent } = this;
    if (await this.change({ frames: { [name]: place } }, () => word("saved", { name }))) this.settle(name, sent);
  }

  async remove() {
    const { name } = this.chosen;
    if (await this.change({ frames: { [name]: null } }, () => word("deleted", { name }))) this.show(null);
  }
}

class Objects extends PlacedList {
  constructor(api, tcp) {
    super(api, "object", "scene-all", tcp);
    this.file = null;
    this.part("shape").addEventListener("change", () => this.shape(FIRST_M[this.part("shape").value]));
    this.part("choose").addEventListener("click", () => this.part("file").click());
    this.part("file").addEventListener("change", () => this.take(this.part("file").files[0]));
    this.choose(null);
  }

  get empty() {
    return word("object_none");
  }

  title({ name, shape, attached }) {
    return `${name} (${word(`shape_${shape}`, {}, shape)}${attached ? `, ${word("object_held")}` : ""})`;
  }

  get typed() {
    return super.typed || Boolean(this.size?.changed) || this.file !== null;
  }

  // A shape with other fields than these can only be moved.
  get isMesh() {
    return !this.size?.rows.length;
  }

  show(one) {
    super.show(one);
    const known = !one || one.shape in SIZES;
    this.part("shape").value = known ? one?.shape ?? "box" : "mesh";
    this.file = null;
    this.shape(one && known && one.shape !== "mesh" ? one.size : FIRST_M[this.part("shape").value]);
  }

  mark(one) {
    super.mark(one);
    const held = Boolean(one?.attached);
    this.part("shape").disabled = this.part("frame").disabled = Boolean(one);
    for (const each of ["save", "here"]) this.part(each).disabled = held;
    this.part("save").title = held ? word("object_is_held") : "";
  }

  shape(sizes) {
    this.size = new Numbers(this.part("size"), SIZES[this.part("shape").value]);
    this.size.set(sizes);
    this.part("size-title").hidden = this.isMesh;
    this.part("mesh").hidden = !this.isMesh || Boolean(this.chosen);
    this.part("file-name").textContent = this.file?.name ?? "";
  }

  frames(names) {
    const chosen = this.part("frame").value;
    this.part("frame").replaceChildren(new Option(word("frame_base"), ""), ...names.map((name) => new Option(name, name)));
    if (names.includes(chosen)) this.part("frame").value = chosen;
  }

  take(file) {
    this.part("file").value = ""; // the same file may be chosen again
    if (!file) return;
    this.file = file.size > MAX_FILE_BYTES ? null : file;
    this.part("file-name").textContent = this.file?.name ?? "";
    if (!this.file) this.say(() => word("mesh_large", { mb: (file.size / 1e6).toFixed(0) }), "warn");
  }

  // The solid as in a request, without its pose; null if something is missing, and the reason is shown.
  async solid() {
    const shape = this.part("shape").value;
    const sizes = this.size.values();
    if (!sizes.every((each) => each > 0)) return void this.say(() => word("size_missing"), "warn");
    if (shape === "box") return { shape, size: sizes };
    if (shape !== "mesh") return { shape, radius: sizes[0], ...(sizes.length > 1 ? { length: sizes[1] } : {}) };
    if (!this.file) return void this.say(() => word("mesh_missing"), "warn");
    return { shape, file: await asBase64(this.file), scale: Number(this.part("unit").value) };
  }

  async save() {
    const read = this.read();
    if (!read) return;
    const { name, place } = read;
    const words = () => word("saved", { name });
    const { chosen, sent } = this;
    if (chosen?.name === name && !this.size.changed) {
      if (await this.change({ move: { [name]: place } }, words)) this.settle(name, sent);
      return;
    }
    if (chosen && this.isMesh) return void this.say(() => word("mesh_name"), "warn");
    const solid = await this.solid().catch((error) => void this.say(() => reasonOf(error), "warn"));
    if (!solid) return;
    const kept = chosen?.name === name ? weight(chosen) : {};
    const frame_id = chosen ? "" : this.part("frame").value;
    if (await this.change({ objects: { [name]: { ...solid, ...place, ...kept, frame_id } } }, words)) this.settle(name, sent);
  }

  get sent() {
    return { ...super.sent, file: this.file, size: this.size, sizes: this.size.sent };
  }

  settle(name, sent) {
    super.settle(name, sent);
    if (this.file === sent.file) this.file = null;
    sent.size.settle(sent.sizes);
  }

  async remove() {
    const { name } = this.chosen;
    if (await this.change({ objects: { [name]: null } }, () => word("deleted", { name }))) this.show(null);
  }
}

// An object that is resized keeps its mass. Its centre and inertia become those of a uniform density.
function weight({ mass }) {
  return mass ? { mass } : {};
}

export class Surroundings {
  constructor(api, tcp) {
    this.api = api;
    this.objects = new Objects(api, tcp);
    this.places = new Frames(api, "frame", "frames-all", tcp);
  }

  // Another robot was chosen.
  choose() {
    this.objects.choose(null);
    this.places.choose(null);
  }

  async look() {
    const { robot } = this.api;
    const scene = await this.api.get("/scene").catch(() => null);
    if (!scene || robot !== this.api.robot) return;
    this.objects.frames(scene.frames.map(({ name }) => name));
    this.objects.offer(scene.objects);
    this.places.offer(scene.frames);
  }
}
