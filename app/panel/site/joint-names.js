// Short names of joints. The fields, the plots and the messages of the panel use the same ones.
const shortOf = new Map();

// What is different in the names of joints: "J1" of "panda_joint1", "shoulder_pan" of "shoulder_pan_joint".
export function shortNames(names) {
  const numbered = names.map((name) => /^(.*?)(\d+)$/.exec(name));
  if (numbered.every((each) => each && each[1] === numbered[0][1])) return numbered.map((each) => `J${each[2]}`);
  const words = names.map((name) => name.split("_"));
  const same = (at) => words.length > 1 && words.every((each) => each.length > 1 && each.at(at) === words[0].at(at));
  while (same(0)) words.forEach((each) => each.shift());
  while (same(-1)) words.forEach((each) => each.pop());
  return words.map((each) => each.join("_"));
}

// Sets the joints whose names `withShortNames` replaces.
export function setJoints(names) {
  shortOf.clear();
  shortNames(names).forEach((short, index) => shortOf.set(names[index], short));
}

export function withShortNames(text) {
  return text.replace(/[A-Za-z_]\w*/g, (each) => shortOf.get(each) ?? each);
}
