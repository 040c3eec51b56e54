"""Execution of a FollowJointTrajectory goal: its settings, its state while it runs, and its servo session."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
from dataclasses import dataclass

import numpy as np

from app.actions.fjt_goal import WIDER_PATH, FjtGoal, GoalViolated, PathViolated
from app.actions.fjt_progress import TrajectoryProgress, on_path
from app.graph.actions import GoalHandle
from app.services.rights.claims import Claim
from app.services.state.link import RobotLink
from app.services.streaming.servo import ServoService
from cobot.errors import ExecutionError, MotionStopped
from cobot.ipc.layout import ServoMode
from cobot.trajectory import Trajectory
from cobot.types import JointLimits

FEEDBACK_S = 0.05
"""Interval between feedback messages, s. joint_trajectory_controller has the same default, 20 Hz."""
SEND_PERIOD_S = 0.01
WATCHDOG_S = 0.5
OWNER = "follow_joint_trajectory"
CYCLE_S = 0.001
"""Interval between points in servo mode 4, s. All points of one sending period are sent together."""
ARRIVAL_S = 5.0
"""Timeout for the arm to arrive after the last point of a servo session, s, unless the goal sets a different
timeout.
"""
FINISHED = (0.005, 0.02)
"""Maximum position and velocity error at the end of a servo session if the goal has no goal_tolerance, rad
and rad/s.
"""


@dataclass(frozen=True, slots=True)
class FjtSettings:
    """Settings for the execution of goals. The settings file has their initial values; `fjt_control` changes
    them.

    Attributes:
        mode: servo mode; NONE for a planned motion.
        time_s: duration of each servo point, s. 0 means the period.
        period_s: interval between servo points, s.
    """

    enabled: bool
    mode: ServoMode
    time_s: float
    period_s: float


class TrajectoryRun:
    """A goal, from acceptance to its end.

    Attributes:
        cause: the reason to end early; None while the goal may continue.
        ended: event that is set when the arm is at rest, or moves for another client.
    """

    def __init__(self) -> None:
        self.cause: ExecutionError | None = None
        self.ended = asyncio.Event()
        self._interrupted = asyncio.Event()
        self._claim: Claim | None = None

    def interrupt(self, cause: ExecutionError) -> None:
        """End this run. Only the cause from the first call is kept."""
        if self.cause is None:
            self.cause = cause
            self._interrupted.set()
            if self._claim is not None:
                self._claim.interrupt(cause)

    def own(self, claim: Claim) -> None:
        """Bind this run to a claim. Interrupting the run then interrupts the claim as well."""
        self._claim = claim
        if self.cause is not None:
            claim.interrupt(self.cause)

    def proceed(self) -> None:
        """Raise the cause if this run must end."""
        if self.cause is not None:
            raise self.cause

    async def sleep(self, seconds: float) -> None:
        """Sleep for a given time. If the run must end, wake up at once and raise the cause."""
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._interrupted.wait(), max(seconds, 0.0))
        self.proceed()


class ServoExecution:
    """Executes goals in servo sessions, point by point."""

    def __init__(self, servo: ServoService, link: RobotLink, limits: JointLimits) -> None:
        self._servo = servo
        self._link = link
        self._limits = limits

    async def execute(
        self,
        run: TrajectoryRun,
        goal: FjtGoal,
        trajectory: Trajectory,
        settings: FjtSettings,
        handle: GoalHandle,
        stops: int,
    ) -> None:
        """Execute the trajectory of a goal. Returns when the arm has arrived.

        Args:
            stops: `RobotLink.stops` when the arm was claimed for it.

        Raises:
            PathViolated, GoalViolated: the arm exceeded the tolerances of the goal.
            MotionStopped: the session was ended, or `run` was.
            CobotError: the session cannot begin, or rejects a point.
        """
        servo, clock, period_s = self._servo, self._link.clock, settings.period_s
        spacing_s = min(CYCLE_S, period_s) if settings.mode is ServoMode.BUFFERED_1MS else period_s
        watchdog_s = max(WATCHDOG_S, 5.0 * period_s)
        session = await servo.begin(settings.mode, watchdog_s, period_s, stops=stops, owner=OWNER)
        begun_s = clock.now_s()
        latest_s = trajectory.duration_s + min(goal.late_s, ARRIVAL_S)
        told = 0
        try:
            for number in itertools.count(1):
                if not servo.holds(session):
                    raise MotionStopped(f"the servo session has ended: {servo.reason}")
                until_s = number * period_s
                times_s = [until_s - spacing_s * n for n in reversed(range(round(period_s / spacing_s)))]
                for point in trajectory.sample(times_s).tolist():
                    await servo.point(point, time_s=settings.time_s or spacing_s, owner=OWNER)
                await run.sleep(begun_s + until_s - clock.now_s())
                elapsed_s = clock.now_s() - begun_s
                progress = self._progress(goal, trajectory, elapsed_s)
                if elapsed_s >= told * FEEDBACK_S:
                    told = int(elapsed_s / FEEDBACK_S) + 1
                    handle.feedback(progress.feedback(self._limits.names))
                if elapsed_s >= trajectory.duration_s and _finished(goal, progress):
                    return
                if elapsed_s > latest_s:
                    raise GoalViolated(goal.late(trajectory.duration_s))
        finally:
            if servo.holds(session):
                await servo.end(str(run.cause or "follow_joint_trajectory is done"))

    def _progress(self, goal: FjtGoal, trajectory: Trajectory, elapsed_s: float) -> TrajectoryProgress:
        """Return the progress along the trajectory. Raises `PathViolated` if the arm is too far from it."""
        rate = float(elapsed_s < trajectory.duration_s)
        time_s, stamp_ns = min(elapsed_s, trajectory.duration_s), self._link.clock.wall_ns()
        progress = on_path(trajectory, time_s, rate, self._link.state(), stamp_ns)
        if violation := progress.path_violation(goal, self._limits):
            raise PathViolated(f"{violation} by path_tolerance; {WIDER_PATH}")
        return progress


def _finished(goal: FjtGoal, progress: TrajectoryProgress) -> bool:
    wanted = zip((goal.end.position, goal.end.velocity), FINISHED, strict=True)
    return all(
        bool((np.abs(error) <= np.where(np.isinf(allowed), default, allowed)).all())
        for error, (allowed, default) in zip(progress.error, wanted, strict=True)
    )
