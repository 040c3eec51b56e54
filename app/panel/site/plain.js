// Sentences of the service about a motion that was stopped, for people: without its endpoints and the numbers of jobs.
import { named, word } from "./words.js";

const AT_REST = /^(.*): the arm came to rest .* after (\d+) % of it(?:; (.*))?$/;
const STOPPED = /^(?:stopped by POST \/stop|stopped over the WebSocket by .*|stop requested)$/;
const CANCELLED = /^job \S+ was cancelled by (.*)$/;

// "" for what only says that there was a stop.
function causeOf(text) {
  const cancelled = CANCELLED.exec(text);
  if (cancelled) return word("job_ended_by", { by: named(cancelled[1]) });
  return STOPPED.test(text) ? "" : text;
}

export function plain(text) {
  const found = AT_REST.exec(text);
  if (!found) return causeOf(text);
  const [, cause, percent, waited] = found;
  return [causeOf(cause), word("job_rest", { percent }), waited].filter(Boolean).join(" ");
}
