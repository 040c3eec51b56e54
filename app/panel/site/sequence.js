// The motions of a sequence file for planning, in groups of at most `MAX_MOTIONS`: docs/sequence-files.md.
const MAX_MOTIONS = 50; // of POST /robot/plan/sequence

// A target as POST /robot/plan/sequence takes it.
function motion({ label, comment, radius, named, through_radius: throughRadius, ...body }) {
  if (named !== undefined) body.name = named;
  if (throughRadius !== undefined) body.radius = throughRadius;
  return body;
}

// [{motions, radii}]: each ends where the arm stops.
export function partsOf({ home, waypoints }) {
  const targets = home ? [home, ...waypoints] : waypoints;
  const parts = [];
  for (let begin = 0; begin < targets.length; ) {
    const most = targets.slice(begin, begin + MAX_MOTIONS);
    const stop = most.findLastIndex((target) => !target.radius);
    const part = stop < 0 || most.length < MAX_MOTIONS ? most : most.slice(0, stop + 1);
    parts.push({ motions: part.map(motion), radii: part.slice(0, -1).map((target) => target.radius ?? 0) });
    begin += part.length;
  }
  return parts;
}

// Two plans, one after the other, as what is shown of one. It cannot be run as one.
export function followed(first, second) {
  const nearer = (name) => [first[name], second[name]].filter(Boolean).sort((one, other) => one.distance_m - other.distance_m)[0] ?? null;
  const share = first.utilisation.velocity.share.map((each, joint) => Math.max(each, second.utilisation.velocity.share[joint]));
  return {
    plan_id: null,
    ids: [...first.ids, ...second.ids],
    duration_s: first.duration_s + second.duration_s,
    note: [first.note, second.note].filter(Boolean).join("; "),
    path: [...first.path, ...second.path.map((point) => ({ ...point, time_s: first.duration_s + point.time_s }))],
    utilisation: { velocity: { share } },
    closest_self: nearer("closest_self"),
    closest_environment: nearer("closest_environment"),
  };
}
