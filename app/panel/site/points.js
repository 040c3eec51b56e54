// Timed points of a CSV or JSON file, and the velocities between them. The service reads the file again when it is
// sent, and decides whether it is valid: docs/trajectory-csv.md.
const SEPARATORS = [";", "\t", ","];
const TIMES = ["t", "time", "time_from_start"];
const [PLACES, HALVINGS] = [4, 30];

// {times, positions, velocities, accelerations}, of each joint a list; the last two are null if the file has none.
// null: no points.
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
  const [places, rates, bends] = ["joint", "velocity", "acceleration"].map(all);
  const whole = rows.every((row) => row.length === names.length && row.every(Number.isFinite));
  if (time < 0 || places.includes(-1) || !whole) return null;
  const of = (index) => rows.map((row) => row[index]);
  const times = of(time);
  if (!rise(times)) return null;
  const given = (columns) => (columns.includes(-1) ? null : columns.map(of));
  return { times, positions: places.map(of), velocities: given(rates), accelerations: given(bends) };
}

// The same of a JSON file, which is a body of POST /trajectory/send.
export function readJson(text, joints) {
  let points = null;
  try { ({ points } = JSON.parse(text)); } catch { return null; }
  const isWhole = (values) => Array.isArray(values) && values.length === joints && values.every(Number.isFinite);
  const isPoint = (point) => isWhole(point?.positions) && Number.isFinite(point.time_from_start);
  if (!Array.isArray(points) || !points.length || !points.every(isPoint)) return null;
  const times = points.map((point) => point.time_from_start);
  if (!rise(times)) return null;
  const columns = (name) => Array.from({ length: joints }, (_, joint) => points.map((point) => point[name][joint]));
  const given = (name) => (points.every((point) => isWhole(point[name])) ? columns(name) : null);
  return { times, positions: columns("positions"), velocities: given("velocities"), accelerations: given("accelerations") };
}

const rise = (times) => times.every((time, index) => time >= 0 && (!index || time > times[index - 1]));

// With where the arm is now before a first point that is later.
export function fromRest(found, now) {
  if (found.times[0] === 0) return found;
  const resting = (values) => [0, ...values];
  return {
    times: [0, ...found.times],
    positions: found.positions.map((values, joint) => [now[joint], ...values]),
    velocities: found.velocities?.map(resting) ?? null,
    accelerations: found.accelerations?.map(resting) ?? null,
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

// Accelerations of that spline at its points.
function curvatures(times, values, rates) {
  const last = times.length - 1;
  return times.map((_, index) => {
    const [from, sign] = index < last ? [index, 1] : [last - 1, -1];
    const step = times[from + 1] - times[from];
    const [mean, begin, end] = [(values[from + 1] - values[from]) / step, rates[from], rates[from + 1]];
    return (sign * (6 * mean - (sign > 0 ? 4 : 2) * begin - (sign > 0 ? 2 : 4) * end)) / step;
  });
}

// Where in a piece, from 0 to 1, a polynomial passes through 0; found by halving, between places that see it.
function zeros(polynomial) {
  const found = [];
  for (let place = 0; place < PLACES; place += 1) {
    let [low, high] = [place / PLACES, (place + 1) / PLACES];
    const rising = polynomial(low) < polynomial(high);
    if (polynomial(low) * polynomial(high) >= 0) continue;
    for (let turn = 0; turn < HALVINGS; turn += 1) {
      const middle = (low + high) / 2;
      if (polynomial(middle) < 0 === rising) low = middle;
      else high = middle;
    }
    found.push(low);
  }
  return found;
}

// [time, velocity] at the points and between them, where a piece is fastest or slowest. A piece is of the fifth
// degree, with the velocities and accelerations that are given; what is not given is that of the cubic spline.
export function velocityCurve(times, values, givenRates, givenBends) {
  if (times.length < 2) return [[times[0], 0]];
  const smooth = slopes(times, values);
  const [rates, bends] = [givenRates ?? smooth, givenBends ?? curvatures(times, values, smooth)];
  const found = [[times[0], rates[0]]];
  for (let index = 1; index < times.length; index += 1) {
    const step = times[index] - times[index - 1];
    const [begin, bend] = [rates[index - 1] * step, bends[index - 1] * step * step];
    const way = values[index] - values[index - 1] - begin - bend / 2;
    const faster = rates[index] * step - begin - bend;
    const change = bends[index] * step * step - bend;
    const [third, fourth, fifth] = [
      3 * (10 * way - 4 * faster + change / 2), 4 * (7 * faster - 15 * way - change), 5 * (6 * way - 3 * faster + change / 2),
    ];
    const velocity = (s) => (begin + s * (bend + s * (third + s * (fourth + s * fifth)))) / step;
    const extremes = zeros((s) => bend + s * (2 * third + s * (3 * fourth + s * 4 * fifth)));
    for (const each of extremes.length ? [...extremes, 1] : [0.5, 1]) found.push([times[index - 1] + each * step, velocity(each)]);
  }
  return found;
}
