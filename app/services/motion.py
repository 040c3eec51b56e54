"""Who owns the motion, and how a motion goes from request to arrival."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Coroutine, Iterator
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from app.services.link import POLL_S, RobotLink, RobotState
from app.services.planning import PlanningService, PlanRequest
from cobot.config import PlanningSection
from cobot.errors import (
    CobotError,
    ConflictError,
    ExecutionError,
    InputError,
    MotionStopped,
    MotionTimeout,
    PlanningError,
    PlanningTimeout,
    UnavailableError,
)
from cobot.frames import pose_from_abc
from cobot.layout import MotionResult
from cobot.limits import check_positions
from cobot.planners import MotionRequest
from cobot.robot import Robot
from cobot.trajectory import Trajectory
from cobot.types import Array, Mode, PlannerName, Pose, Scaling

Result = TypeVar("Result")
REST_TIMEOUT_S = 5.0
"""How long a motion that was told to stop is waited for."""
STATE_TIMEOUT_S = 1.5
"""How long a motion waits for a sign of rtloop before it gives up: less than the two seconds in which
a client shall know."""
LATEST_ANSWER_S = 10.0
"""A motion that is out of time is answered within this: a sign of rtloop, rest, and the way to the client."""
WHERE = {
    MotionResult.STOPPED: "on its path",
    MotionResult.STOPPED_ASIDE: "beside its path, which left no room to slow down within the limits,",
}


@dataclass(frozen=True, slots=True)
class Caller:
    """Who asks for a motion.

    Attributes:
        name: what others are told about the owner.
        token: of the sequence on whose behalf the arm shall move, if any.
        stops: `MotionService.stops` when the request came in: a later stop is for its motion too.
        timeout_s: after which the motion is to end.
        gone: set when the client goes away: the arm then stops.
    """

    name: str
    token: str | None
    stops: int
    timeout_s: float
    gone: asyncio.Event


@dataclass
class Claim:
    """The right to move, of one motion.

    Attributes:
        name: see `Caller`.
        stops: the link's count of stops when the claim was made.
        motion_id: once it runs.
        interruption: why it has to end early, once it has to; then `interrupted` is set.
        ended: set when it has.
    """

    name: str
    stops: int
    since_s: float = field(default_factory=time.monotonic)
    motion_id: int | None = None
    interruption: ExecutionError | None = None
    interrupted: asyncio.Event = field(default_factory=asyncio.Event)
    ended: asyncio.Event = field(default_factory=asyncio.Event)

    def interrupt(self, cause: ExecutionError) -> None:
        """End this motion; the first cause counts."""
        if self.interruption is None:
            self.interruption = cause
            self.interrupted.set()

    def proceed(self) -> None:
        """Raise what has interrupted it, if something has."""
        if self.interruption is not None:
            raise self.interruption

    async def unless_interrupted(self, work: Coroutine[Any, Any, Result]) -> Result:
        """The work's result; an interruption cancels it and is raised."""
        task = asyncio.create_task(work)
        interrupted = asyncio.create_task(self.interrupted.wait())
        try:
            await asyncio.wait({task, interrupted}, return_when=asyncio.FIRST_COMPLETED)
            self.proceed()
            return await task
        finally:
            task.cancel()
            interrupted.cancel()

    def __str__(self) -> str:
        number = f", motion {self.motion_id}" if self.motion_id is not None else ""
        return f"{self.name} (for {time.monotonic() - self.since_s:.1f} s{number})"


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a motion request ended. `error` is None when the arm has arrived and settled."""

    error: CobotError | None
    motion_id: int | None
    duration_s: float
    planning_time_s: float


@dataclass(frozen=True, slots=True)
class Goal:
    """Where to go, and how: see `MotionRequest`."""

    target: Array | Pose
    scaling: Scaling
    planner: PlannerName = PlannerName.PTP
    via: Array | None = None


class MotionService:
    """One motion at a time.

    A running sequence owns the motion from its start to its end; requests that carry its token
    move on its behalf.

    Attributes:
        stops: how often POST /stop was called.
    """

    def __init__(
        self, robot: Robot, link: RobotLink, planning: PlanningService, settings: PlanningSection
    ) -> None:
        self._robot = robot
        self._link = link
        self._planning = planning
        self._settings = settings
        self.stops = 0
        self._claim: Claim | None = None
        self._sequence: tuple[str, str] | None = None  # name, token

    @property
    def owner(self) -> str | None:
        """Who moves the arm, for people."""
        if self._claim is not None:
            return str(self._claim)
        return self._sequence[0] if self._sequence else None

    def claim_for_sequence(self, name: str, token: str) -> None:
        """Reserve the motion for requests with a token.

        Raises:
            ConflictError: somebody else owns it.
        """
        if self.owner is not None:
            raise ConflictError(f"the robot is in use by {self.owner}")
        self._sequence = name, token

    def release_sequence(self) -> None:
        self._sequence = None

    def require_free(self, token: str | None) -> None:
        """See that a request with this token may move the arm.

        Raises:
            ConflictError: somebody else owns it.
        """
        if self._claim is not None or (self._sequence is not None and self._sequence[1] != token):
            raise ConflictError(f"the robot is in use by {self.owner}; wait for it, or POST /stop")
        if token is not None and self._sequence is None:
            raise ConflictError("the sequence that this request belongs to has ended")

    @contextlib.contextmanager
    def claim(self, caller: Caller) -> Iterator[Claim]:
        """Own the motion for as long as the context lasts; one that a stop has overtaken is interrupted.

        Raises:
            ConflictError: somebody else owns it.
        """
        self.require_free(caller.token)
        claim = Claim(caller.name, self._link.stops)
        if self.stops != caller.stops:
            claim.interrupt(MotionStopped("a stop was requested while the request was being read"))
        self._claim = claim
        try:
            yield claim
        finally:
            self._claim = None
            claim.ended.set()

    def stop(self) -> Claim | None:
        """Interrupt the motion that is read, planned or runs; its claim, which will end, or None."""
        self.stops += 1
        if self._claim is not None:
            self._claim.interrupt(MotionStopped("stopped by POST /stop"))
        return self._claim

    def named(self, name: str, scaling: Scaling) -> Goal:
        """The goal of a named position.

        Raises:
            InputError: there is no such position; lists the valid ones.
        """
        position = self._robot.positions.get(name)
        if position is None:
            valid = ", ".join(self._robot.positions)
            raise InputError(f"there is no named position {name!r}; valid are: {valid}")
        return self.joints(list(position.joints), scaling)

    def joints(self, angles: list[float], scaling: Scaling) -> Goal:
        """The goal of joint angles, rad.

        Raises:
            InputError: another number of joints than the robot has.
            LimitError: beyond joint_limits.yaml.
        """
        limits = self._robot.limits
        if len(angles) != limits.dof:
            raise InputError(f"joints must have {limits.dof} angles, got {len(angles)}")
        target = np.array(angles, dtype=np.float64)
        check_positions(limits, target)
        return Goal(target, scaling)

    def pose(
        self,
        position: list[float],
        abc: list[float],
        frame: str,
        planner: str,
        scaling: Scaling,
        via: list[float] | None,
    ) -> Goal:
        """The goal of a TCP pose: m, KUKA angles in rad.

        Raises:
            InputError: an unknown frame, or a `via` that does not fit the planner.
        """
        base = self._robot.base_frame
        if (frame or self._settings.default_frame) != base:
            raise InputError(f"frame_id: there is no frame {frame!r}; valid are: {base}, or empty for it")
        if via is None and planner == PlannerName.CIRC:
            raise InputError("via: is missing; planner circ needs a point on its arc")
        if via is not None and planner != PlannerName.CIRC:
            raise InputError(f"via: is for planner circ only, not for {planner}")
        point = None if via is None else np.array(via)
        return Goal(pose_from_abc(*position, *abc), scaling, PlannerName(planner), point)

    async def move(self, goal: Goal, caller: Caller) -> Outcome:
        """Plan, go, and return when the arm has arrived and settled, or why it has not.

        Raises:
            ConflictError, UnavailableError, InputError: nothing has moved.
        """
        begun_s = time.monotonic()
        planned_s = begun_s
        with self.claim(caller) as claim, watching(claim, caller):
            error: CobotError | None = None
            try:
                state = await self.ready()
                request = MotionRequest(
                    state.commanded_position,
                    goal.target,
                    goal.planner,
                    goal.scaling,
                    goal.via,
                    timeout_s=self._settings.timeout_s,
                )
                trajectory = await self.plan(claim, request, caller.timeout_s)
                planned_s = time.monotonic()
                if trajectory is not None:
                    await self.start(claim, trajectory)
                    await self.arrival(claim)
            except (PlanningError, ExecutionError) as exc:
                error = exc
            now_s = time.monotonic()
            planning_s = (planned_s if planned_s > begun_s else now_s) - begun_s
            return Outcome(error, claim.motion_id, now_s - begun_s, planning_s)

    async def ready(self) -> RobotState:
        """A state from which a motion may start.

        Raises:
            UnavailableError: see `RobotLink.ready_state`.
            ConflictError: the arm still moves for somebody who is gone.
        """
        state = await self._link.ready_state(STATE_TIMEOUT_S)
        if state.mode is not Mode.HOLD:
            raise ConflictError(f"the arm still moves: motion {state.motion_id} is in mode {state.mode.name}")
        return state

    async def plan(self, claim: Claim, request: PlanRequest, timeout_s: float) -> Trajectory | None:
        """Plan on behalf of a claim; an interruption kills the planner."""
        try:
            return await claim.unless_interrupted(self._planning.plan(request, timeout_s))
        except MotionTimeout as exc:
            raise PlanningTimeout(f"not planned within {timeout_s:g} s") from exc

    async def start(self, claim: Claim, trajectory: Trajectory) -> None:
        """Hand the motion to rtloop.

        Raises:
            ExecutionError, UnavailableError, InputError: see `RobotLink.start`.
        """
        claim.proceed()
        claim.motion_id = await self._link.start(trajectory, claim.stops)

    async def arrival(self, claim: Claim) -> None:
        """Wait until the motion has ended.

        Raises:
            ExecutionError: it did not arrive; its class and text say why.
            UnavailableError: rtloop is gone.
        """
        give_up_s = float("inf")
        begun_s = time.monotonic()
        while True:
            try:
                state = await self._link.fresh_state(STATE_TIMEOUT_S)
            except UnavailableError:
                self._link.request_stop()  # if rtloop goes on after all, then not with a motion of nobody's
                raise
            if state.motion_id != claim.motion_id:
                # Of the cycle before the acknowledgement; or rtloop has died before it could publish one.
                if state.published_s > begun_s:
                    raise ExecutionError("rtloop was restarted; the motion has not begun")
            elif state.motion_result is not MotionResult.RUNNING:
                break
            if claim.interruption is not None and give_up_s == float("inf"):
                self._link.request_stop()
                give_up_s = time.monotonic() + REST_TIMEOUT_S
            if time.monotonic() > give_up_s:
                raise ExecutionError(
                    f"{claim.interruption}; the arm has not come to rest within {REST_TIMEOUT_S:.0f} s"
                )
            await asyncio.sleep(POLL_S)
        if state.motion_result in WHERE:
            share = 100.0 * state.path_time_s / state.path_duration_s
            cause = claim.interruption or MotionStopped(state.reason)
            where = WHERE[state.motion_result]
            raise type(cause)(f"{cause}: the arm came to rest {where} after {share:.0f} % of it")
        if state.motion_result is not MotionResult.ARRIVED:
            raise ExecutionError(state.reason)


@contextlib.contextmanager
def watching(claim: Claim, caller: Caller) -> Iterator[None]:
    """Interrupt the motion when its client goes away or its time is up."""

    async def watch() -> None:
        try:
            await asyncio.wait_for(caller.gone.wait(), caller.timeout_s)
            claim.interrupt(MotionStopped("the client went away"))
        except TimeoutError:
            claim.interrupt(MotionTimeout(f"not arrived within {caller.timeout_s:g} s"))

    watcher = asyncio.create_task(watch())
    try:
        yield
    finally:
        watcher.cancel()
