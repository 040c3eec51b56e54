"""Reports the health of the whole product: processes, cycle times and versions."""

from __future__ import annotations

import os
import platform
from dataclasses import asdict, dataclass
from importlib.metadata import version

import numpy as np

from app.services.motion.planning import PlanningService
from app.services.programs.sequences import SequenceService
from app.services.reports.recordings import RecordingService
from app.services.rights.ownership import Ownership
from app.services.state.link import RobotLink
from app.services.state.robot_state import RobotState
from app.services.streaming.sessions import StreamService
from cobot.errors import UnavailableError
from cobot.ipc.layout import Intervention, Phase, text
from cobot.ipc.state_fields import LAYOUT_VERSION
from cobot.types import LoopMode

VERSIONS = {
    **{name: version(name) for name in ("cobot", "mujoco-core", "ruckig", "numpy", "fastapi")},
    "python": platform.python_version(),
    "layout": str(LAYOUT_VERSION),
}
KINDS = [kind.name.lower() for kind in Intervention]
SHARES = {"p50_us": 0.5, "p99_us": 0.99, "p999_us": 0.999}


@dataclass(frozen=True, slots=True)
class Health:
    """A health report. `status` is "ok", or "degraded" if there are `problems`. The other fields are plain
    JSON values.
    """

    status: str
    problems: list[str]
    robot: dict[str, object]
    rtloop: dict[str, object]
    service: dict[str, object]
    planning: dict[str, object]
    sequence: dict[str, object]
    session: dict[str, object] | None
    recorder: dict[str, object] | None
    cycle_us: dict[str, dict[str, float]]
    interventions: dict[str, int]
    last_interventions_s: dict[str, float | None]
    versions: dict[str, str]


class HealthService:
    """Creates the health report, even if other parts of the service fail."""

    def __init__(
        self,
        robot: str,
        link: RobotLink,
        ownership: Ownership,
        sequences: SequenceService,
        streams: StreamService,
        planning: PlanningService,
        recordings: RecordingService,
        stale_s: float,
    ) -> None:
        self._robot = robot
        self._link = link
        self._ownership = ownership
        self._sequences = sequences
        self._streams = streams
        self._planning = planning
        self._recordings = recordings
        self._stale_s = stale_s
        self._started_s = link.clock.now_s()

    def health(self) -> Health:
        """Return the current health report."""
        problems: list[str] = []
        robot: dict[str, object] = {"name": self._robot, "mode": None, "reason": "", "settled": None}
        rtloop: dict[str, object] = {"alive": False, "pid": None}
        session: dict[str, object] | None = None
        interventions: dict[str, int] = {}
        last_interventions_s: dict[str, float | None] = {}
        cycle_us: dict[str, dict[str, float]] = {}
        try:
            state = self._link.state()
            statistics = self._link.statistics()
        except UnavailableError as exc:
            problems.append(str(exc))
        else:
            silence = self._link.silence(state)
            robot |= {"mode": state.mode.name, "reason": state.reason, "settled": state.settled}
            robot |= {"motion_id": state.motion_id, "motion_result": state.motion_result.name}
            rtloop = {
                "alive": not silence,
                "state_age_s": state.age_s,
                "overruns": state.overruns,
                "torn_reads": state.torn_reads,
                **_process(statistics),
            }
            device = self._link.device()
            robot |= {"device": None if device is None else device[1].words}
            interventions = dict(zip(KINDS, state.interventions, strict=True))
            last_interventions_s = _seconds_since(state.intervened_ns, self._link.clock.now_ns())
            session = self._session(state)
            cycle_us = _cycle_times(statistics)
            if silence:
                problems.append(silence)
            if state.mode in (LoopMode.ESTOP, LoopMode.FAULT):
                problems.append(f"mode {state.mode.name}: {state.reason}")
        planning = self._planning.status
        if planning.problem:
            problems.append(planning.problem)
        recorder = self._recordings.status()
        if recorder is not None and recorder.problem:
            problems.append(recorder.problem)
        return Health(
            status="degraded" if problems else "ok",
            problems=problems,
            robot=robot,
            rtloop=rtloop,
            service={
                "pid": os.getpid(),
                "uptime_s": self._link.clock.now_s() - self._started_s,
                "motion": self._ownership.owner,
            },
            planning=asdict(planning),
            sequence={"status": self._sequences.status.status, "pid": self._sequences.status.pid},
            session=session,
            recorder=None if recorder is None else asdict(recorder),
            cycle_us=cycle_us,
            interventions=interventions,
            last_interventions_s=last_interventions_s,
            versions=VERSIONS,
        )

    def obstacles(self) -> list[str]:
        """Return the reasons why the robot would not execute a motion now, as sentences; empty if the robot
        is ready.
        """
        starting = [] if self._planning.warm else ["the planning processes are starting"]
        try:
            state = self._link.state()
            silence = self._link.silence(state)
        except UnavailableError as exc:
            return [str(exc), *starting]
        if silence:
            return [silence, *starting]
        if state.mode in (LoopMode.ESTOP, LoopMode.FAULT):
            return [
                f"mode {state.mode.name}: {state.reason}; remove the cause, then reset the robot",
                *starting,
            ]
        if state.measured_age_s > self._stale_s:
            return [
                f"the arm has not been measured for {state.measured_age_s:.1f} s: {state.reason}",
                *starting,
            ]
        return starting

    def _session(self, state: RobotState) -> dict[str, object] | None:
        """Describe the streaming session that this service or another process has opened."""
        if state.session == 0:
            return None
        ours = self._streams.session
        client = self._link.streamer() if ours is None else ours.name
        refused = 0 if ours is None else ours.refused
        return {"number": state.session, "client": client, "mode": state.mode.name, "refused": refused}


def _seconds_since(moments_ns: list[int], now_ns: int) -> dict[str, float | None]:
    """Return the time since the last intervention of each kind, s; None before the first one."""
    seconds = ((now_ns - moment) * 1e-9 if moment else None for moment in moments_ns)
    return dict(zip(KINDS, seconds, strict=True))


def _process(statistics: np.ndarray) -> dict[str, object]:
    return {
        "pid": int(statistics["pid"]),
        "backend": text(statistics["backend"]),
        "clock": text(statistics["clock"]),
        "sched_fifo": bool(statistics["sched_fifo"]),
        "memory_locked": bool(statistics["memory_locked"]),
        "refused": text(statistics["permissions"]),
        "cycles": int(statistics["cycles"]),
    }


def _cycle_times(statistics: np.ndarray) -> dict[str, dict[str, float]]:
    """Calculate the percentiles of each phase from its histogram, µs. The last bucket also contains all
    longer times.
    """
    times = {}
    for phase in Phase:
        counts = np.cumsum(statistics["histogram"][phase])
        percentiles = {
            name: float(np.searchsorted(counts, share * counts[-1])) for name, share in SHARES.items()
        }
        times[phase.name.lower()] = {**percentiles, "max_us": float(statistics["max_us"][phase])}
    return times
