// Timed points out of a CSV file, and the velocities between them. What a file may look like says the service,
// which reads it again when it is sent: docs/api.md, section 3.
const SEPARATORS = [";", "\t", ","];
const TIMES = ["t", "time", "time_from_start"];

// {times, positions, velocities}, of each joint a list; velocities is null if the file has none. null: no points.
export function read(text, joints) {
  const lines = text.replace(/^\uFEFF/, "").split(/\r\n|\r|\n/).filter((line) => line.trim());
  if (lines.length < 2) return null;
  const separator = SEPARATORS.find((each) => lines[0].includes(each));
  const cells = (line) => (separator ? line.split(separator) : line.trim().split(/\s+/)).map((cell) => cell.trim().replace(/^"(.*)"$/, "$1"));
  const names = cells(lines[0]).map((name) => name.toLowerCase().replace(/^(joint|velocity|acceleration)_?0*(\d+)$/, "$1$2"));
  const number = (cell) => (cell ? Number(separator === ";" ? cell.replace(",", ".") : cell) : NaN);
  const rows = lines.slice(1).map((line) => cells(line).map(number));
  const column = (name) => names.indexOf(name);
  const all = (kind) => Array.from({ length: joints }, (_, joint) => column(`${kind}${joint + 1}`));
  const time = names.findIndex((name) => TIMES.includes(name));
  const [places, rates] = [all("joint"), all("velocity")];
  const whole = rows.every((row) => row.length === names.length && row.every(Number.isFinite));
  if (time < 0 || places.includes(-1) || !whole) return null;
  const of = (index) => rows.map((row) => row[index]);
  const times = of(time);
  if (times.some((value, index) => value < 0 || (index && value <= times[index - 1]))) return null;
  return { times, positions: places.map(of), velocities: rates.includes(-1) ? null : rates.map(of) };
}

// With where the arm is now before a first point that is later.
export function fromRest({ times, positions, velocities }, now) {
  if (times[0] === 0) return { times, positions, velocities };
  return {
    times: [0, ...times],
    positions: positions.map((values, joint) => [now[joint], ...values]),
    velocities: velocities?.map((values) => [0, ...values]) ?? null,
  };
}

// Velocities of the cubic spline through points, from rest to rest: its second derivative is continuous.
export function slopes(times, values) {
  const last = times.length - 1;
  const found = new Array(last + 1).fill(0);
  const [above, right] = [[0], [0]];
  for (let index = 1; index < last; index += 1) {
    const [before, after] = [times[index] - times[index - 1], times[index + 1] - times[index]];
    const sides = (after * (values[index] - values[index - 1])) / before + (before * (values[index + 1] - values[index])) / after;
    const divisor = 2 * (before + after) - after * above[index - 1];
    above.push(before / divisor);
    right.push((3 * sides - after * right[index - 1]) / divisor);
  }
  for (let index = last - 1; index > 0; index -= 1) found[index] = right[index] - above[index] * found[index + 1];
  return found;
}

// [time, velocity] at the points and between them, where a cubic piece is fastest if that is within it.
export function velocityCurve(times, values, given) {
  const rates = given ?? slopes(times, values);
  const found = [[times[0], rates[0]]];
  for (let index = 1; index < times.length; index += 1) {
    const [step, begin, end] = [times[index] - times[index - 1], rates[index - 1], rates[index]];
    const mean = (values[index] - values[index - 1]) / step;
    const bend = 3 * (begin + end - 2 * mean); // of the velocity: begin + 2 (3 mean − 2 begin − end) s + bend s²
    const rise = 3 * mean - 2 * begin - end;
    const share = bend ? -rise / bend : -1;
    for (const each of share > 0 && share < 1 ? [share, 1] : [0.5, 1]) {
      found.push([times[index - 1] + each * step, begin + 2 * rise * each + bend * each * each]);
    }
  }
  return found;
}
