"""Synchronous motions of two robots, each on a stepped cycle of its own.

Oracle: the cycles themselves (tests/support/rig.py): what was commanded, and when each arm moved.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cobot_run import WAIT_S
from rig import Rig

from app.services.motion.execution import MotionService
from app.services.motion.planning import PlanningService
from app.services.motion.synchronous import MAX_WAITING, SyncService
from app.services.motion.tool_and_limits import RobotSettings
from app.services.rights.ownership import Ownership
from app.services.state.link import RobotLink
from cobot.config import Settings
from cobot.errors import ConflictError, LimitError, MotionStopped
from cobot.robot.description import RobotDescription
from cobot.types import LoopMode

LEFT, RIGHT = "left", "right"


class Pair:
    """Two robots and what moves them together."""

    def __init__(self, settings: Settings, robot: RobotDescription) -> None:
        self.rigs = {LEFT: Rig(settings, robot), RIGHT: Rig(settings, robot)}
        self.planning = PlanningService(None, 1)
        self.sync = SyncService()
        self.links = {}
        for name, rig in self.rigs.items():
            rig.step(30)
            link = self.links[name] = RobotLink(rig.memory.path.name.removeprefix("cobot-"), 60.0)
            ownership = Ownership(link)
            motion = MotionService(robot, link, self.planning)
            self.sync.robots[name] = SimpleNamespace(  # type: ignore[assignment]
                robot=robot, link=link, ownership=ownership, motion=motion, settings=RobotSettings(robot)
            )
        self.home = self.rigs[LEFT].home
        self.away = (self.home + 0.3).tolist()

    def stop(self, name: str) -> None:
        """As POST /stop does."""
        self.links[name].request_stop()
        self.sync.robots[name].ownership.stop()

    def moved(self, name: str) -> bool:
        return bool(np.abs(np.array(self.rigs[name].commanded) - self.home).max() > 1e-9)

    async def until(self, condition: Callable[[], object]) -> None:
        async with asyncio.timeout(WAIT_S):
            while not condition():
                for rig in self.rigs.values():
                    rig.step(3)
                await asyncio.sleep(0.0005)

    async def done(self, work: Coroutine[Any, Any, Any]) -> Any:
        task = asyncio.ensure_future(work)
        await self.until(task.done)
        return task.result()

    async def segment(self, name: str, number: int, joints: list[float]) -> bool:
        started: bool = await self.sync.segment(name, number, joints, 2.0, 1.0)
        return started

    def close(self) -> None:
        self.sync.close()
        self.planning.close()
        for link in self.links.values():
            link.close()
        for rig in self.rigs.values():
            rig.close()


@pytest.fixture
def pair(settings: Settings, robot: RobotDescription) -> Iterator[Pair]:
    made = Pair(settings, robot)
    yield made
    made.close()


def test_a_stop_is_for_the_segments_that_wait_for_the_one_under_way_too(pair: Pair) -> None:
    async def live() -> None:
        home = pair.home.tolist()
        pair.sync.begin(1, [LEFT, RIGHT])
        await pair.segment(LEFT, 1, pair.away)
        assert await pair.done(pair.segment(RIGHT, 1, pair.away))
        await pair.segment(LEFT, 2, home)
        second = asyncio.ensure_future(pair.segment(RIGHT, 2, home))
        await pair.until(lambda: pair.moved(LEFT))
        assert not second.done()
        pair.stop(LEFT)
        await pair.until(second.done)
        with pytest.raises(MotionStopped, match="was stopped after"):
            second.result()
        await pair.until(lambda: all(rig.mode is LoopMode.HOLD for rig in pair.rigs.values()))
        at = [rig.commanded[-1] for rig in pair.rigs.values()]
        await pair.done(asyncio.sleep(0.3))
        np.testing.assert_array_equal([rig.commanded[-1] for rig in pair.rigs.values()], at)

    asyncio.run(live())


def test_a_part_from_before_a_stop_moves_nothing_after_it(pair: Pair) -> None:
    async def live() -> None:
        pair.sync.begin(1, [LEFT, RIGHT])
        await pair.segment(LEFT, 1, pair.away)
        pair.stop(LEFT)
        with pytest.raises(MotionStopped, match="left was stopped after its part"):
            await pair.done(pair.segment(RIGHT, 1, pair.away))
        assert not pair.moved(LEFT)
        assert not pair.moved(RIGHT)
        await pair.segment(LEFT, 1, pair.away)  # both may say it again
        assert await pair.done(pair.segment(RIGHT, 1, pair.away))

    asyncio.run(live())


def test_a_part_from_before_a_stop_gives_way_to_a_new_one(pair: Pair) -> None:
    async def live() -> None:
        pair.sync.begin(1, [LEFT, RIGHT])
        await pair.segment(LEFT, 1, pair.away)
        with pytest.raises(ConflictError, match="the part of left in segment 1 was already sent"):
            await pair.segment(LEFT, 1, pair.away)
        pair.stop(LEFT)
        await pair.segment(LEFT, 1, pair.away)
        assert await pair.done(pair.segment(RIGHT, 1, pair.away))

    asyncio.run(live())


def test_only_so_many_segments_wait(pair: Pair) -> None:
    async def live() -> None:
        pair.sync.begin(1, [LEFT, RIGHT])
        for number in range(MAX_WAITING):
            await pair.segment(LEFT, number, pair.away)
        with pytest.raises(LimitError, match="segments are already waiting for a robot"):
            await pair.segment(LEFT, MAX_WAITING, pair.away)
        assert await pair.done(pair.segment(RIGHT, 0, pair.away))  # one that waits may begin

    asyncio.run(live())


def test_a_segment_that_waits_is_forgotten_when_the_synchronous_motion_is_ended(pair: Pair) -> None:
    async def live() -> None:
        pair.sync.begin(1, [LEFT])
        assert await pair.done(pair.segment(LEFT, 1, pair.away))
        second = asyncio.ensure_future(pair.segment(LEFT, 2, pair.home.tolist()))
        await asyncio.sleep(0)
        pair.sync.end(1, undo=True)
        await pair.until(second.done)
        with pytest.raises(MotionStopped, match="was ended before segment 2 began"):
            second.result()
        np.testing.assert_allclose(pair.rigs[LEFT].commanded[-1], pair.away, atol=1e-6)

    asyncio.run(live())


def test_nobody_goes_ahead_while_one_of_them_is_paused(pair: Pair) -> None:
    async def live() -> None:
        override = pair.sync.robots[LEFT].ownership.speed_override
        await pair.done(override.pause())
        targets = pair.sync.targets((LEFT, RIGHT), pair.away + pair.away, 2.0, 1.0)
        moving = asyncio.ensure_future(pair.sync.move(targets))
        await pair.done(asyncio.sleep(1.0))
        with pytest.raises(ConflictError):
            pair.sync.robots[RIGHT].ownership.require_free(None)  # it is planned, or will be
        assert not pair.moved(RIGHT)
        await pair.done(override.resume())
        await pair.until(moving.done)
        moving.result()
        await pair.done(pair.sync.wait((LEFT, RIGHT)))
        np.testing.assert_allclose(pair.rigs[RIGHT].commanded[-1], pair.away, atol=1e-6)

    asyncio.run(live())


def test_a_robot_at_half_its_speed_has_the_other_one_take_twice_as_long(pair: Pair) -> None:
    async def live() -> None:
        await pair.done(pair.sync.robots[LEFT].ownership.speed_override.set_fraction(0.5))
        targets = pair.sync.targets((LEFT, RIGHT), pair.away + pair.away, 2.0, 1.0)
        await pair.done(pair.sync.move(targets))
        await pair.done(pair.sync.wait((LEFT, RIGHT)))
        ends = [np.abs(np.diff(rig.commanded, axis=0)).max(axis=1) > 1e-9 for rig in pair.rigs.values()]
        left, right = (int(np.flatnonzero(moving)[-1]) for moving in ends)
        assert abs(left - right) < 150  # cycles; twice the way alone would be some 1000

    asyncio.run(live())


def test_robots_whose_simulations_run_at_different_speeds_do_not_move_together(pair: Pair) -> None:
    async def live() -> None:
        pair.rigs[LEFT].clock.scale(0.5)
        pair.rigs[LEFT].step()
        targets = pair.sync.targets((LEFT, RIGHT), pair.away + pair.away, 2.0, 1.0)
        with pytest.raises(ConflictError, match=r"differ \(left 0.5, right 1\)"):
            await pair.done(pair.sync.move(targets))
        assert not pair.moved(LEFT)
        assert not pair.moved(RIGHT)
        pair.rigs[RIGHT].clock.scale(0.5)
        pair.rigs[RIGHT].step()
        await pair.done(pair.sync.move(targets))
        with pytest.raises(ConflictError, match="cannot be changed during a synchronous motion"):
            await pair.sync.robots[LEFT].ownership.speed_override.set_time_factor(1.0)
        await pair.done(pair.sync.wait((LEFT, RIGHT)))
        assert pair.moved(LEFT)
        assert pair.moved(RIGHT)

    asyncio.run(live())


def test_a_pause_of_one_during_the_motion_is_one_of_both(pair: Pair) -> None:
    async def live() -> None:
        override = pair.sync.robots[LEFT].ownership.speed_override
        targets = pair.sync.targets((LEFT, RIGHT), pair.away + pair.away, 1.0, 0.3)
        await pair.done(pair.sync.move(targets))
        await pair.until(lambda: pair.moved(RIGHT))
        with pytest.raises(ConflictError, match="the speed of a synchronous motion cannot be changed"):
            await override.set_fraction(0.5)
        await pair.done(override.pause())
        at = [rig.commanded[-1].copy() for rig in pair.rigs.values()]
        await pair.done(asyncio.sleep(0.2))
        np.testing.assert_array_equal([rig.commanded[-1] for rig in pair.rigs.values()], at)
        assert np.abs(at[1] - np.array(pair.away)).max() > 0.05  # on its way
        await pair.done(override.resume())
        await pair.done(pair.sync.wait((LEFT, RIGHT)))
        for rig in pair.rigs.values():
            np.testing.assert_allclose(rig.commanded[-1], pair.away, atol=1e-6)

    asyncio.run(live())
