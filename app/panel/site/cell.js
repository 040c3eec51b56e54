// The loose parts of a simulated cell, drawn where they are; its fixtures belong to the scene.
const EVERY_MS = 100;
const AGAIN_MS = 10_000; // a robot without a cell

export class Cell {
  // view: gives the picture, null before there is one.
  constructor(api, view) {
    this.api = api;
    this.view = view;
    this.meshes = new Map(); // of parts, by robot and name
    this.ask();
  }

  async ask() {
    const { robot } = this.api;
    const view = this.view();
    let next = EVERY_MS;
    if (robot && view && !document.hidden) {
      let parts = await this.parts("/cell");
      const key = ({ name, size_m: size }) => `${robot} ${name} ${size}`;
      if (parts.some((part) => part.shape === "mesh" && !this.meshes.has(key(part)))) {
        parts = await this.parts("/cell?meshes=true");
        for (const part of parts) this.meshes.set(key(part), part.mesh);
      }
      parts = parts.map((part) => ({ ...part, mesh: this.meshes.get(key(part)) ?? null }));
      if (robot === this.api.robot) view.showParts(parts);
      if (!parts.length) next = AGAIN_MS;
    }
    setTimeout(() => this.ask(), next);
  }

  parts(path) {
    return this.api.get(path).then((cell) => cell.parts, () => []);
  }
}
