// The name of the person at this browser, which is asked once where no token is used, and kept in the browser. The
// service shows it to others as text: it is a name and no proof.
import { PERSON, THROUGH_HUB } from "./api.js";
import { keep, keptText } from "./store.js";

const element = (id) => document.getElementById(id);

export class Person {
  // chosen: called with the name, "" for none.
  constructor(api, chosen) {
    this.form = element("name-form");
    this.chosen = chosen;
    this.form.hidden = THROUGH_HUB || Boolean(api.token) || keptText("localStorage", PERSON) !== null;
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.choose(element("person").value.trim());
    });
    element("no-name").addEventListener("click", () => this.choose(""));
  }

  choose(name) {
    keep("localStorage", PERSON, name);
    this.form.hidden = true;
    this.chosen(name);
  }
}
