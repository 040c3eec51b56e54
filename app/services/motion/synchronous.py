"""Synchronous motions of several robots, segment by segment, and the groups and frames that the robots share.

`app.services.motion.equal_motions` executes such a motion.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from app.services.motion.equal_motions import EqualMotions, RobotTarget
from app.services.motion.frames import Frames
from app.services.rights.stop_reason import StopReason
from cobot.errors import ConflictError, InputError, LimitError, NotFoundError
from cobot.robot.limits import check_positions
from cobot.strict import shown
from cobot.types import Array, vector

if TYPE_CHECKING:
    from app.robot_services import Services

MAX_GROUPS = 100
MAX_WAITING = 1000
MAX_NAME = 200


@dataclass(slots=True)
class _Sync:
    """A group of robots that move synchronously, segment by segment.

    Attributes:
        waiting: parts of incomplete segments, by the number of the segment and by robot.
        turn: lock that makes segments run one at a time.
    """

    robots: tuple[str, ...]
    waiting: dict[int, dict[str, RobotTarget]] = field(default_factory=dict)
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)


class SyncService:
    """The service for synchronous motions. One instance serves all robots.

    Attributes:
        robots: the robots by name. It is filled once all robots have started.
        frames, groups: frames and groups that clients have defined. A group is a sequence of robot names.
    """

    def __init__(self) -> None:
        self.robots: dict[str, Services] = {}
        self.frames = Frames()
        self.groups: dict[str, tuple[str, ...]] = {}
        self._syncs: dict[int, _Sync] = {}
        self._motions = EqualMotions(self.robots)

    def add_group(self, name: str, robots: list[str]) -> None:
        """Define a named group of robots.

        Raises:
            ConflictError: a group with this name exists.
            InputError: the list is empty, or a robot is listed twice or does not exist.
        """
        if not 1 <= len(name) <= MAX_NAME:
            raise InputError(f"a name must be 1 to {MAX_NAME} characters long, got {shown(name)}")
        if name in self.groups:
            raise ConflictError(f"the group {shown(name)} already exists")
        if len(self.groups) >= MAX_GROUPS:
            raise LimitError(f"there are already {MAX_GROUPS} groups, which is the maximum")
        self.groups[name] = self._named(robots)

    def group(self, name: str) -> tuple[str, ...]:
        """Return the robots of a group.

        Raises:
            NotFoundError: there is no such group; the error lists the existing ones.
        """
        if name not in self.groups:
            there = ", ".join(self.groups) or "none"
            raise NotFoundError(f"there is no group {shown(name)}; valid names: {there}")
        return self.groups[name]

    def targets(
        self, robots: tuple[str, ...], joints: list[float], a: float, v: float
    ) -> dict[str, RobotTarget]:
        """Split one list of concatenated joint angles into the targets of all robots.

        Raises:
            InputError: the number of angles is wrong.
            LimitError: an angle is beyond a robot's limits.
        """
        sizes = [self.robots[name].robot.limits.dof for name in robots]
        if len(joints) != sum(sizes):
            each = ", ".join(f"{name} {size}" for name, size in zip(robots, sizes, strict=True))
            raise InputError(f"q must have {sum(sizes)} angles ({each}), got {len(joints)}")
        parts = np.split(vector(joints, name="q"), np.cumsum(sizes)[:-1])
        return {name: self._target(name, part, a, v) for name, part in zip(robots, parts, strict=True)}

    def begin(self, number: int, robots: list[str]) -> None:
        """Begin a synchronous motion of these robots. Does nothing if it has already begun.

        Raises:
            InputError, ConflictError: see `add_group`; or one of the robots is already in another synchronous
                motion.
        """
        names = self._named(robots)
        for other, sync in self._syncs.items():
            if other == number and set(sync.robots) == set(names):
                return
            if other == number or set(sync.robots) & set(names):
                raise ConflictError(
                    f"the synchronous motion {other} is already active for {', '.join(sync.robots)}"
                )
        self._syncs[number] = _Sync(names)

    def end(self, number: int, *, undo: bool = False) -> None:
        """End a synchronous motion.

        Args:
            undo: whether to delete waiting segments. If it is false, waiting segments are an error.

        Raises:
            NotFoundError: the synchronous motion has not begun.
            ConflictError: a segment is waiting for a robot.
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
        """Add one robot's part of a segment. When the last part has been added and the previous segment has
        ended, the segment starts.

        Returns:
            Whether the segment has been started.

        Raises:
            ConflictError: the robot is not in a synchronous motion, or its part was already added.
            InputError, LimitError: see `targets`; or too many segments wait.
            MotionStopped: a robot was stopped after its part was added, or the synchronous motion was ended.
            CobotError: any error that `move` raises.
        """
        sync = next((each for each in self._syncs.values() if robot in each.robots), None)
        if sync is None:
            raise ConflictError(f"{robot} is not in a synchronous motion; syncMoveOn begins one")
        (target,) = self.targets((robot,), joints, a, v).values()
        if segment not in sync.waiting and len(sync.waiting) >= MAX_WAITING:
            raise LimitError(f"{MAX_WAITING} segments are already waiting for a robot, which is the maximum")
        waiting = sync.waiting.setdefault(segment, {})
        # If the numbers of stops differ, a stop has cancelled the part that was sent before.
        if robot in waiting and waiting[robot].stops == target.stops:
            raise ConflictError(f"the part of {robot} in segment {segment} was already sent")
        waiting[robot] = target
        if len(waiting) < len(sync.robots):
            return False
        del sync.waiting[segment]
        async with sync.turn:
            await self.wait(sync.robots)
            if sync not in self._syncs.values():
                raise StopReason(
                    f"the synchronous motion was ended before segment {segment} began", "cancelled", ""
                ).error
            await self.move(waiting)
        return True

    async def wait(self, robots: tuple[str, ...]) -> None:
        """Wait until no synchronous motion is moving any of these robots."""
        await self._motions.wait(robots)

    async def move(self, targets: dict[str, RobotTarget]) -> None:
        """See `EqualMotions.move`."""
        await self._motions.move(targets)

    def close(self) -> None:
        self._motions.close()

    def _named(self, robots: list[str]) -> tuple[str, ...]:
        if not robots or len(set(robots)) < len(robots):
            raise InputError(f"robots must be a list of one or more names, each once, got {robots}")
        for name in robots:
            if name not in self.robots:
                raise InputError(f"there is no robot {shown(name)}; valid names: {', '.join(self.robots)}")
        return tuple(robots)

    def _sync(self, number: int) -> _Sync:
        if number not in self._syncs:
            there = ", ".join(map(str, self._syncs)) or "none"
            raise NotFoundError(f"there is no synchronous motion {number}; active ones: {there}")
        return self._syncs[number]

    def _target(self, name: str, joints: Array, a: float, v: float) -> RobotTarget:
        check_positions(self.robots[name].robot.limits, joints)
        return RobotTarget(joints, v, a, self.robots[name].link.stops)
