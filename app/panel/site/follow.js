// A motion that is asked for without waiting, as it may take longer than any request: its job is followed.
const ENDS = ["finished", "failed", "cancelled", "interrupted"];
const BUSY = 503;
const WAIT_S = 2;
const AGAIN_MS = 1000;

// null once the arm has arrived, or the error for `reasonOf`. While nobody answers, or the service is too busy, the motion
// goes on, and so it is asked for again.
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
