// Disables a control that cannot work now, and gives the reason in its tooltip.
import { word } from "./words.js";

// why: a word of the catalogue; "" for a control that works.
export function allow(control, why) {
  control.disabled = why !== "";
  control.title = why && word(why);
}
