"""The action /{robot}/follow_joint_trajectory (control_msgs/action/FollowJointTrajectory).

A goal is executed as one planned motion. The service checks the whole motion before it starts, and rtloop
then executes it without further help from the service. With an `fjt_mode` from 1 to 7 the goal is executed as
a servo session with points from the same polynomials. Invalid goals are accepted and then aborted with an
error code and a message, because a ROS rejection has no field for them. A goal is rejected only if the action
is disabled, another client is moving the arm, or an e-stop is active.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging
import math
from collections.abc import AsyncIterator, Sequence
from dataclasses import replace

import numpy as np

from app.actions.fjt_goal import (
    WIDER_PATH,
    FjtGoal,
    GoalError,
    GoalViolated,
    Message,
    PathViolated,
    read_goal,
)
from app.actions.fjt_progress import TrajectoryProgress, on_path
from app.actions.fjt_run import (
    ARRIVAL_S,
    FEEDBACK_S,
    SEND_PERIOD_S,
    FjtSettings,
    ServoExecution,
    TrajectoryRun,
)
from app.graph.actions import GoalHandle, GoalStatus
from app.services.motion.execution import MotionService
from app.services.rights.claims import Caller, Claim
from app.services.rights.job import JobKind
from app.services.rights.ownership import Ownership
from app.services.rights.stop_reason import StopReason
from app.services.state.link import RobotLink
from app.services.state.robot_state import RobotState
from app.services.streaming.servo import ServoService
from cobot.config import RosSection
from cobot.errors import CobotError, ConflictError, ExecutionError, MotionStopped
from cobot.ipc.layout import MotionResult, ServoMode
from cobot.motions.points import FOLLOW_JOINT_TRAJECTORY, WaypointRequest
from cobot.robot.description import RobotDescription
from cobot.robot.limits import check_positions
from cobot.ros.failures import FjtError, error_code_of
from cobot.trajectory import Trajectory
from cobot.types import Array

WATCH_S = 0.01
"""Interval between checks of a goal's tolerances, s."""
FEEDBACK_EVERY = round(FEEDBACK_S / WATCH_S)
READY_S = 1.0
THERE_S = 0.5
"""Duration of the motion for a goal whose only point is the arm's current position, s."""
PLAN_S = 30.0

log = logging.getLogger("cobot.fjt")


