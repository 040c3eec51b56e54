"""The service's end of shared memory, against the real cycle, stepped by hand."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import numpy as np
import pytest
from rig import Rig

from app.services.link import RobotLink
from cobot.config import Settings
from cobot.errors import UnavailableError
from cobot.planners.ptp import plan_ptp
from cobot.planners.request import MotionRequest
from cobot.robot import Robot
from cobot.types import Mode, PlannerName, Scaling


@pytest.fixture
def rig(settings: Settings, robot: Robot) -> Iterator[Rig]:
    made = Rig(settings, robot)
    yield made
    made.close()


def test_a_motion_that_was_not_answered_for_never_begins(rig: Rig, robot: Robot) -> None:
    """Its client has been told 503, so it must not move later either."""
    rig.step(10)
    link = RobotLink(rig.memory.path.name.removeprefix("cobot-"), 0.25)
    goal = rig.home + 0.3
    trajectory = plan_ptp(robot, MotionRequest(rig.home, goal, PlannerName.PTP, Scaling(0.5)), goal)
    with pytest.raises(UnavailableError, match="has not answered a START for 3 s"):
        asyncio.run(link.start(trajectory, link.stops))
    rig.step(500)  # rtloop goes on after all
    assert rig.mode is Mode.HOLD
    np.testing.assert_array_equal(rig.commanded[-1], rig.home)
    link.close()
