// Where a body is in the frame of the one that it hangs on: forward kinematics of GET /robot/geometry.
// Quaternions are x, y, z, w. Pure arithmetic, without a browser.

export function multiply(a, b) {
  const [ax, ay, az, aw] = a;
  const [bx, by, bz, bw] = b;
  return [
    aw * bx + ax * bw + ay * bz - az * by,
    aw * by - ax * bz + ay * bw + az * bx,
    aw * bz + ax * by - ay * bx + az * bw,
    aw * bw - ax * bx - ay * by - az * bz,
  ];
}

export function rotate(q, v) {
  const [x, y, z, w] = q;
  const [tx, ty, tz] = [2 * (y * v[2] - z * v[1]), 2 * (z * v[0] - x * v[2]), 2 * (x * v[1] - y * v[0])];
  return [
    v[0] + w * tx + y * tz - z * ty,
    v[1] + w * ty + z * tx - x * tz,
    v[2] + w * tz + x * ty - y * tx,
  ];
}

const plus = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];

export function localPose(body, joints) {
  let { position, quaternion } = body;
  for (const joint of body.joints) {
    const value = joints[joint.index] - joint.reference;
    if (joint.slides) {
      position = plus(position, rotate(quaternion, joint.axis.map((each) => each * value)));
      continue;
    }
    const anchor = plus(position, rotate(quaternion, joint.anchor));
    const sine = Math.sin(value / 2);
    quaternion = multiply(quaternion, [...joint.axis.map((each) => each * sine), Math.cos(value / 2)]);
    position = minus(anchor, rotate(quaternion, joint.anchor));
  }
  return { position, quaternion };
}

// The TCP in the base frame, of GET /robot/geometry and joints: {position, quaternion}.
export function tcpOf({ bodies, base, tcp }, joints) {
  const placed = []; // each body in the frame of the world
  bodies.forEach((body, index) => {
    const own = localPose(body, joints);
    placed[index] = index ? chained(placed[body.parent], own) : own;
  });
  return chained(inverse(placed[base]), chained(placed[tcp.body], tcp));
}

// Upwards, in the base frame. Nothing moves the base.
export function upOf({ bodies, base }) {
  let up = [0, 0, 1];
  const chain = [];
  for (let index = base; index > 0; index = bodies[index].parent) chain.unshift(bodies[index]);
  for (const { quaternion: [x, y, z, w] } of [bodies[0], ...chain]) up = rotate([-x, -y, -z, w], up);
  return up;
}

function chained(outer, inner) {
  return {
    position: plus(outer.position, rotate(outer.quaternion, inner.position)),
    quaternion: multiply(outer.quaternion, inner.quaternion),
  };
}

function inverse({ position, quaternion: [x, y, z, w] }) {
  const back = [-x, -y, -z, w];
  return { position: rotate(back, position).map((each) => -each), quaternion: back };
}

// KUKA's angles A, B, C (about z, the new y, the newest x), rad, of a quaternion x, y, z, w.
export function abcOf([x, y, z, w]) {
  const sine = Math.max(-1, Math.min(1, 2 * (w * y - z * x)));
  return [
    Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
    Math.asin(sine),
    Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
  ];
}

// A pose moved by a step (m, rad; x, y, z each) in the base frame or in its own.
export function stepped(position, quaternion, step, inTool) {
  const way = step.slice(0, 3);
  const angle = Math.hypot(...step.slice(3));
  const axis = angle ? step.slice(3).map((each) => (each / angle) * Math.sin(angle / 2)) : [0, 0, 0];
  const turn = [...axis, Math.cos(angle / 2)];
  return inTool
    ? { position: plus(position, rotate(quaternion, way)), quaternion: multiply(quaternion, turn) }
    : { position: plus(position, way), quaternion: multiply(turn, quaternion) };
}
