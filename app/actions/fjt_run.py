"""How a FollowJointTrajectory goal is executed: its settings, its way to the end, servo sessions for it."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
from dataclasses import dataclass

import numpy as np

from app.actions.fjt_goal import FjtGoal, GoalViolated, PathViolated
from app.actions.fjt_progress import Progress, on_path
from app.graph.actions import GoalHandle
from app.services.motion.ownership import Claim
from app.services.state.link import RobotLink
from app.services.streaming.servo import ServoService
from cobot.errors import ExecutionError, MotionStopped
from cobot.ipc.layout import ServoMode
from cobot.trajectory import Trajectory

FEEDBACK_S = 0.05
"""20 Hz, the default of joint_trajectory_controller."""
SEND_PERIOD_S = 0.01
WATCHDOG_S = 0.5
OWNER = "follow_joint_trajectory"
CYCLE_S = 0.001
"""Of the points of servo mode 4, which are sent together once in a period."""
ARRIVAL_S = 5.0
"""How long a servo session is waited for that has got its last point, unless the goal says otherwise."""
FINISHED = (0.005, 0.02)
"""rad and rad/s: how near a servo session has to come to the end, where goal_tolerance says nothing."""


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


class Run:
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


async def stream(
    servo: ServoService,
    link: RobotLink,
    names: tuple[str, ...],
    run: Run,
    goal: FjtGoal,
    trajectory: Trajectory,
    settings: FjtSettings,
    handle: GoalHandle,
    stops: int,
) -> None:
    """Have a goal's trajectory executed by a servo session, point by point; returns when the arm is there.

    Args:
        stops: `RobotLink.stops` when the arm was claimed for it.

    Raises:
        PathViolated, GoalViolated: see there.
        MotionStopped: the session was ended, or `run` was.
        CobotError: the session cannot begin, or does not take a point.
    """
    period_s = settings.period_s
    spacing_s = min(CYCLE_S, period_s) if settings.mode is ServoMode.BUFFERED_1MS else period_s
    watchdog_s = max(WATCHDOG_S, 5.0 * period_s)
    session = await servo.begin(settings.mode, watchdog_s, period_s, stops=stops, owner=OWNER)
    begun_s = link.clock.now_s()
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
            await run.sleep(begun_s + until_s - link.clock.now_s())
            elapsed_s = link.clock.now_s() - begun_s
            rate = float(elapsed_s < trajectory.duration_s)
            progress = on_path(
                trajectory, min(elapsed_s, trajectory.duration_s), rate, link.state(), link.clock.wall_ns()
            )
            if violation := progress.path_violation(goal, names):
                raise PathViolated(f"{violation} by path_tolerance")
            if elapsed_s >= told * FEEDBACK_S:
                told = int(elapsed_s / (FEEDBACK_S)) + 1
                handle.feedback(progress.feedback(names))
            if rate == 0.0 and _finished(goal, progress):
                return
            if elapsed_s > latest_s:
                raise GoalViolated(goal.late)
    finally:
        if servo.holds(session):
            await servo.end(str(run.cause or "follow_joint_trajectory is done"))


def _finished(goal: FjtGoal, progress: Progress) -> bool:
    wanted = zip((goal.end.position, goal.end.velocity), FINISHED, strict=True)
    return all(
        bool((np.abs(error) <= np.where(np.isinf(allowed), default, allowed)).all())
        for error, (allowed, default) in zip(progress.error, wanted, strict=True)
    )
