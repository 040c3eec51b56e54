"""Motions that the service executes while the program continues."""

from __future__ import annotations

import math
from typing import Any

from cobot.client.connection import ERRORS, Connection, Json
from cobot.clock import SYSTEM
from cobot.errors import ExecutionError, MotionTimeout

ENDS = ("finished", "failed", "cancelled", "interrupted")
POLL_S = 5.0
"""Maximum time for which one request waits for a job to end, s. After this time the service always answers.
"""


class JobHandle:
    """A job. Methods such as `Client.move_joints(..., wait=False)` return it.

    Attributes:
        id: number of the job.

    Every method raises the errors that the methods of `Client` raise, and `NotFoundError` after the service
    has removed the job.
    """

    def __init__(self, connection: Connection, job: str) -> None:
        self._connection = connection
        self.id = job

    @property
    def state(self) -> str:
        """The state: queued, planning, running or paused; finished, failed, cancelled or interrupted."""
        return str(self.read()["state"])

    def read(self, wait_s: float = 0.0) -> Json:
        """Read the job. The answer arrives at the end of the job, or after at most `wait_s` (up to 60)."""
        return self._connection._json(
            "GET", f"/jobs/{self.id}", params={"wait_s": wait_s}, timeout=wait_s + 10.0
        )

    def wait(self, timeout_s: float = math.inf) -> Json:
        """Wait until the arm has reached the goal and settled, and return the job.

        Raises:
            MotionTimeout: the job is still running after `timeout_s`.
            CobotError: the job has failed; the `code` of the job determines the class.
        """
        until_s = SYSTEM.now_s() + timeout_s
        while (job := self.read(max(min(POLL_S, until_s - SYSTEM.now_s()), 0.0)))["state"] not in ENDS:
            if SYSTEM.now_s() >= until_s:
                raise MotionTimeout(f"job {self.id} is {job['state']} after {timeout_s:g} s")
        if job["error"] is not None:
            error = ERRORS.get(str(job["error"]["code"]), ExecutionError)(job["error"]["detail"])
            error.explain = job["error"].get("explain")
            error.details = job["error"].get("details") or {}
            raise error
        return job

    def cancel(self) -> Json:
        """End the job: the arm stops on its path."""
        return self._tell("cancel")

    def pause(self, at_waypoint: int | None = None) -> Json:
        """Pause the job: the arm stops on its path.

        Args:
            at_waypoint: number of the waypoint at which a sequence pauses instead; 0 for the next one.
        """
        return self._tell("pause", **{} if at_waypoint is None else {"at_waypoint": at_waypoint})

    def step(self) -> Json:
        """Let a paused sequence or program run to its next stop."""
        return self._tell("step")

    def resume(self, waypoint: int | None = None) -> Json:
        """Resume the job. A sequence that is paused at a waypoint can resume from a different waypoint."""
        return self._tell("resume", **{} if waypoint is None else {"waypoint": waypoint})

    def retarget(self, **goal: Any) -> Json:
        """Change the goal of the running motion, without a stop. The job continues.

        Args:
            goal: the fields of a motion as in POST /robot/move/named, joints or pose, for example
                `joints=[...], speed=0.3`.

        Returns:
            The answer to POST /jobs/{job}/retarget, which contains the point at which the arm leaves its
            previous path.

        Raises:
            CobotError: the goal cannot be changed; the motion continues as before.
        """
        return self._connection._json("POST", f"/jobs/{self.id}/retarget", json=goal, timeout=30.0)

    def _tell(self, what: str, **query: int) -> Json:
        path = f"/jobs/{self.id}/{what}"
        return self._connection._json("POST", path, params=query, timeout=15.0)

    def __repr__(self) -> str:
        return f"JobHandle({self.id!r})"


class Jobs(Connection):
    """Requests about jobs."""

    def jobs(self, limit: int = 50, *states: str, after: str | None = None) -> list[Json]:
        """The jobs, newest first. Active jobs are listed before jobs that have ended.

        Args:
            limit: maximum number of jobs.
            states: if given, only jobs in one of these states are returned.
            after: id of a job in an earlier answer; the list continues after this job.
        """
        return list(self._page("/jobs", limit, after, state=list(states))["jobs"])

    def job(self, job: str) -> JobHandle:
        """The job with this id."""
        return JobHandle(self, job)

    def speed_override(self) -> float:
        """Speed override: the fraction of the planned speed at which motions run."""
        return float(self._json("GET", "/robot/speed_override")["fraction"])

    def set_speed_override(self, fraction: float) -> float:
        """Set the speed override of the running motion and all later ones. At 0 the arm waits on its path."""
        body = {"fraction": fraction}
        return float(self._json("POST", "/robot/speed_override", json=body)["fraction"])

    def _motion(self, path: str, body: Json, wait: bool) -> Json | JobHandle:
        """Send a motion. Returns the answer when the goal is reached. If `wait` is false, returns the handle
        of the job immediately.
        """
        if wait:
            return self._post_motion(path, body)
        job = self._json("POST", path, params={"wait": False}, json=body, timeout=self._motion_timeout_s)
        return JobHandle(self, str(job["id"]))
