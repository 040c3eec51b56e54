"""Motions that the service carries out while the program goes on."""

from __future__ import annotations

import math

from cobot.client.connection import ERRORS, Connection, Json
from cobot.clock import SYSTEM
from cobot.errors import ExecutionError, MotionTimeout

ENDS = ("finished", "failed", "cancelled", "interrupted")
POLL_S = 5.0
"""The service is asked to answer at the end of a job, and after so long in any case."""


class JobHandle:
    """A job, as `Client.move_joints(..., wait=False)` gives it.

    Attributes:
        id: its number.

    Every method raises as those of `Client` do: `NotFoundError` once the service has forgotten the job.
    """

    def __init__(self, connection: Connection, job: str) -> None:
        self._connection = connection
        self.id = job

    @property
    def state(self) -> str:
        """queued, planning, running, paused; finished, failed, cancelled, interrupted."""
        return str(self.read()["state"])

    def read(self, wait_s: float = 0.0) -> Json:
        """The job as it is now, or once it has ended, `wait_s` from now at the latest (60 at the most)."""
        return self._connection._json(
            "GET", f"/jobs/{self.id}", params={"wait_s": wait_s}, timeout=wait_s + 10.0
        )

    def wait(self, timeout_s: float = math.inf) -> Json:
        """The job once the arm has arrived and settled.

        Raises:
            MotionTimeout: it goes on after `timeout_s`.
            CobotError: it has not arrived, of the class that its `code` names.
        """
        until_s = SYSTEM.now_s() + timeout_s
        while (job := self.read(max(min(POLL_S, until_s - SYSTEM.now_s()), 0.0)))["state"] not in ENDS:
            if SYSTEM.now_s() >= until_s:
                raise MotionTimeout(f"job {self.id} is {job['state']} after {timeout_s:g} s")
        if job["error"] is not None:
            error = ERRORS.get(str(job["error"]["code"]), ExecutionError)(job["error"]["detail"])
            error.explain = job["error"].get("explain")
            raise error
        return job

    def cancel(self) -> Json:
        """End it: the arm comes to rest on its path."""
        return self._tell("cancel")

    def pause(self, at_waypoint: int | None = None) -> Json:
        """Bring the arm to rest on its path; the job waits there.

        Args:
            at_waypoint: have a sequence wait there instead, once it has reached it; 0: at the next one.
        """
        return self._tell("pause", **{} if at_waypoint is None else {"at_waypoint": at_waypoint})

    def step(self) -> Json:
        """Go on with a sequence or program that is paused, to its next stop."""
        return self._tell("step")

    def resume(self, waypoint: int | None = None) -> Json:
        """Go on; a sequence that waits at a waypoint from any other one, if it is given."""
        return self._tell("resume", **{} if waypoint is None else {"waypoint": waypoint})

    def _tell(self, what: str, **query: int) -> Json:
        path = f"/jobs/{self.id}/{what}"
        return self._connection._json("POST", path, params=query, timeout=15.0)

    def __repr__(self) -> str:
        return f"JobHandle({self.id!r})"


class Jobs(Connection):
    """What a client can ask of jobs."""

    def jobs(self, n: int = 50, *states: str) -> list[Json]:
        """The newest jobs first, those that go on before those that have ended; only those in `states`."""
        return list(self._json("GET", "/jobs", params={"n": n, "state": list(states)})["jobs"])

    def job(self, job: str) -> JobHandle:
        """A job by its id."""
        return JobHandle(self, job)

    def speed_override(self) -> float:
        """How fast motions go, as a share of their planned speed."""
        return float(self._json("GET", "/robot/speed_override")["fraction"])

    def set_speed_override(self, fraction: float) -> float:
        """Go faster or slower: the motion that runs, and all that follow. 0 has the arm wait on its path."""
        body = {"fraction": fraction}
        return float(self._json("POST", "/robot/speed_override", json=body)["fraction"])

    def _motion(self, path: str, body: Json, wait: bool) -> Json | JobHandle:
        """The answer on arrival, or the handle of a job."""
        if wait:
            return self._arrived(path, body)
        job = self._json("POST", path, params={"wait": False}, json=body, timeout=self._motion_timeout_s)
        return JobHandle(self, str(job["id"]))
