// Menus that open under a button. Escape, a press elsewhere and leaving with Tab close them. Escape stops the arm
// first, in stop.js: a menu never takes a key of STOP.
const element = (id) => document.getElementById(id);
const open = () => document.querySelectorAll("details.menu[open]");

// Those that do not contain the element; null for all.
function closeAround(inside) {
  for (const menu of open()) if (!menu.contains(inside)) menu.open = false;
}

export function installMenus() {
  for (const type of ["pointerdown", "focusin"]) document.addEventListener(type, ({ target }) => closeAround(target));
  // stop.js keeps the press of Escape for itself, so a menu closes when the key is released.
  document.addEventListener("keyup", ({ key }) => {
    if (key !== "Escape") return;
    const menu = document.activeElement?.closest("details.menu[open]");
    closeAround(null);
    if (menu) menu.querySelector("summary").focus();
    element("offers").hidden = true;
  });
}
