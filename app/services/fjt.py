"""The action /{robot}/follow_joint_trajectory (control_msgs/action/FollowJointTrajectory).

A goal becomes one planned motion, checked as a whole before it starts and then rtloop's alone; or, with an
`fjt_mode` from 1 to 7, a servo session that is fed from the same polynomials. Goals that cannot be worked on
are accepted and aborted with a code and a sentence, because a refusal has no room for either; what is refused
is what has nothing to do with the goal: the action is switched off, somebody else moves the arm, an e-stop.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging
import math
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass, replace

import numpy as np

from app.hub.actions import GoalHandle, GoalStatus, Rejected
from app.services.fjt_goal import (
    ErrorCode,
    FjtGoal,
    GoalError,
    GoalViolated,
    Message,
    PathViolated,
    read_goal,
)
from app.services.fjt_progress import Progress, on_path
from app.services.link import RobotLink, RobotState
from app.services.motion import MotionService
from app.services.ownership import Caller, Claim, Ownership
from app.services.servo import ServoService
from cobot.config import RosSection
from cobot.errors import CobotError, ExecutionError, InputError, LimitError, MotionStopped, PlanningError
from cobot.layout import MotionResult, ServoMode
from cobot.limits import check_positions
from cobot.planners import WaypointRequest
from cobot.robot import Robot
from cobot.trajectory import Trajectory

WATCH_S = 0.01
FEEDBACK_EVERY = 5
"""Feedback at 20 Hz, the default of joint_trajectory_controller; tolerances at 100 Hz."""
READY_S = 1.0
PLAN_S = 30.0
SEND_PERIOD_S = 0.01
WATCHDOG_S = 0.5
CYCLE_S = 0.001
"""Of the points of servo mode 4, which are sent together once in a period."""
ARRIVAL_S = 5.0
"""How long a servo session is waited for that has got its last point, unless the goal says otherwise."""
FINISHED = (0.005, 0.02)
"""rad and rad/s: how near a servo session has to come to the end, where goal_tolerance says nothing."""

log = logging.getLogger("cobot.fjt")


@dataclass(frozen=True, slots=True)
class FjtSettings:
    """How goals are executed: the settings' file, and what `fjt_control` has changed since.

    Attributes:
        mode: NONE for a planned motion.
        time_s: of each servo point, 0 for the period.
        period_s: between servo points.
    """

    enabled: bool
    mode: ServoMode
    time_s: float
    period_s: float


class _Run:
    """A goal from its acceptance to its end.

    Attributes:
        cause: why it has to end early, if it has to.
        ended: set when the arm rests, or moves for somebody else.
    """

    def __init__(self) -> None:
        self.cause: ExecutionError | None = None
        self.ended = asyncio.Event()
        self._interrupted = asyncio.Event()
        self._claim: Claim | None = None

    def interrupt(self, cause: ExecutionError) -> None:
        """End it; the first cause counts."""
        if self.cause is None:
            self.cause = cause
            self._interrupted.set()
            if self._claim is not None:
                self._claim.interrupt(cause)

    def own(self, claim: Claim) -> None:
        """From now on an interruption is the claim's too."""
        self._claim = claim
        if self.cause is not None:
            claim.interrupt(self.cause)

    def proceed(self) -> None:
        """Raise why it has to end, if it has to."""
        if self.cause is not None:
            raise self.cause

    async def sleep(self, seconds: float) -> None:
        """Shorter, and with its cause raised, when it has to end."""
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._interrupted.wait(), max(seconds, 0.0))
        self.proceed()


