"""Motions of several robots that begin together, have equal durations and stop together."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.services.rights.claims import Caller, Claim
from app.services.rights.job import JobKind
from app.services.rights.speed_override import SpeedOverride
from app.services.rights.stop_reason import StopReason
from cobot.errors import CobotError, ConflictError
from cobot.motions.requests import MotionRequest, RatedMove
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, Scaling

if TYPE_CHECKING:
    from app.robot_services import Services

NAME = "a synchronous motion"
PLANNING_TIMEOUT_S = 10.0

log = logging.getLogger("cobot.sync")


@dataclass(frozen=True, slots=True)
class RobotTarget:
    """The target of one robot (rad), and the limits of its fastest joint: velocity (rad/s) and acceleration
    (rad/s²).

    Attributes:
        stops: `RobotLink.stops` of this robot at the time of the request. If it has changed since, the motion
            is stopped.
    """

    joints: Array
    velocity: float
    acceleration: float
    stops: int


class EqualMotions:
    """Plans motions of equal duration for several robots, starts them and follows them to their end.

    Args:
        robots: the robots by name. The mapping is read again for each request.
    """

    def __init__(self, robots: dict[str, Services]) -> None:
        self._robots = robots
        self._following: dict[str, asyncio.Task[None]] = {}

    async def wait(self, robots: tuple[str, ...]) -> None:
        """Wait until no synchronous motion is moving any of these robots."""
        tasks = {self._following[name] for name in robots if name in self._following}
        if tasks:
            await asyncio.wait(tasks)

    async def move(self, targets: dict[str, RobotTarget]) -> None:
        """Start a motion of several robots. Every robot takes as long as the slowest one. Returns when all
        motions have begun.

        Raises:
            ConflictError, NotReadyError, UnavailableError: one of the robots cannot move, or the time factors
                of simulated robots differ. No robot has moved.
            PlanningError: the motion of one robot cannot be planned. No robot has moved.
            ExecutionError: one of the motions was rejected or stopped. All robots have been stopped.
        """
        for name, target in targets.items():
            if self._robots[name].link.stops != target.stops:
                raise StopReason(
                    f"{name} was stopped after its part of the motion was requested", by=""
                ).error
        with contextlib.ExitStack() as stack:
            claims: dict[str, Claim] = {}
            for name in targets:
                owned = await self._robots[name].ownership.claim_motion(self._caller(name))
                claims[name] = stack.enter_context(owned)
            ways = await self._ways(targets, claims)
            self._require_one_time(ways)
            moving = {name: claims[name] for name in ways}
            starts = [self._robots[name].motion.start(claims[name], way) for name, way in ways.items()]
            stack.enter_context(_in_step([claim.speed_override for claim in moving.values()]))
            begun = await asyncio.gather(*starts, return_exceptions=True)
            for claim, each in zip(moving.values(), begun, strict=True):
                if isinstance(each, BaseException):
                    claim.fail(each)
            failed = next((each for each in begun if isinstance(each, BaseException)), None)
            if failed is not None:
                _stop(moving, failed)
            task = asyncio.create_task(self._follow(moving, stack.pop_all()))
            for name in targets:
                self._following[name] = task
        if failed is not None:
            await task
            raise failed

    def close(self) -> None:
        for task in self._following.values():
            task.cancel()

    def _require_one_time(self, robots: Iterable[str]) -> None:
        factors = {name: self._robots[name].link.time_factor for name in robots}
        if len(set(factors.values())) > 1:
            each = ", ".join(f"{name} {factor:g}" for name, factor in factors.items())
            raise ConflictError(
                f"the time factors of the robots differ ({each}), so they would not move together; set the "
                "same factor for all of them"
            )

    async def _ways(self, targets: dict[str, RobotTarget], claims: dict[str, Claim]) -> dict[str, Trajectory]:
        """Plan the motions of all robots that are not at their targets yet. Each motion is stretched to the
        duration of the slowest one.
        """
        planned = await asyncio.gather(
            *(self._plan(name, targets[name], claim) for name, claim in claims.items())
        )
        ways = {name: way for name, way in zip(targets, planned, strict=True) if way is not None}
        while paused := [claim for claim in claims.values() if claim.speed_override.paused]:
            # No robot may start while another one is paused.
            await paused[0].run_interruptibly(paused[0].speed_override.opened.wait())
        fractions = {name: claims[name].speed_override.fraction for name in ways}
        takes_s = {name: way.duration_s / fractions[name] for name, way in ways.items()}
        longest_s = max(takes_s.values(), default=0.0)
        return {name: way.stretched(longest_s / takes_s[name]) for name, way in ways.items()}

    def _caller(self, name: str) -> Caller:
        ownership = self._robots[name].ownership
        job = ownership.new_job(JobKind.SYNCHRONOUS, NAME)
        return Caller(NAME, None, ownership.stops, math.inf, asyncio.Event(), job)

    async def _plan(self, name: str, target: RobotTarget, claim: Claim) -> Trajectory | None:
        services = self._robots[name]
        state = await services.motion.require_ready()
        move = RatedMove(
            MotionRequest(state.commanded_position, target.joints, PlannerName.PTP, Scaling(1.0)),
            velocity=target.velocity,
            acceleration=target.acceleration,
            envelope=services.settings.envelope,
        )
        return await services.motion.plan(claim, move, PLANNING_TIMEOUT_S)

    async def _follow(self, claims: dict[str, Claim], belongings: contextlib.ExitStack) -> None:
        """Follow all motions to their end. If one does not reach its target, the others are stopped."""

        async def await_arrival(name: str, claim: Claim) -> None:
            try:
                if claim.motion_id is not None:
                    await self._robots[name].motion.arrival(claim)
            except CobotError as exc:
                claim.fail(exc)
                log.warning("%s: %s", name, exc)
                _stop({other: each for other, each in claims.items() if other != name}, exc)

        with belongings:
            await asyncio.gather(*(await_arrival(name, claim) for name, claim in claims.items()))


@contextlib.contextmanager
def _in_step(overrides: list[SpeedOverride]) -> Iterator[None]:
    """While the context is open, no robot can be paused alone."""
    for override in overrides:
        override.others = tuple(other for other in overrides if other is not override)
    try:
        yield
    finally:
        for override in overrides:
            override.others = ()


def _stop(claims: dict[str, Claim], cause: BaseException) -> None:
    for claim in claims.values():
        reason = f"another robot of the synchronous motion has stopped: {cause}"
        claim.interrupt(StopReason(reason, "other_robot", "").error)
