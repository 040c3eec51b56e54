// The loose parts of a simulated cell, drawn where they are; its fixtures belong to the scene.
const EVERY_MS = 100;
const AGAIN_MS = 1000; // without an answer, for example until the simulation has reported the parts
const NONE_MS = 10_000; // a robot without a cell
const NONE = 404;

export class Cell {
  // view: gives the picture, null before there is one. told: called with the parts.
  constructor(api, view, told) {
    this.api = api;
    this.told = told;
    this.view = view;
    this.meshes = new Map(); // of parts, by robot and name
    this.ask();
  }

  async ask() {
    const { robot } = this.api;
    const view = this.view();
    let next = EVERY_MS;
    if (robot && view && !document.hidden) {
      let parts = [];
      try {
        parts = await this.parts("/cell");
      } catch (error) {
        next = error.status === NONE ? NONE_MS : AGAIN_MS;
      }
      const key = ({ name, size_m: size }) => `${robot} ${name} ${size}`;
      if (parts.some((part) => part.shape === "mesh" && !this.meshes.has(key(part)))) {
        parts = await this.parts("/cell?meshes=true").catch(() => []);
        for (const part of parts) this.meshes.set(key(part), part.mesh);
      }
      parts = parts.map((part) => ({ ...part, mesh: this.meshes.get(key(part)) ?? null }));
      if (robot === this.api.robot) {
        view.showParts(parts);
        this.told(parts);
      }
    }
    setTimeout(() => this.ask(), next);
  }

  parts(path) {
    return this.api.get(path).then((cell) => cell.parts);
  }
}