class FollowJointTrajectory:
    """See `app.graph.actions.GraphAction`."""

    type_ = "control_msgs/action/FollowJointTrajectory"
    definition = ""

    def __init__(
        self,
        robot: RobotDescription,
        link: RobotLink,
        ownership: Ownership,
        motion: MotionService,
        servo: ServoService,
        settings: RosSection,
        start_tolerance_rad: float,
        smoothing_rad: float = 0.0,
    ) -> None:
        self.name = f"/{robot.name}/follow_joint_trajectory"
        self._limits = robot.limits
        self._link = link
        self._ownership = ownership
        self._motion = motion
        self._servo = servo
        self._streamed = ServoExecution(servo, link, robot.limits)
        self._configured = settings
        self._start_tolerance_rad = start_tolerance_rad
        self._smoothing_rad = smoothing_rad
        self._newest: TrajectoryRun | None = None

    @property
    def settings(self) -> FjtSettings:
        """The current settings."""
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
            raise ConflictError(f"{self.name} is switched off; see ros.enable_fjt_action, or fjt_control")
        if self._newest is None:
            await self._ownership.await_free(None)
        await self._link.await_ready_state(READY_S)
        try:
            wanted = await asyncio.to_thread(read_goal, goal, self._limits, self._wall_s())
        except GoalError as exc:  # the current motion continues
            handle.accept()
            return self._fail(handle, exc)
        handle.accept()
        async with self._turn(handle) as run:
            try:
                note = await self._work(run, wanted, settings, stops, handle)
            except CobotError as exc:
                return self._fail(handle, exc)
        handle.status = GoalStatus.SUCCEEDED
        return {"error_code": int(FjtError.SUCCESSFUL), "error_string": note}

    def _wall_s(self) -> float:
        return self._link.clock.wall_ns() * 1e-9

    @contextlib.asynccontextmanager
    async def _turn(self, handle: GoalHandle) -> AsyncIterator[TrajectoryRun]:
        """Context manager for one goal: ends the previous goal, and lets the new one run until it is
        cancelled or a newer goal replaces it.
        """
        run, before = TrajectoryRun(), self._newest
        self._newest = run

        async def await_cancel() -> None:
            await handle.cancel_requested.wait()
            run.interrupt(StopReason("the goal was cancelled", "cancelled").error)

        watcher = asyncio.create_task(await_cancel())
        try:
            if before is not None:
                before.interrupt(StopReason("preempted by a newer goal", "replaced").error)
                await before.ended.wait()
            yield run
        finally:
            watcher.cancel()
            run.ended.set()
            if self._newest is run:
                self._newest = None

    async def _work(
        self, run: TrajectoryRun, goal: FjtGoal, settings: FjtSettings, stops: int, handle: GoalHandle
    ) -> str:
        """Plan the goal and execute it. Returns a description of how the motion differs from the goal; "" if
        it does not differ.
        """
        # Streamed points have no path time, so this is a session without a job.
        planned = settings.mode is ServoMode.NONE
        job = self._ownership.new_job(JobKind.GOAL, f"{len(goal.points)} points") if planned else None
        caller = Caller(self.name, None, stops, math.inf, asyncio.Event(), job)
        with await self._ownership.claim_motion(caller) as claim:
            run.own(claim)
            state = await self._motion.require_ready()
            trajectory = await self._plan(claim, goal, state, streamed=settings.mode != ServoMode.NONE)
            if goal.start_s is not None:
                await claim.run_interruptibly(run.sleep(goal.start_s - self._wall_s()))
            run.proceed()
            if settings.mode is ServoMode.NONE:
                await self._follow(claim, goal, trajectory, handle)
                return trajectory.note
        await self._streamed.execute(run, goal, trajectory, settings, handle, claim.stops)
        return trajectory.note

    async def _plan(self, claim: Claim, goal: FjtGoal, state: RobotState, *, streamed: bool) -> Trajectory:
        """Plan the motion through all points. Where the limits require it and the goal permits it, the motion
        is slower than requested.
        """
        start, points = state.commanded_position, goal.points
        if points[-1].time_from_start_s == 0.0:
            self._require_there(start, points[0].positions)
            points = [replace(points[0], time_from_start_s=THERE_S)]
        request = WaypointRequest(
            start,
            points,
            self._start_tolerance_rad,
            check_limits=not streamed,
            retime=not streamed,
            corridor_rad=goal.corridor_rad(self._smoothing_rad),
            longest_s=points[-1].time_from_start_s + goal.late_s,
            ways=FOLLOW_JOINT_TRAJECTORY,
        )
        trajectory = await self._motion.plan(claim, request, PLAN_S)
        assert trajectory is not None  # plan_waypoints always returns a motion
        if trajectory.note:
            log.warning("%s: %s", self.name, trajectory.note)
        for extreme in trajectory.extrema():  # checked before the first point of the session is sent
            check_positions(self._limits.including(start), extreme, "the trajectory's angle")
        return trajectory

    def _require_there(self, start: Array, position: Sequence[float]) -> None:
        """Check that the arm is at the goal's only point, whose time is 0. MoveIt sends such a plan if the
        arm is already at its goal.
        """
        off = np.abs(np.asarray(position) - start)
        if off.max() > self._start_tolerance_rad:
            joint = int(off.argmax())
            name, unit = self._limits.names[joint], self._limits.unit(joint)
            raise GoalError(
                f"points[0]: the only point is at time 0, but {name} is {off.max():.4f} {unit} away from it, "
                f"allowed: {self._start_tolerance_rad:g} {unit}; with a time_from_start above 0 the arm "
                f"moves there"
            )

    async def _follow(self, claim: Claim, goal: FjtGoal, trajectory: Trajectory, handle: GoalHandle) -> None:
        """Execute the trajectory as one planned motion."""
        await self._motion.start(claim, trajectory)
        log.info("%s: motion %s, %d points", self.name, claim.motion_id, len(goal.points))
        watcher = asyncio.create_task(self._watch(claim, goal, trajectory, handle))
        try:
            await self._motion.arrival(claim)
        except ExecutionError as exc:
            cause = claim.interruption
            if cause is None and self._link.state().motion_result is MotionResult.FAILED:
                raise GoalViolated(str(exc)) from exc
            # `exc` also contains the result, such as "not settled"
            if cause is not None and not isinstance(exc, type(cause)):
                raise type(cause)(f"{cause}; {exc}") from exc
            raise
        finally:
            watcher.cancel()
        state = self._link.state()
        stamp_ns = self._link.clock.wall_ns()
        progress = on_path(trajectory, trajectory.duration_s, 0.0, state, stamp_ns)
        handle.feedback(progress.feedback(self._limits.names))
        await self._await_arrival(claim, goal, trajectory)

    async def _watch(self, claim: Claim, goal: FjtGoal, trajectory: Trajectory, handle: GoalHandle) -> None:
        """Send feedback to the client, and end the motion if it leaves the tolerances."""
        begun_s, held_up_s = self._link.clock.now_s(), claim.speed_override.held_up_s
        latest_s = self._latest_s(goal, trajectory)
        for turn in itertools.count():
            with contextlib.suppress(CobotError):
                state = self._link.state()
                if state.motion_id == claim.motion_id:
                    stamp_ns = self._link.clock.wall_ns()
                    progress = on_path(trajectory, state.path_time_s, state.path_rate, state, stamp_ns)
                    self._check_path_tolerance(claim, goal, progress)
                    if turn % FEEDBACK_EVERY == 0:
                        handle.feedback(progress.feedback(self._limits.names))
                    elapsed_s = (
                        self._link.clock.now_s() - begun_s - (claim.speed_override.held_up_s - held_up_s)
                    )
                    if elapsed_s > latest_s and self._under_way(goal, trajectory, state):
                        claim.interrupt(GoalViolated(goal.late(trajectory.duration_s)))
            await asyncio.sleep(WATCH_S)

    async def _await_arrival(self, claim: Claim, goal: FjtGoal, trajectory: Trajectory) -> None:
        """Wait until the arm is within goal_tolerance. A wait is needed only if goal_tolerance is tighter
        than the service's own end-of-motion tolerance.
        """
        deadline_s = self._link.clock.now_s() + min(goal.late_s, ARRIVAL_S)
        while True:
            state = self._link.state()
            off = goal.end.violation(trajectory.end - state.position, -state.velocity, self._limits)
            if not off:
                return
            if self._link.clock.now_s() > deadline_s:
                raise GoalViolated(f"at the end {off} by goal_tolerance; raise it, or set it to 0")
            claim.proceed()
            await asyncio.sleep(WATCH_S)

    def _check_path_tolerance(self, claim: Claim, goal: FjtGoal, progress: TrajectoryProgress) -> None:
        if claim.interruption is None and (violation := progress.path_violation(goal, self._limits)):
            claim.interrupt(PathViolated(f"{violation} by path_tolerance; {WIDER_PATH}"))

    def _under_way(self, goal: FjtGoal, trajectory: Trajectory, state: RobotState) -> bool:
        """Whether the motion is still running, or the arm is still outside the goal's tolerances at its end.
        The arm need not settle further once it is within them.
        """
        if state.path_time_s < trajectory.duration_s:
            return True
        return bool(goal.end.violation(trajectory.end - state.position, -state.velocity, self._limits))

    def _latest_s(self, goal: FjtGoal, trajectory: Trajectory) -> float:
        """Return the latest time at which the arm may arrive, in seconds from the start of the motion."""
        return max(goal.points[-1].time_from_start_s + goal.late_s, trajectory.duration_s + WATCH_S)

    def _fail(self, handle: GoalHandle, error: CobotError) -> Message:
        cancelled = handle.cancel_requested.is_set() and isinstance(error, MotionStopped)
        handle.status = GoalStatus.CANCELED if cancelled else GoalStatus.ABORTED
        code = error_code_of(error)
        log.warning("%s: %s: %s", self.name, code.name, error)
        return {"error_code": int(code), "error_string": str(error)}
