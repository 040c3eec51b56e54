"""A job: one motion from its request to its end, in the form in which people and programs follow its
progress.
"""

from __future__ import annotations

import asyncio
import contextlib
import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum
from typing import TYPE_CHECKING, Any, ClassVar

from app.services.rights.signal_results import NO_RESULTS, ActionOutcome, ContactOutcome, SignalResults
from app.services.state.link import RobotLink
from cobot.clock import utc_now
from cobot.errors import CobotError, UnavailableError
from cobot.findings import Finding
from cobot.logs.lines import printable
from cobot.trajectory import Trajectory

if TYPE_CHECKING:
    from app.services.rights.speed_override import SpeedOverride


class JobKind(StrEnum):
    """Kind of a request for a motion."""

    MOVE = "move"
    EXECUTE = "execute"
    TRAJECTORY = "trajectory"
    SEQUENCE = "sequence"
    PROGRAM = "program"
    GOAL = "follow_joint_trajectory"
    QUEUE = "queue"
    SYNCHRONOUS = "synchronous"
    FORCE = "force"
    GRIPPER = "gripper"
    STUDY = "study"


class JobState(StrEnum):
    """State of a job. The last four are final."""

    QUEUED = "queued"
    PLANNING = "planning"
    RUNNING = "running"
    PAUSED = "paused"
    FINISHED = "finished"
    FAILED = "failed"
    CANCELLED = "cancelled"
    INTERRUPTED = "interrupted"


def new_job_id() -> str:
    """Create a new job id, which is unique even across restarts."""
    return f"job_{secrets.token_hex(8)}"


WITHOUT_ARM = frozenset({JobKind.GRIPPER, JobKind.STUDY})
"""Kinds of jobs that continue while the arm is paused."""
MAX_REQUEST = 500
ENDS = frozenset({JobState.FINISHED, JobState.FAILED, JobState.CANCELLED, JobState.INTERRUPTED})


@dataclass(frozen=True, slots=True)
class JobError:
    """The reason why a job has not succeeded, in the form of an error answer.

    Attributes:
        detail: the reason as a sentence.
        code, findings, details: code, findings and details of the error, see `CobotError`.
    """

    detail: str
    code: str
    findings: tuple[Finding, ...] = ()
    details: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, error: BaseException) -> JobError:
        if isinstance(error, CobotError):
            return cls(str(error), error.code, error.findings, dict(error.details))
        if isinstance(error, asyncio.CancelledError):
            return cls("the service cancelled it", "interrupted")
        return cls("an error in cobot itself; its log has the details", CobotError.code)


@dataclass(frozen=True, slots=True)
class JobRecord:
    """The state of a job at one time. The last record is kept.

    Attributes:
        request: the request, or the newest change of its goal, as a short text.
        path, body: path and body of the HTTP request; "" and None for a job without an HTTP request. A long
            body is omitted.
        owner: the client that requested it.
        parent: id of the sequence's job, if the job belongs to a sequence.
        motion_id: number of the job's newest motion, once there is one.
        progress: completed share of this motion's path time, 0 to 1. For a sequence, the completed share of
            its waypoints.
        planned_duration_s: duration of the motion at its planned speed.
        remaining_s: the remaining time at the current speed override; None while it is unknown.
        note: see `Trajectory`.
        started_at: time at which its first motion began.
        actions: results of the actions, for the newest motion that has actions.
        waits_for: the condition that the motion is waiting for, in words; "" if it is not waiting.
        stopped_by, contact: see `SignalResults`.
    """

    # Findings may be infinite, which JSON numbers cannot express.
    __pydantic_config__: ClassVar[dict[str, Any]] = {"ser_json_inf_nan": "constants"}

    id: str
    robot: str
    kind: JobKind
    state: JobState
    request: str
    owner: str
    created_at: datetime
    parent: str | None = None
    motion_id: int | None = None
    progress: float = 0.0
    planned_duration_s: float | None = None
    remaining_s: float | None = None
    note: str = ""
    error: JobError | None = None
    started_at: datetime | None = None
    ended_at: datetime | None = None
    actions: tuple[ActionOutcome, ...] = ()
    waits_for: str = ""
    stopped_by: str = ""
    contact: ContactOutcome | None = None
    path: str = ""
    body: dict[str, Any] | None = None