class FollowJointTrajectory:
    """See `app.hub.actions.Action`."""

    type_ = "control_msgs/action/FollowJointTrajectory"
    definition = ""

    def __init__(
        self,
        robot: Robot,
        link: RobotLink,
        ownership: Ownership,
        motion: MotionService,
        servo: ServoService,
        settings: RosSection,
        start_tolerance_rad: float,
    ) -> None:
        self.name = f"/{robot.name}/follow_joint_trajectory"
        self._limits = robot.limits
        self._link = link
        self._ownership = ownership
        self._motion = motion
        self._servo = servo
        self._configured = settings
        self._start_tolerance_rad = start_tolerance_rad
        self._newest: _Run | None = None

    @property
    def settings(self) -> FjtSettings:
        """As they are now."""
        file, said = self._configured, self._servo.rules.fjt
        return FjtSettings(
            file.enable_fjt_action if said.enable is None else said.enable,
            ServoMode(file.fjt_mode) if said.mode is None else said.mode,
            file.fjt_time if said.time_s is None else said.time_s,
            (file.fjt_send_period if said.send_period_s is None else said.send_period_s) or SEND_PERIOD_S,
        )

    async def execute(self, goal: Message, handle: GoalHandle) -> Message:
        settings, stops = self.settings, self._ownership.stops
        if not settings.enabled:
            raise Rejected(f"{self.name} is switched off; see ros.enable_fjt_action, or fjt_control")
        if self._newest is None:
            self._ownership.require_free(None)
        await self._link.ready_state(READY_S)
        try:
            wanted = await asyncio.to_thread(read_goal, goal, self._limits, time.time())
        except GoalError as exc:  # whatever runs goes on
            handle.accept()
            return self._failed(handle, exc)
        handle.accept()
        async with self._turn(handle) as run:
            try:
                await self._work(run, wanted, settings, stops, handle)
            except CobotError as exc:
                return self._failed(handle, exc)
        handle.status = GoalStatus.SUCCEEDED
        return {"error_code": int(ErrorCode.SUCCESSFUL), "error_string": ""}

    @contextlib.asynccontextmanager
    async def _turn(self, handle: GoalHandle) -> AsyncIterator[_Run]:
        """Be the newest goal: the one before ends first, and a cancel or a newer one ends this one."""
        run, before = _Run(), self._newest
        self._newest = run

        async def cancelled() -> None:
            await handle.cancel_requested.wait()
            run.interrupt(MotionStopped("the goal was cancelled"))

        watcher = asyncio.create_task(cancelled())
        try:
            if before is not None:
                before.interrupt(MotionStopped("preempted by a newer goal"))
                await before.ended.wait()
            yield run
        finally:
            watcher.cancel()
            run.ended.set()
            if self._newest is run:
                self._newest = None

    async def _work(
        self, run: _Run, goal: FjtGoal, settings: FjtSettings, stops: int, handle: GoalHandle
    ) -> None:
        caller = Caller(self.name, None, stops, math.inf, asyncio.Event())
        with self._ownership.claim(caller) as claim:
            run.own(claim)
            state = await self._motion.ready()
            trajectory = await self._planned(claim, goal, state, streamed=settings.mode != ServoMode.NONE)
            if goal.start_s is not None:
                await run.sleep(goal.start_s - time.time())
            run.proceed()
            if settings.mode is ServoMode.NONE:
                await self._follow(claim, goal, trajectory, handle)
                return
        await self._stream(run, goal, trajectory, settings, handle)

    async def _planned(self, claim: Claim, goal: FjtGoal, state: RobotState, *, streamed: bool) -> Trajectory:
        """The motion through all points, slowed down where the limits need it and the goal permits it."""
        start = state.commanded_position
        request = WaypointRequest(start, goal.points, self._start_tolerance_rad, check_limits=not streamed)
        try:
            trajectory = await self._motion.plan(claim, request, PLAN_S)
        except LimitError as exc:
            slower = await self._motion.plan(claim, replace(request, retime=True), PLAN_S)
            assert slower is not None  # plan_waypoints always has one
            wanted_s = goal.points[-1].time_from_start_s
            if slower.duration_s > wanted_s + goal.late_s:
                raise
            log.warning(
                "%s: slowed down from %.3f s to %.3f s, because %s",
                self.name,
                wanted_s,
                slower.duration_s,
                exc,
            )
            return slower
        assert trajectory is not None
        for extreme in trajectory.extrema():  # what a session's points have to keep, before the first is sent
            check_positions(self._limits.including(start), extreme, "the trajectory's angle")
        return trajectory

    async def _follow(self, claim: Claim, goal: FjtGoal, trajectory: Trajectory, handle: GoalHandle) -> None:
        """Have it executed as one motion."""
        await self._motion.start(claim, trajectory)
        log.info("%s: motion %s, %d points", self.name, claim.motion_id, len(goal.points))
        watcher = asyncio.create_task(self._watch(claim, goal, trajectory, handle))
        try:
            await self._motion.arrival(claim)
        except ExecutionError as exc:
            cause = claim.interruption
            if cause is None and self._link.state().motion_result is MotionResult.FAILED:
                raise GoalViolated(str(exc)) from exc
            if cause is not None and not isinstance(exc, type(cause)):  # what came of it, as "not settled"
                raise type(cause)(f"{cause}; {exc}") from exc
            raise
        finally:
            watcher.cancel()
        state = self._link.state()
        handle.feedback(on_path(trajectory, trajectory.duration_s, 0.0, state).feedback(self._limits.names))
        await self._arrived(claim, goal, trajectory)

    async def _watch(self, claim: Claim, goal: FjtGoal, trajectory: Trajectory, handle: GoalHandle) -> None:
        """Tell the client, and end the motion where it leaves the tolerances."""
        begun_s, paused_s = time.monotonic(), claim.pace.paused_s
        latest_s = self._latest_s(goal, trajectory)
        for turn in itertools.count():
            with contextlib.suppress(CobotError):
                state = self._link.state()
                if state.motion_id == claim.motion_id:
                    rate = float(self._link.memory.state.data["path_rate"])
                    progress = on_path(trajectory, state.path_time_s, rate, state)
                    self._judge(claim, goal, progress)
                    if turn % FEEDBACK_EVERY == 0:
                        handle.feedback(progress.feedback(self._limits.names))
                    elapsed_s = time.monotonic() - begun_s - (claim.pace.paused_s - paused_s)
                    if elapsed_s > latest_s and self._under_way(goal, trajectory, state):
                        claim.interrupt(GoalViolated(self._late(goal)))
            await asyncio.sleep(WATCH_S)

    async def _arrived(self, claim: Claim, goal: FjtGoal, trajectory: Trajectory) -> None:
        """Wait for goal_tolerance where it is tighter than what counts as arrived."""
        deadline_s = time.monotonic() + min(goal.late_s, ARRIVAL_S)
        while True:
            state = self._link.state()
            off = goal.end.violation(trajectory.end - state.position, -state.velocity, self._limits.names)
            if not off:
                return
            if time.monotonic() > deadline_s:
                raise GoalViolated(f"at the end {off} by goal_tolerance")
            claim.proceed()
            await asyncio.sleep(WATCH_S)

    async def _stream(
        self, run: _Run, goal: FjtGoal, trajectory: Trajectory, settings: FjtSettings, handle: GoalHandle
    ) -> None:
        """Have it executed by a servo session, point by point."""
        servo, period_s = self._servo, settings.period_s
        spacing_s = CYCLE_S if settings.mode is ServoMode.BUFFERED_1MS else period_s
        await servo.begin(settings.mode, max(WATCHDOG_S, 5.0 * period_s), period_s)
        session = servo.session
        begun_s = time.monotonic()
        latest_s = trajectory.duration_s + min(goal.late_s, ARRIVAL_S)
        told = 0
        try:
            for number in itertools.count(1):
                if not servo.holds(session):
                    raise MotionStopped(f"the servo session has ended: {servo.reason}")
                until_s = number * period_s
                times_s = [until_s - spacing_s * n for n in reversed(range(round(period_s / spacing_s)))]
                for point in trajectory.sample(times_s).tolist():
                    await servo.point(point, time_s=settings.time_s or spacing_s)
                await run.sleep(begun_s + until_s - time.monotonic())
                elapsed_s = time.monotonic() - begun_s
                rate = float(elapsed_s < trajectory.duration_s)
                progress = on_path(
                    trajectory, min(elapsed_s, trajectory.duration_s), rate, self._link.state()
                )
                if violation := progress.path_violation(goal, self._limits.names):
                    raise PathViolated(f"{violation} by path_tolerance")
                if elapsed_s >= told * WATCH_S * FEEDBACK_EVERY:
                    told = int(elapsed_s / (WATCH_S * FEEDBACK_EVERY)) + 1
                    handle.feedback(progress.feedback(self._limits.names))
                if rate == 0.0 and self._finished(goal, progress):
                    return
                if elapsed_s > latest_s:
                    raise GoalViolated(self._late(goal))
        finally:
            if servo.holds(session):
                await servo.end(str(run.cause or "follow_joint_trajectory is done"))

    def _finished(self, goal: FjtGoal, progress: Progress) -> bool:
        wanted = zip((goal.end.position, goal.end.velocity), FINISHED, strict=True)
        return all(
            bool((np.abs(error) <= np.where(np.isinf(allowed), default, allowed)).all())
            for error, (allowed, default) in zip(progress.error, wanted, strict=True)
        )

    def _judge(self, claim: Claim, goal: FjtGoal, progress: Progress) -> None:
        if claim.interruption is None and (violation := progress.path_violation(goal, self._limits.names)):
            claim.interrupt(PathViolated(f"{violation} by path_tolerance"))

    def _under_way(self, goal: FjtGoal, trajectory: Trajectory, state: RobotState) -> bool:
        """Whether the arm is not where the goal wants it yet; what it then takes to settle does not count."""
        if state.path_time_s < trajectory.duration_s:
            return True
        return bool(goal.end.violation(trajectory.end - state.position, -state.velocity, self._limits.names))

    def _latest_s(self, goal: FjtGoal, trajectory: Trajectory) -> float:
        """After the beginning, when the arm has to be there."""
        return max(goal.points[-1].time_from_start_s + goal.late_s, trajectory.duration_s + WATCH_S)

    def _late(self, goal: FjtGoal) -> str:
        allowed = "" if math.isinf(goal.late_s) else f" and goal_time_tolerance ({goal.late_s:g} s)"
        return f"not arrived within the trajectory's time ({goal.points[-1].time_from_start_s:g} s){allowed}"

    def _failed(self, handle: GoalHandle, error: CobotError) -> Message:
        cancelled = handle.cancel_requested.is_set() and isinstance(error, MotionStopped)
        handle.status = GoalStatus.CANCELED if cancelled else GoalStatus.ABORTED
        code = getattr(error, "error_code", None)
        if code is None:
            wrong = isinstance(error, InputError | PlanningError)
            code = ErrorCode.INVALID_GOAL if wrong else ErrorCode.INTERRUPTED
        log.warning("%s: %s: %s", self.name, code.name, error)
        return {"error_code": int(code), "error_string": str(error)}
