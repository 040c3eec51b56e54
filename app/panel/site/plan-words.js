// What a plan is, in words: its duration, its clearance, and how it differs from the request.
import { word } from "./words.js";

const SELF_NEAR_M = 0.01; // an arm is always near to itself: only this little is worth a sentence

// How a plan differs from the request, in words. That the direct way is free is no news.
function noticed({ notices, note }) {
  const kinds = notices.filter(({ kind, values }) => kind !== "auto" || values.planner !== "ptp");
  if (!notices.length && note) return [word("notice_other")];
  return kinds.map(({ kind, values }) => word(`notice_${kind === "auto" ? values.planner : kind}`, values, word("notice_other")));
}

// Whether a planner has searched for the motion, so that more time may give a faster one.
export function isSearched({ planning, notices }) {
  const isDirect = notices.some(({ kind, values }) => kind === "auto" && values.planner === "ptp");
  return Boolean(planning) && !isDirect && (planning.quality !== "final" || planning.lower_bound_s !== null);
}

// How much faster a plan is than the first one for its request; "" for less than 1 %.
export function gained({ planning, duration_s: now }) {
  if (!planning?.improvements) return "";
  const { first_duration_s: first } = planning;
  const percent = Math.round(100 * (1 - now / first));
  return percent ? word("improved", { first: first.toFixed(1), percent }) : "";
}

// name: of its goal; null for none.
export function described(plan, name) {
  if (!plan.duration_s) return word("there_already");
  const { closest_environment: around, closest_self: own } = plan;
  const self = own && own.distance_m < SELF_NEAR_M ? own : null; // farther away it says nothing to a person
  const nearest = [around, self].filter(Boolean).sort((one, other) => one.distance_m - other.distance_m)[0];
  const distance = nearest
    ? word("closest", { mm: Math.round(1000 * nearest.distance_m), between: nearest.between.join(" – ") })
    : word("closest_none");
  const goal = name ? word("plan_to", { name }) : "";
  return [goal, word("takes", { seconds: plan.duration_s.toFixed(1) }), gained(plan), distance, ...noticed(plan)].filter(Boolean).join(" ");
}
