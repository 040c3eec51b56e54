"""Motions of several robots that begin and end together, and the frames that they share.

Long, for planning them, starting them and watching them have one list of who takes part.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from app.services.motion.frames import Frames
from app.services.motion.ownership import Caller, Claim
from app.services.motion.speed_override import SpeedOverride
from cobot.errors import CobotError, ConflictError, InputError, LimitError, MotionStopped, NotFoundError
from cobot.planners.rated import RatedMove
from cobot.robot.limits import check_positions
from cobot.strict import shown
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, vector

if TYPE_CHECKING:
    from app.robot_services import Services

NAME = "a synchronous motion"
PLANNING_TIMEOUT_S = 10.0
MAX_GROUPS = 100
MAX_WAITING = 1000
MAX_NAME = 200

log = logging.getLogger("cobot.sync")


@dataclass(frozen=True, slots=True)
class Target:
    """Where a robot goes, rad, and how fast its fastest joint may be: rad/s, rad/s².

    Attributes:
        stops: `RobotLink.stops` of this robot when it was asked for: a later stop is for it too.
    """

    joints: Array
    velocity: float
    acceleration: float
    stops: int


@dataclass(slots=True)
class _Sync:
    """Robots that move segment by segment.

    Attributes:
        waiting: of segments that not all robots have yet, by their number and robot.
        turn: segments go one after the other.
    """

    robots: tuple[str, ...]
    waiting: dict[int, dict[str, Target]] = field(default_factory=dict)
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)


class SyncService:
    """One for all robots.

    Attributes:
        robots: by name; filled when all are there.
        frames, groups: what clients have made; a group is a list of robots.
    """

    def __init__(self) -> None:
        self.robots: dict[str, Services] = {}
        self.frames = Frames()
        self.groups: dict[str, tuple[str, ...]] = {}
        self._syncs: dict[int, _Sync] = {}
        self._following: dict[str, asyncio.Task[None]] = {}

    def add_group(self, name: str, robots: list[str]) -> None:
        """Name some robots.

        Raises:
            ConflictError: there is a group of that name.
            InputError: no robots, one twice, or one that does not exist.
        """
        if not 1 <= len(name) <= MAX_NAME:
            raise InputError(f"a name has from 1 to {MAX_NAME} characters, got {shown(name)}")
        if name in self.groups:
            raise ConflictError(f"there is a group {shown(name)} already")
        if len(self.groups) >= MAX_GROUPS:
            raise LimitError(f"there are {MAX_GROUPS} groups already")
        self.groups[name] = self._named(robots)

    def group(self, name: str) -> tuple[str, ...]:
        """The robots of a group.

        Raises:
            NotFoundError: there is none; lists those that are.
        """
        if name not in self.groups:
            there = ", ".join(self.groups) or "none"
            raise NotFoundError(f"there is no group {shown(name)}; there are: {there}")
        return self.groups[name]

    def targets(self, robots: tuple[str, ...], joints: list[float], a: float, v: float) -> dict[str, Target]:
        """Targets from the joint angles of all robots, one after the other.

        Raises:
            InputError: another number of angles.
            LimitError: beyond a robot's limits.
        """
        sizes = [self.robots[name].robot.limits.dof for name in robots]
        if len(joints) != sum(sizes):
            each = ", ".join(f"{name} {size}" for name, size in zip(robots, sizes, strict=True))
            raise InputError(f"q must have {sum(sizes)} angles ({each}), got {len(joints)}")
        parts = np.split(vector(joints, name="q"), np.cumsum(sizes)[:-1])
        return {name: self._target(name, part, a, v) for name, part in zip(robots, parts, strict=True)}

    def begin(self, number: int, robots: list[str]) -> None:
        """Have these robots move segment by segment; nothing changes when they do already.

        Raises:
            InputError, ConflictError: see `add_group`; or another one has one of them.
        """
        names = self._named(robots)
        for other, sync in self._syncs.items():
            if other == number and set(sync.robots) == set(names):
                return
            if other == number or set(sync.robots) & set(names):
                raise ConflictError(f"synchronous motion {other} is on for {', '.join(sync.robots)}")
        self._syncs[number] = _Sync(names)

    def end(self, number: int, *, undo: bool = False) -> None:
        """The opposite of `begin`.

        Args:
            undo: forget segments that wait, where otherwise they are a reason to refuse.

        Raises:
            NotFoundError: it is not on.
            ConflictError: a segment waits for a robot.
        """
        sync = self._sync(number)
        for segment, targets in sync.waiting.items():
            if not undo:
                missing = ", ".join(name for name in sync.robots if name not in targets)
                raise ConflictError(f"segment {segment} waits for {missing}")
        del self._syncs[number]

    def is_on(self, robot: str) -> bool:
        return any(robot in sync.robots for sync in self._syncs.values())

    async def segment(self, robot: str, segment: int, joints: list[float], a: float, v: float) -> bool:
        """A robot's part of a segment. The last robot's part starts it, once the segment before has ended.

        Returns:
            Whether it has been started.

        Raises:
            ConflictError: the robot is in no synchronous motion, or has its part already.
            InputError, LimitError: see `targets`; or too many segments wait.
            MotionStopped: a robot was stopped since its part came, or the synchronous motion was ended.
            CobotError: what `move` raises.
        """
        sync = next((each for each in self._syncs.values() if robot in each.robots), None)
        if sync is None:
            raise ConflictError(f"{robot} is in no synchronous motion; syncMoveOn begins one")
        (target,) = self.targets((robot,), joints, a, v).values()
        if segment not in sync.waiting and len(sync.waiting) >= MAX_WAITING:
            raise LimitError(f"{MAX_WAITING} segments wait for a robot already")
        waiting = sync.waiting.setdefault(segment, {})
        if robot in waiting:
            raise ConflictError(f"{robot} has its part of segment {segment} already")
        waiting[robot] = target
        if len(waiting) < len(sync.robots):
            return False
        del sync.waiting[segment]
        async with sync.turn:
            await self.wait(sync.robots)
            if sync not in self._syncs.values():
                raise MotionStopped(f"the synchronous motion was ended before segment {segment} began")
            await self.move(waiting)
        return True

    async def wait(self, robots: tuple[str, ...]) -> None:
        """Until no synchronous motion moves any of them."""
        tasks = {self._following[name] for name in robots if name in self._following}
        if tasks:
            await asyncio.wait(tasks)

    async def move(self, targets: dict[str, Target]) -> None:
        """Start a motion of several robots, each as long as the slowest one's; returns when all have begun.

        Raises:
            ConflictError, NotReadyError, UnavailableError: a robot cannot move; none has moved.
            PlanningError: a robot finds no way; none has moved.
            ExecutionError: one was refused or stopped; all are brought to rest.
        """
        for name, target in targets.items():
            if self.robots[name].link.stops != target.stops:
                raise MotionStopped(f"{name} was stopped after its part of the motion was asked for")
        with contextlib.ExitStack() as stack:
            claims = {
                name: stack.enter_context(self.robots[name].ownership.claim(self._caller(name)))
                for name in targets
            }
            planned = await asyncio.gather(
                *(self._plan(name, targets[name], claim) for name, claim in claims.items())
            )
            ways = {name: way for name, way in zip(targets, planned, strict=True) if way is not None}
            while paused := [
                claim for claim in claims.values() if claim.speed_override.paused
            ]:  # nobody goes ahead
                await paused[0].unless_interrupted(paused[0].speed_override.opened.wait())
            takes_s = {
                name: way.duration_s / claims[name].speed_override.fraction for name, way in ways.items()
            }
            longest_s = max(takes_s.values(), default=0.0)
            starts = [
                self.robots[name].motion.start(claims[name], way.stretched(longest_s / takes_s[name]))
                for name, way in ways.items()
            ]
            moving = {name: claims[name] for name in ways}
            stack.enter_context(_in_step([claim.speed_override for claim in moving.values()]))
            begun = await asyncio.gather(*starts, return_exceptions=True)
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

    def _named(self, robots: list[str]) -> tuple[str, ...]:
        if not robots or len(set(robots)) < len(robots):
            raise InputError(f"robots must be one or more, each once, got {robots}")
        for name in robots:
            if name not in self.robots:
                raise InputError(f"there is no robot {shown(name)}; there are: {', '.join(self.robots)}")
        return tuple(robots)

    def _sync(self, number: int) -> _Sync:
        if number not in self._syncs:
            there = ", ".join(map(str, self._syncs)) or "none"
            raise NotFoundError(f"there is no synchronous motion {number}; on are: {there}")
        return self._syncs[number]

    def _target(self, name: str, joints: Array, a: float, v: float) -> Target:
        check_positions(self.robots[name].robot.limits, joints)
        return Target(joints, v, a, self.robots[name].link.stops)

    def _caller(self, name: str) -> Caller:
        return Caller(NAME, None, self.robots[name].ownership.stops, math.inf, asyncio.Event())

    async def _plan(self, name: str, target: Target, claim: Claim) -> Trajectory | None:
        services = self.robots[name]
        state = await services.motion.ready()
        move = RatedMove(
            state.commanded_position,
            target.joints,
            PlannerName.PTP,
            target.velocity,
            target.acceleration,
            services.settings.envelope,
        )
        return await services.motion.plan(claim, move, PLANNING_TIMEOUT_S)

    async def _follow(self, claims: dict[str, Claim], belongings: contextlib.ExitStack) -> None:
        """See all to their end; one that does not arrive stops the others."""

        async def arrive(name: str, claim: Claim) -> None:
            try:
                if claim.motion_id is not None:
                    await self.robots[name].motion.arrival(claim)
            except CobotError as exc:
                log.warning("%s: %s", name, exc)
                _stop({other: each for other, each in claims.items() if other != name}, exc)

        with belongings:
            await asyncio.gather(*(arrive(name, claim) for name, claim in claims.items()))


@contextlib.contextmanager
def _in_step(overrides: list[SpeedOverride]) -> Iterator[None]:
    """None of them pauses alone while the context lasts."""
    for override in overrides:
        override.others = tuple(other for other in overrides if other is not override)
    try:
        yield
    finally:
        for override in overrides:
            override.others = ()


def _stop(claims: dict[str, Claim], cause: BaseException) -> None:
    for claim in claims.values():
        claim.interrupt(MotionStopped(f"another robot of the synchronous motion has stopped: {cause}"))
