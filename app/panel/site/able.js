// A control that cannot work is disabled, and its tooltip has the reason.
import { word } from "./words.js";

// why: a word of the catalogue; "" for a control that works.
export function allow(control, why) {
  control.disabled = why !== "";
  control.title = why && word(why);
}
