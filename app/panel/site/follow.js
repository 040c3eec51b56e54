// Motions are requested with `wait=false`, because they may take longer than a request may. Their jobs report the end.
const ENDS = ["finished", "failed", "cancelled", "interrupted"];
const BUSY = 503;
const WAIT_S = 2;
const AGAIN_MS = 1000;

// Requests a motion and waits for its end. Returns null if the arm has arrived, otherwise an error for `reasonOf`.
// A motion continues even if the service does not answer or is too busy to answer, so its job is then read again.
export async function moved(api, path, body) {
  const { robot } = api;
  let job = await api.post(`${path}?wait=false`, body);
  while (!ENDS.includes(job.state)) {
    try {
      job = await (await api.ask("GET", `${robot.path}/jobs/${job.id}?wait_s=${WAIT_S}`)).json();
    } catch (error) {
      if (error.status && error.status !== BUSY) throw error;
      await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
    }
  }
  return job.state === "finished" ? null : job.error ?? { code: job.state };
}
