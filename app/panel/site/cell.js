// The loose parts of a simulated cell, drawn where they are; its fixtures belong to the scene.
const EVERY_MS = 100;
const AGAIN_MS = 10_000; // a robot without a cell

export class Cell {
  // view: gives the picture, null before there is one.
  constructor(api, view) {
    this.api = api;
    this.view = view;
    this.ask();
  }

  async ask() {
    const { robot } = this.api;
    const view = this.view();
    let next = EVERY_MS;
    if (robot && view && !document.hidden) {
      const parts = await this.api.get("/cell").then((cell) => cell.parts, () => []);
      if (robot === this.api.robot) view.showParts(parts);
      if (!parts.length) next = AGAIN_MS;
    }
    setTimeout(() => this.ask(), next);
  }
}
