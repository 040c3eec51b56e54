"""Pausing and slowing down motions, on the stepped cycle.

Oracle: the cycle itself (tests/support/rig.py), and numpy: a paused motion is on the same straight line.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from rig import Rig

from app.services.motion.execution import MotionService
from app.services.motion.planning import PlanningService
from app.services.rights.claims import Caller, Claim, watching
from app.services.rights.ownership import Ownership
from app.services.state.link import RobotLink
from cobot.errors import (
    ConflictError,
    ExecutionError,
    LimitError,
    MotionStopped,
    MotionTimeout,
    NotSupportedError,
)
from cobot.ipc.device_record import fill_capabilities
from cobot.ipc.layout import MotionResult
from cobot.planners import MotionRequest, plan
from cobot.robot.description import RobotDescription
from cobot.robot.device import Capabilities
from cobot.trajectory import Trajectory
from cobot.types import LoopMode, PlannerName, Scaling


class Bench:
    """A rig, and the services that move it."""

    def __init__(self, rig: Rig, robot: RobotDescription) -> None:
        self.rig = rig
        self.link = RobotLink(rig.memory.path.name.removeprefix("cobot-"), 60.0)
        self.ownership = Ownership(self.link)
        self.planning = PlanningService(None, 1)
        self.motion = MotionService(robot, self.link, self.planning)
        self.goal = rig.home + np.array([0.5, -0.3, 0.2, 0.0, 0.0, 0.4, 0.0])
        made = plan(robot, MotionRequest(rig.home, self.goal, PlannerName.PTP, Scaling(0.5)))
        assert made is not None
        self.trajectory: Trajectory = made

    def claim(self, timeout_s: float = math.inf) -> contextlib.AbstractContextManager[Claim]:
        return self.ownership.claim(self.caller(timeout_s))

    def caller(self, timeout_s: float = math.inf) -> Caller:
        return Caller("a test", None, self.ownership.stops, timeout_s, asyncio.Event())

    async def during(self, work: Any) -> Any:
        """The result of `work` while the cycle goes on."""
        task = asyncio.ensure_future(work)
        while not task.done():
            self.rig.step()
            await asyncio.sleep(0.0002)
        return task.result()

    async def go(self, claim: Claim) -> None:
        await self.motion.start(claim, self.trajectory)
        await self.motion.arrival(claim)

    def close(self) -> None:
        self.planning.close()
        self.link.close()


@pytest.fixture
def bench(rig: Rig, robot: RobotDescription) -> Iterator[Bench]:
    rig.step(30)
    made = Bench(rig, robot)
    yield made
    made.close()


def test_a_paused_motion_rests_on_its_path_and_then_arrives(bench: Bench) -> None:
    async def check() -> None:
        rig, override = bench.rig, bench.ownership.speed_override
        with bench.claim() as claim:
            await bench.during(bench.motion.start(claim, bench.trajectory))
            rig.step(300)
            await bench.during(override.pause())
            assert override.paused
            here = rig.commanded[-1]
            rig.step(2000)
            np.testing.assert_array_equal(rig.commanded[-1], here)
            assert rig.mode is LoopMode.TRAJECTORY
            share = (here - rig.home) @ (bench.goal - rig.home) / ((bench.goal - rig.home) ** 2).sum()
            assert 0.0 < share < 1.0
            np.testing.assert_allclose(here, rig.home + share * (bench.goal - rig.home), atol=1e-6)
            await bench.during(override.resume())
            await bench.during(bench.motion.arrival(claim))
        assert rig.result is MotionResult.ARRIVED
        np.testing.assert_allclose(rig.commanded[-1], bench.goal, atol=1e-6)
        for shares in rig.rates():
            assert shares.max() <= 1.011

    asyncio.run(check())


def test_what_begins_during_a_pause_waits_for_its_end(bench: Bench) -> None:
    async def check() -> None:
        rig, override = bench.rig, bench.ownership.speed_override
        await bench.during(override.pause())
        with bench.claim() as claim:
            going = asyncio.create_task(bench.go(claim))
            await bench.during(asyncio.sleep(0.05))
            assert rig.mode is LoopMode.HOLD
            assert not going.done()
            await bench.during(override.resume())
            await bench.during(going)
        np.testing.assert_allclose(rig.commanded[-1], bench.goal, atol=1e-6)

    asyncio.run(check())


@pytest.mark.parametrize("begun", [False, True])
def test_a_stop_ends_a_pause_and_what_was_paused(bench: Bench, begun: bool) -> None:
    async def check() -> None:
        rig, override = bench.rig, bench.ownership.speed_override
        with bench.claim() as claim:
            if begun:
                await bench.during(bench.motion.start(claim, bench.trajectory))
                rig.step(200)
            await bench.during(override.pause())
            going = asyncio.create_task(bench.motion.arrival(claim) if begun else bench.go(claim))
            await bench.during(asyncio.sleep(0.01))
            bench.link.request_stop()
            bench.ownership.stop()
            with pytest.raises(MotionStopped):
                await bench.during(going)
        assert not override.paused
        assert rig.mode is LoopMode.HOLD

    asyncio.run(check())


def test_what_waited_in_a_pause_does_not_begin_after_an_estop_and_its_reset(bench: Bench) -> None:
    async def check() -> None:
        rig, override = bench.rig, bench.ownership.speed_override
        await bench.during(override.pause())
        with bench.claim() as claim:
            going = asyncio.create_task(bench.go(claim))
            await bench.during(asyncio.sleep(0.01))
            bench.link.request_estop()
            rig.step(20)
            await bench.during(bench.link.commands.reset(1.0))
            await bench.during(override.resume())
            with pytest.raises(ExecutionError, match="a stop has been requested in the meantime"):
                await bench.during(going)
        assert rig.mode is LoopMode.HOLD
        np.testing.assert_allclose(rig.commanded[-1], rig.home)

    asyncio.run(check())


def test_the_time_of_a_pause_does_not_count(bench: Bench) -> None:
    async def check() -> None:
        override, caller = bench.ownership.speed_override, bench.caller(0.15)
        with bench.ownership.claim(caller) as claim, watching(claim, caller):
            await bench.during(override.pause())
            await bench.during(asyncio.sleep(0.3))
            assert claim.interruption is None
            await bench.during(override.resume())
            await bench.during(asyncio.wait_for(claim.interrupted.wait(), 30.0))
            assert isinstance(claim.interruption, MotionTimeout)

    asyncio.run(check())


def test_the_time_of_a_slow_motion_goes_on_as_slowly(bench: Bench) -> None:
    """Oracle: the share of the speed, of the clock of the service."""

    async def check() -> None:
        override, caller = bench.ownership.speed_override, bench.caller(100.0)
        with bench.ownership.claim(caller) as claim, watching(claim, caller):
            await bench.during(override.set_fraction(0.1))
            begun_s, left_s = claim.clock.now_s(), claim.left_s()
            await asyncio.sleep(0.2)
            at_full_speed_s = 0.1 * (claim.clock.now_s() - begun_s)
            assert left_s - claim.left_s() == pytest.approx(at_full_speed_s, abs=0.01)
            await bench.during(override.set_fraction(1.0))
            begun_s, left_s = claim.clock.now_s(), claim.left_s()
            await asyncio.sleep(0.05)
            assert left_s - claim.left_s() == pytest.approx(claim.clock.now_s() - begun_s, abs=0.01)

    asyncio.run(check())


def test_the_timeout_of_a_motion_is_longer_in_the_slow_motion_of_a_simulation(bench: Bench) -> None:
    """Oracle: the product of both shares, of the clock of the service. A faster simulation changes none."""

    async def check() -> None:
        override, caller = bench.ownership.speed_override, bench.caller(100.0)
        with bench.ownership.claim(caller) as claim, watching(claim, caller):
            for factor, fraction, share in ((0.1, 1.0, 0.1), (0.25, 0.5, 0.125), (4.0, 1.0, 1.0)):
                await bench.during(override.set_fraction(fraction))
                override._account()
                bench.rig.clock.scale(factor)
                bench.rig.step()
                begun_s, left_s = claim.clock.now_s(), claim.left_s()
                await asyncio.sleep(0.2)
                passed_s = claim.clock.now_s() - begun_s
                assert left_s - claim.left_s() == pytest.approx(share * passed_s, abs=0.01)

    asyncio.run(check())


def test_a_fraction_of_the_speed_counts_for_motions_that_begin_later(bench: Bench) -> None:
    async def check() -> None:
        rig, override = bench.rig, bench.ownership.speed_override
        await bench.during(override.set_fraction(0.25))
        with bench.claim() as claim:
            await bench.during(bench.motion.start(claim, bench.trajectory))
            rig.step(500)
            before = rig.path_times[-1]
            rig.step(100)
            assert rig.path_times[-1] - before == pytest.approx(0.025, rel=1e-6)
            await bench.during(override.pause())
            await bench.during(override.resume())
            rig.step(500)
            before = rig.path_times[-1]
            rig.step(100)
            assert rig.path_times[-1] - before == pytest.approx(0.025, rel=1e-6)
            await bench.during(override.set_fraction(1.0))
            await bench.during(bench.motion.arrival(claim))
        for fraction in (0.005, -0.5, 1.1):
            with pytest.raises(LimitError, match=r"from 0\.01 to 1"):
                await override.set_fraction(fraction)

    asyncio.run(check())


def test_a_stream_cannot_be_paused(bench: Bench) -> None:
    async def check() -> None:
        assert bench.rig.stream() == ""
        bench.rig.step(50)
        with pytest.raises(ConflictError, match="no path on which it could pause"):
            await bench.ownership.speed_override.pause()
        assert not bench.ownership.speed_override.paused

    asyncio.run(check())


def test_a_device_that_moves_by_itself_is_neither_slowed_down_nor_paused(bench: Bench) -> None:
    device = bench.rig.memory.device
    fill_capabilities(device.data, Capabilities(trajectories=True))
    device.publish()
    override = bench.ownership.speed_override
    for asked in (override.set_fraction(0.5), override.pause()):
        with pytest.raises(
            NotSupportedError, match="executes whole motions itself, so a motion can be stopped"
        ):
            asyncio.run(asked)
    assert (override.fraction, override.paused) == (1.0, False)
