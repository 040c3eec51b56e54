"""Timed trajectories. The client gets an answer once rtloop has accepted the motion, which then continues
even if the client disconnects.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime

from app.services.motion.execution import MotionService
from app.services.rights.claims import Caller, Claim, watching
from app.services.rights.ownership import Ownership
from cobot.config import PlanningSection
from cobot.errors import CobotError, ExecutionError
from cobot.logs import printable
from cobot.motions.points import WaypointRequest, check_first
from cobot.trajectory import Changes
from cobot.types import JointLimits, Scaling, Waypoint

LOG_LINES = 300
APPROACH = Scaling(0.25)
"""Scaling of `move_to_start`: a quarter of full speed."""

Read = Callable[[Callable[[Waypoint], None]], Sequence[Waypoint]]
"""Type of the function that reads the points; see `TrajectoryService.send`."""

log = logging.getLogger("cobot.trajectories")


@dataclass(frozen=True, slots=True)
class Options:
    """Options of a trajectory; see `WaypointRequest`.

    Attributes:
        smoothing_rad: maximum deviation from the points, rad; None for the value in the settings.
    """

    validate_limits: bool = True
    retime: bool = False
    move_to_start: bool = False
    smoothing_rad: float | None = None


@dataclass(frozen=True, slots=True)
class StartedTrajectory:
    """A trajectory that rtloop has accepted.

    Attributes:
        note: description of the differences from the points; "" if the motion follows the points exactly.
        changes: the same differences as numbers.
    """

    motion_id: int
    duration_s: float
    points: int
    note: str
    changes: Changes


class TrajectoryService:
    """Sends trajectories, and keeps a log of their results."""

    def __init__(
        self,
        limits: JointLimits,
        ownership: Ownership,
        motion: MotionService,
        planning: PlanningSection,
        label: str = "",
    ) -> None:
        self._limits = limits
        self._label = label
        self._ownership = ownership
        self._motion = motion
        self._start_tolerance_rad = planning.start_tolerance_rad
        self._smoothing_rad = planning.smoothing_rad
        self._lines: deque[str] = deque(maxlen=LOG_LINES)
        self._followers: set[asyncio.Task[None]] = set()

    def lines(self, count: int) -> list[str]:
        """Return the newest log lines in chronological order."""
        return list(self._lines)[-count:]

    async def send(self, read: Read, options: Options, caller: Caller) -> StartedTrajectory:
        """Interpolate, check and start a trajectory. Returns when rtloop has accepted the motion. The motion
        then continues even if the client disconnects.

        Args:
            read: function that returns the points or raises an InputError. It must call its argument with the
                first point before it reads the others. It is called in a thread, and only if the arm is free,
                so that rejecting a request takes almost no time.

        Raises:
            InputError, PlanningError: no motion is possible through the points. Nothing has moved.
            ExecutionError: the motion was interrupted, or rejected by rtloop.
            ConflictError, UnavailableError: see `MotionService`.
        """
        with contextlib.ExitStack() as stack:
            claim = stack.enter_context(await self._ownership.claim_motion(caller))
            try:
                with watching(claim, caller):
                    sent = await self._hand_over(claim, read, options, caller.timeout_s)
            except CobotError as exc:
                self._note(f"{caller.name}: rejected: {exc}")
                raise
            self._note(f"motion {sent.motion_id}: accepted, {sent.points} points, {sent.duration_s:.3f} s")
            if sent.note:
                self._note(f"motion {sent.motion_id}: {sent.note}")
            # From here on, the task that follows the motion to its end owns the claim.
            follower = asyncio.create_task(self._follow(claim, stack.pop_all()))
            self._followers.add(follower)
            follower.add_done_callback(self._followers.discard)
        return sent

    async def _hand_over(
        self, claim: Claim, read: Read, options: Options, timeout_s: float
    ) -> StartedTrajectory:
        start = (await self._motion.require_ready()).commanded_position
        tolerance_rad = math.inf if options.move_to_start else self._start_tolerance_rad

        def check(point: Waypoint) -> None:
            check_first(point, start, self._limits, tolerance_rad, within_limits=options.validate_limits)

        points = await claim.run_interruptibly(asyncio.to_thread(read, check))
        claim.accept()
        state = await self._motion.require_ready()
        request = WaypointRequest(
            state.commanded_position,
            points,
            self._start_tolerance_rad,
            check_limits=options.validate_limits,
            retime=options.retime,
            approach=APPROACH if options.move_to_start else None,
            corridor_rad=self._smoothing_rad if options.smoothing_rad is None else options.smoothing_rad,
        )
        trajectory = await self._motion.plan(claim, request, timeout_s)
        assert trajectory is not None  # plan_waypoints always returns a motion
        await self._motion.start(claim, trajectory)
        assert claim.motion_id is not None
        return StartedTrajectory(
            claim.motion_id, trajectory.duration_s, len(points), trajectory.note, trajectory.changes
        )

    async def _follow(self, claim: Claim, ownership: contextlib.ExitStack) -> None:
        with ownership:
            try:
                await self._motion.arrival(claim)
                self._note(f"motion {claim.motion_id}: arrived and settled")
            except ExecutionError as exc:
                claim.fail(exc)
                self._note(f"motion {claim.motion_id}: {exc}")
            except CobotError as exc:
                claim.fail(exc)
                self._note(f"motion {claim.motion_id}: its state is unknown: {exc}")

    def _note(self, text: str) -> None:
        moment = datetime.now().astimezone().isoformat(timespec="milliseconds")
        self._lines.append(f"{moment} {printable(text)}")
        log.info("%s%s", self._label, text)
