"""What the service asks of rtloop, against the real cycle, stepped by hand."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest
from rig import CAPACITY, Rig

from app.services.state.commands import loading_s
from app.services.state.link import RobotLink
from cobot.errors import NotReadyError, UnavailableError
from cobot.motions.requests import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import RobotDescription
from cobot.trajectory import ORDER, Trajectory
from cobot.types import LoopMode, PlannerName, Scaling

STALE_S = 60.0
"""The cycle is stepped by hand: what it has published may be old."""


def attached(rig: Rig) -> RobotLink:
    return RobotLink(rig.memory.path.name.removeprefix("cobot-"), STALE_S)


def test_a_motion_that_was_not_answered_for_never_begins(rig: Rig, robot: RobotDescription) -> None:
    """Its client has been told 503, so it must not move later either."""
    rig.step(10)
    link = attached(rig)
    goal = rig.home + 0.3
    trajectory = plan_ptp(robot, MotionRequest(rig.home, goal, PlannerName.PTP, Scaling(0.5)), goal)
    with pytest.raises(UnavailableError, match="has not answered a START for 3 s"):
        asyncio.run(link.commands.start(trajectory, link.stops))
    rig.step(500)  # rtloop goes on after all
    assert rig.mode is LoopMode.HOLD
    np.testing.assert_array_equal(rig.commanded[-1], rig.home)
    link.close()


def test_a_long_motion_loads_in_half_the_time_that_it_is_waited_for(rig: Rig) -> None:
    rig.step(10)
    rest = np.zeros((CAPACITY, len(rig.home), ORDER))
    rest[:, :, 0] = rig.home
    before = len(rig.commanded)
    assert rig.start(Trajectory(np.arange(CAPACITY + 1.0), rest)) == ""
    cycles = len(rig.commanded) - before
    period_s = rig.settings.rt.period_s
    # A cycle takes the command, one looks at all the breakpoints, and one at what is left.
    assert cycles == 3 + np.ceil(0.5 * loading_s(CAPACITY, period_s) / period_s)


def test_a_reset_that_waits_for_its_turn_ends_no_estop_that_was_asked_for_meanwhile(rig: Rig) -> None:
    rig.request("estops")
    rig.step(10)
    link = attached(rig)

    async def overtaken() -> None:
        first = asyncio.ensure_future(link.commands.acknowledge())  # it has the turn, and is not answered yet
        second = asyncio.ensure_future(link.commands.reset(STALE_S))
        await asyncio.sleep(0)
        link.request_estop()
        while not second.done():
            rig.step()
            await asyncio.sleep(0)
        await first
        await second

    with pytest.raises(NotReadyError, match="a stop was requested meanwhile"):
        asyncio.run(overtaken())
    assert rig.mode is LoopMode.ESTOP
    link.close()


def test_a_reset_that_was_not_answered_for_never_happens(rig: Rig) -> None:
    rig.request("estops")
    rig.step(10)
    link = attached(rig)
    with pytest.raises(UnavailableError, match="has not answered a RESET"):
        asyncio.run(link.commands.reset(0.2))
    rig.step(500)
    assert rig.mode is LoopMode.ESTOP
    link.close()
