// A curve over time with its limits, as SVG.
const SPACE = "http://www.w3.org/2000/svg";
const [WIDTH, HEIGHT] = [200, 48];
const COLUMNS = 200;

function node(kind, attributes) {
  const made = document.createElementNS(SPACE, kind);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

// Of many points no more than can be seen: in each column the least and the greatest.
function thinned(points) {
  if (points.length <= 4 * COLUMNS) return points;
  const size = Math.ceil(points.length / COLUMNS);
  const kept = [];
  for (let begin = 0; begin < points.length; begin += size) {
    const part = points.slice(begin, begin + size);
    const order = [...part].sort((one, other) => one[1] - other[1]);
    kept.push(...[part[0], order[0], order.at(-1), part.at(-1)].sort((one, other) => one[0] - other[0]));
  }
  return kept;
}

// points: [time, value], the times rising; limits: values at which a dashed line is drawn.
export function curve(points, [low, high], label) {
  const picture = node("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", role: "img", "aria-label": label });
  const values = points.map((point) => point[1]);
  const least = values.reduce((one, other) => Math.min(one, other), low);
  const most = values.reduce((one, other) => Math.max(one, other), high);
  const margin = 0.05 * (most - least);
  const [begin, end] = [points[0][0], points.at(-1)[0]];
  const across = (time) => ((time - begin) / (end - begin || 1)) * WIDTH;
  const down = (value) => HEIGHT - ((value - least + margin) / (most - least + 2 * margin || 1)) * HEIGHT;
  for (const limit of [low, high]) {
    picture.append(node("line", { class: "limit", x1: 0, x2: WIDTH, y1: down(limit), y2: down(limit) }));
  }
  const drawn = thinned(points).map(([time, value]) => `${across(time).toFixed(2)},${down(value).toFixed(2)}`);
  const beyond = values.some((value) => value < low || value > high);
  picture.append(node("polyline", { class: beyond ? "curve beyond" : "curve", points: drawn.join(" ") }));
  return picture;
}