@dataclass(eq=False)
class Job:
    """A job that has not ended. Its current state is derived from the motion; see `record`.

    Attributes:
        on_change: function that is called after each change of the state.
        accepted: event that is set when all checks before planning have passed.
        ended: event that is set at the end. `end_record` is then the last record of the job.
        motion_id: number of the job's newest motion.
        error: the reason for a failure, once it is known.
    """

    link: RobotLink
    kind: JobKind
    request: str
    owner: str
    on_change: Callable[[Job], None]
    id: str
    created_at: datetime
    parent: str | None = None
    accepted: asyncio.Event = field(default_factory=asyncio.Event)
    ended: asyncio.Event = field(default_factory=asyncio.Event)
    end_record: JobRecord | None = None
    path: str = ""
    body: dict[str, Any] | None = None
    motion_id: int | None = None
    error: JobError | None = None
    _override: SpeedOverride | None = None
    _planned_s: float | None = None
    _note: str = ""
    _started_at: datetime | None = None
    _path_time_s: float = 0.0
    _part_s: float | None = None
    _waypoints: tuple[float, int] | None = None
    _held: bool = False
    _signals: Callable[[], SignalResults] | None = None

    @property
    def state(self) -> JobState:
        """The current state of the job."""
        if self.end_record is not None:
            return self.end_record.state
        if self._override is None:
            return JobState.QUEUED
        if self._held or (self._override.paused and self.kind not in WITHOUT_ARM):
            return JobState.PAUSED
        return JobState.PLANNING if self._started_at is None else JobState.RUNNING

    @property
    def signals(self) -> SignalResults | None:
        """The results of the job's actions and conditions; None for a job without actions and conditions."""
        return None if self._signals is None else self._signals()

    def begin(self, override: SpeedOverride) -> None:
        """Record that the job has its claim, with this speed override."""
        self._override = override
        self.on_change(self)

    def start(self, motion_id: int | None = None, trajectory: Trajectory | None = None) -> None:
        """Record that a motion of the job has begun or, without a motion, that a sequence has begun."""
        self.motion_id = motion_id
        if trajectory is not None:
            self.prolong(trajectory)
        self._started_at = self._started_at or utc_now(self.link.clock)
        self.on_change(self)

    def follow_signals(self, results: Callable[[], SignalResults]) -> None:
        """From now on, report the results of a motion's actions and conditions."""
        self._signals = results

    def prolong(self, trajectory: Trajectory) -> None:
        """Record that the motion continues along this trajectory."""
        self._planned_s, self._note, self._path_time_s = trajectory.duration_s, trajectory.note, 0.0

    def change_goal(self, path: str, text: str, body: dict[str, Any] | None) -> None:
        """Record the HTTP request that has changed the goal. It replaces the former request."""
        self.request = printable(f"{path} {text}", MAX_REQUEST)
        self.path, self.body = path, body
        self.on_change(self)

    def enqueue(self, duration_s: float, note: str) -> None:
        """Record that the motion is planned and waits in the queue. `duration_s` is its duration at full
        speed.
        """
        self._planned_s, self._note = duration_s, note
        self.accepted.set()
        self.on_change(self)

    def its_turn(self, override: SpeedOverride, motion_id: int | None, left_s: float) -> None:
        """Record that a motion shared by several jobs has reached this job, and record the remaining time of
        this job's part.
        """
        self._part_s, self._path_time_s = left_s, 0.0
        self._override = override
        self.start(motion_id)

    def set_left_s(self, left_s: float) -> None:
        """Set the remaining time of the job's part of a motion, s."""
        if self._part_s is not None:
            self._path_time_s = max(self._part_s - left_s, self._path_time_s)

    def at_waypoint(self, done: float, of: int) -> None:
        """Record the progress of a sequence.

        Args:
            done: number of waypoints that have been passed, including the fraction of the current one.
            of: total number of waypoints.
        """
        self._waypoints = done, of

    def hold(self, held: bool) -> None:
        """Record whether a sequence is waiting at a waypoint."""
        self._held = held
        self.on_change(self)

    def fail(self, error: BaseException) -> None:
        """Record why the job has failed. Only the cause from the first call is kept."""
        self.error = self.error or JobError.of(error)

    def end(self, state: JobState) -> None:
        """End the job in this state; see `Ownership.end`."""
        self.end_record = self._recorded(state)
        self.ended.set()
        self.on_change(self)

    def record(self) -> JobRecord:
        """Create a record of the job's current state."""
        return self.end_record or self._recorded(self.state)

    def _recorded(self, state: JobState) -> JobRecord:
        ended, finished = state in ENDS, state is JobState.FINISHED
        progress, remaining_s = self._progress()
        signals = NO_RESULTS if self._signals is None else self._signals()
        return JobRecord(
            id=self.id,
            robot=self.link.memory.robot,
            kind=self.kind,
            state=state,
            request=self.request,
            owner=self.owner,
            created_at=self.created_at,
            parent=self.parent,
            motion_id=self.motion_id,
            progress=1.0 if finished else progress,
            planned_duration_s=self._planned_s,
            remaining_s=(0.0 if finished else None) if ended else remaining_s,
            note=self._note,
            error=self.error if ended else None,
            started_at=self._started_at,
            ended_at=utc_now(self.link.clock) if ended else None,
            actions=signals.actions,
            waits_for="" if ended else signals.waits_for,
            stopped_by=signals.stopped_by,
            contact=signals.contact,
            path=self.path,
            body=self.body,
        )

    def _progress(self) -> tuple[float, float | None]:
        """Return the completed share of the path time, and the remaining duration, s."""
        if self._waypoints is not None:
            done, of = self._waypoints
            return (min(done / of, 1.0) if of else 0.0), None
        whole_s = self._planned_s if self._part_s is None else self._part_s
        if whole_s is None or self._override is None:
            return 0.0, None
        with contextlib.suppress(UnavailableError):
            state = self.link.state()
            if state.motion_id == self.motion_id and self._part_s is None:
                self._path_time_s = state.path_time_s
        fraction = self._override.fraction * self.link.time_factor
        left_s = max(whole_s - self._path_time_s, 0.0)
        share = min(self._path_time_s / whole_s, 1.0) if whole_s > 0.0 else 1.0
        return share, left_s / fraction if fraction > 0.0 else None
