// Why something was refused or has ended, in the language of the panel: from the code, the checks and the details of an
// error, as docs/conventions.md describes them. The service's own sentence is shown only where these say too little.
import { withShortNames } from "./joint-names.js";
import { named, word } from "./words.js";

const DEG = 180 / Math.PI;
const SHOWN_UNITS = { rad: [DEG, "°"], "rad/s": [DEG, "°/s"], "rad/s²": [DEG, "°/s²"], "rad/s³": [DEG, "°/s³"], m: [1000, "mm"], "m/s": [1000, "mm/s"], "m/s²": [1000, "mm/s²"], "m/s³": [1000, "mm/s³"] };
const MAX_CHECKS = 2;
const HOME = "0"; // the step that goes there first
const FROM_DEVICE = ["condition_unreadable", "device", "gripper_device", "hold_refused", "no_packets", "output_rejected", "reading", "writing"];

function amount(value, unit) {
  const [scale, shown] = SHOWN_UNITS[unit] ?? [1, unit];
  const scaled = scale * value;
  return `${scaled.toFixed(Math.abs(scaled) < 10 ? 1 : 0).replace(/^-(0(?:\.0)?)$/, "$1")} ${shown}`.replace(" °", "°").trim();
}

// One failed check.
function checked({ check, quantity, value, limit, unit, share, of }) {
  const percent = share === null ? null : Math.round(100 * share);
  const values = { of: of.map(withShortNames).join(" – "), value: amount(value, unit), limit: amount(limit, unit), by: amount(Math.abs(value - limit), unit), percent };
  const kinds = [`check_${check}_${quantity.replaceAll(" ", "_")}`, `check_${check}`];
  if (check === "collision") {
    Object.assign(values, { one: of[0], other: of[1], depth: amount(Math.abs(value), unit) });
    kinds.unshift(value < 0 ? "check_collision_in" : "check_collision_near");
  }
  const text = word(kinds.find((name) => word(name, {}, "")), values);
  return percent === null ? text : `${text} ${word("check_at", values)}`;
}

// Why a motion was stopped, from its cause; "" for a stop on request, of which the note next to the arm tells.
export function causeOf({ cause, by = "" } = {}) {
  return cause && cause !== "stop" ? word(`reason_${cause}`, { by: named(by) }, "") : "";
}

// Why the arm has stopped or moves slowly, from the fields `reason...` of a state, an event, a frame or details.
export function whyOf({ reason = "", reason_code: code = "", reason_of: of = "", reason_values: values = [], reason_unit: unit = "" }) {
  if (code === "stop") return "";
  const [value, limit] = values.map((each) => (each === null ? "?" : amount(each, unit)));
  const says = withShortNames(named(reason));
  return word(`reason_${code}`, { of: withShortNames(of), by: named(of), value, limit, says }, "") || says;
}

// Whether the sentence of such a reason has what only the device knows.
export function saysMore({ reason_code: code }) {
  return FROM_DEVICE.includes(code);
}

// The service's own sentence, which has what only the device knows.
export function sentenceOf(error) {
  return withShortNames(named(error.detail ?? error.message ?? ""));
}

// The step of a program that failed, and the step's own error.
function ofProgram(error) {
  const { step, code, message, ...details } = error.details;
  const why = reasonOf({ ...error, code, details, detail: message ?? sentenceOf(error) });
  const place = step === HOME ? word("step_home") : step;
  return place ? word("at_step", { step: place, why }) : why;
}

// error: {code, explain, details} and the service's sentence as `detail` or `message`; or a text.
export function reasonOf(error) {
  if (typeof error === "string") return error;
  if (error.details?.code) return ofProgram(error);
  const { code, explain, details } = error;
  const sentence = sentenceOf(error);
  if (!code) return sentence;
  const general = word(`error_${code}`, {}, ""); // for codes that explain themselves; the sentences of others name a field or a value
  if (details?.share !== undefined && (details.cause || details.reason_code || general)) {
    return [details.reason_code ? whyOf(details) : details.cause ? causeOf(details) : general, word("job_rest", { percent: Math.round(100 * details.share) })].filter(Boolean).join(" ");
  }
  const cause = code === "stopped" ? causeOf(details ?? {}) : details?.cause ? word(`${code}_${details.cause}`, { by: named(details.by ?? "") }, "") : "";
  if (cause) return cause;
  if (details?.reason_code) return whyOf({ ...details, reason: sentence });
  const checks = (explain?.checks ?? []).slice(0, MAX_CHECKS).map(checked);
  if (checks.length) {
    const works = [...new Set(explain.works.map(({ change }) => word(`change_${change}`)))];
    return [...checks, works.length ? word("works", { changes: works.join(", ") }) : ""].filter(Boolean).join(" ");
  }
  return general || word(`says_${code}`, { says: sentence }, "") || sentence;
}

// Why a job has ended; "" if it was stopped on request, which its state says already.
export function whyOfEnd(state, error) {
  const why = error ? reasonOf(error) : "";
  return state === "cancelled" && why === word("error_stopped") ? "" : why;
}
