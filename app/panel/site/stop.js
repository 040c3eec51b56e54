// One stop, on every page: the button, Space and Escape. It asks for nothing and waits for nothing.
const WRITING = "input:not([type=range]), textarea, [contenteditable]";

export function installStop(api, before) {
  const button = document.getElementById("stop");
  const stop = () => {
    before();
    button.dataset.pressed = String(Number(button.dataset.pressed || 0) + 1);
    api.stop().catch((error) => {
      document.getElementById("connection").textContent = error.message;
    });
  };
  button.addEventListener("click", stop);
  // First of all listeners, and on keydown: Space on a focused button shall stop, not press it.
  document.addEventListener(
    "keydown",
    (event) => {
      const space = event.code === "Space" && !event.target.closest?.(WRITING);
      if (!space && event.key !== "Escape") return;
      event.preventDefault();
      event.stopImmediatePropagation();
      if (!event.repeat) stop();
    },
    { capture: true },
  );
  document.addEventListener(
    "keyup",
    (event) => {
      if (event.code === "Space" && !event.target.closest?.(WRITING)) event.preventDefault();
    },
    { capture: true },
  );
}
