"""The data of a robot for the fleet. The mode is read from shared memory, everything else from the cell's own
service.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import httpx2
import numpy as np

from cobot.addresses import address
from cobot.client.rest import Client
from cobot.client.tls import tls_context
from cobot.errors import CobotError
from cobot.fleet.messages import NOT_ENDED, FleetProgram
from cobot.ipc.layout import text
from cobot.ipc.shm import MemoryRole, RobotMemory
from cobot.types import LoopMode

ASK_S = 1.0
"""Interval between requests to the service, in seconds."""
TIMEOUT_S = 2.0
RETRY_S = 0.5
PROGRAM_FIELDS = tuple(FleetProgram.model_fields)
PROGRAMS_S = 5.0
"""Interval between requests for the list of stored programs, in seconds."""
EVENT_TYPES = (
    "service",
    "rtloop",
    "mode",
    "fault",
    "estop",
    "stop",
    "reset",
    "intervention",
    "lease",
    "sequence",
    "program",
    "planning",
    "speed",
)
"""Types of the events that a fleet shows. Events about single motions are not sent to the hub."""
COUNTERS = {
    "missed_cycles": "overruns",
    "interventions": "interventions",
    "stops": "stops_seen",
    "estops": "estops_seen",
}
"""For each counter, the field of the state block that contains it. The counts of all kinds of interventions
are added.
"""
WORDS = {
    LoopMode.HOLD: "ready",
    LoopMode.STOPPING: "stopping",
    LoopMode.ESTOP: "estop",
    LoopMode.FAULT: "fault",
}


class ArmWatch:
    """The mode of a robot, read from shared memory. This works regardless of the state of the service."""

    def __init__(self, robot: str, stale_s: float) -> None:
        self._robot = robot
        self._stale_s = stale_s
        self._memory: RobotMemory | None = None
        self._retry_s = 0.0

    def read(self) -> dict[str, Any]:
        """The data from shared memory: `state`, `mode`, `reason` and `counters`."""
        try:
            if self._memory is None:
                if time.monotonic() < self._retry_s:
                    return {"state": "silent", "reason": "rtloop is not running"}
                self._retry_s = time.monotonic() + RETRY_S
                self._memory = RobotMemory.attach(self._robot, MemoryRole.READER)
            if not self._memory.state.sequence:
                return {"state": "silent", "reason": "rtloop has not started yet"}
            state = self._memory.state.read()
            age_s = (time.monotonic_ns() - int(state["monotonic_ns"])) * 1e-9
            mode, reason = LoopMode(int(state["mode"])), text(state["reason"])
            counters = {name: int(np.sum(state[field])) for name, field in COUNTERS.items()}
        except CobotError as exc:
            self.close()
            return {"state": "silent", "reason": str(exc)}
        if age_s > self._stale_s:
            self.close()  # a restarted rtloop may use a different memory
            return {"state": "silent", "reason": "rtloop publishes nothing"}
        word = WORDS.get(mode, "moving")
        return {"state": word, "mode": mode.name, "reason": reason, "counters": counters}

    def close(self) -> None:
        if self._memory is not None:
            self._memory.close()
            self._memory = None


class ServiceWatch:
    """Asks the service about one robot, once a second, in a separate thread.

    Attributes:
        found: fields of `FleetState`: job, program, control, speed override, problems, backend.
        programs: the latest version of each stored program.
        paused: whether a job is paused and none is running.
    """

    def __init__(self, url: str, robot: str, token: str) -> None:
        self.found: dict[str, Any] = {"problems": ["the service has not answered yet"]}
        self.paused = False
        self._url = address(url, robot)
        self._token = token
        self.programs: list[dict[str, Any]] = []
        self._read_programs_s = 0.0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"service {robot}", daemon=True)
        self._thread.start()

    def end(self) -> None:
        self._ended.set()
        self._thread.join(2.0 * TIMEOUT_S)

    def _run(self) -> None:
        headers = {"Authorization": f"Bearer {self._token}"} if self._token else {}
        with httpx2.Client(
            headers=headers, timeout=TIMEOUT_S, verify=tls_context(True), trust_env=False
        ) as http:
            while not self._ended.is_set():
                try:
                    self._ask(http)
                except (httpx2.HTTPError, ValueError, KeyError, TypeError) as exc:
                    reason = str(exc) or type(exc).__name__
                    self.found = {"problems": [f"the service does not answer: {reason}"[:2000]]}
                    self.paused = False
                self._ended.wait(ASK_S)

    def _ask(self, http: httpx2.Client) -> None:
        health = self._get(http, "/health")
        jobs = [job for job in self._get(http, "/jobs?limit=20")["jobs"] if job["state"] in NOT_ENDED]
        control = self._get(http, "/control")
        programs = [job for job in jobs if job["kind"] == "sequence"]
        single = [job for job in jobs if job["kind"] != "sequence"]
        if time.monotonic() > self._read_programs_s:
            self._read_programs_s = time.monotonic() + PROGRAMS_S
            stored = self._get(http, "/programs")
            self.programs = [{name: each[name] for name in PROGRAM_FIELDS} for each in stored]
        states = {job["state"] for job in jobs}
        self.paused = "paused" in states and "running" not in states
        self.found = {
            "problems": [str(each)[:2000] for each in health["problems"]],
            "backend": health["rtloop"].get("backend", ""),
            "job": str(single[0]["request"])[:200] if single else "",
            "program": str(programs[0]["request"])[:200] if programs else "",
            "control": str(control["holder"] or "")[:200] if control["held"] else "",
            "speed_override": float(self._get(http, "/speed_override")["fraction"]),
        }

    def _get(self, http: httpx2.Client, path: str) -> Any:
        response = http.get(self._url + path)
        if response.status_code != 200:
            raise ValueError(f"{path}: status {response.status_code}: {response.text[:200]}")
        return response.json()


class EventWatch:
    """Receives the service's events, in a separate thread.

    Args:
        tell: function that is called with each event, in that thread.
    """

    def __init__(self, url: str, token: str, tell: Callable[[dict[str, Any]], None]) -> None:
        self._url, self._token, self._tell = url, token, tell
        # A daemon thread, because it waits for events, and nothing is lost if it ends with the process.
        threading.Thread(target=self._run, name="events", daemon=True).start()

    def _run(self) -> None:
        after: str | None = "0"
        while True:
            try:
                with Client(self._url, token=self._token or None) as client:
                    for event in client.events(EVENT_TYPES, after=after):
                        after = f"{event['epoch']}-{event['id']}"
                        self._tell(event)
            except CobotError:
                time.sleep(RETRY_S)
