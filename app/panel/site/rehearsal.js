// Dry runs of plans on a simulated copy of the robot.
import { whyOf } from "./reasons.js";
import { word } from "./words.js";

// Runs one plan after the other, up to the first problem. words: the result; problem: the service's sentence, or "".
export async function rehearsed(api, ids) {
  let [seconds, effort] = [0, 0];
  for (const id of ids) {
    const found = await api.post(`/plans/${id}/rehearse`);
    if (!found.runs_through) {
      const { problem } = found;
      const at = (seconds + problem.time_s).toFixed(1);
      return { words: () => word("rehearsed_not", { seconds: at, says: whyOf({ ...problem, reason: problem.says }) }), problem: problem.says };
    }
    seconds += found.duration_s;
    effort = Math.max(effort, ...found.effort);
  }
  return { words: () => word("rehearsed", { seconds: seconds.toFixed(1), percent: Math.round(100 * effort) }), problem: "" };
}
