"""Following a motion to its end, against the real cycle, stepped by hand."""

from __future__ import annotations

import asyncio

import pytest
from rig import Rig

from app.services.motion.execution import MotionService
from app.services.motion.planning import PlanningService
from app.services.rights.claims import Caller
from app.services.rights.ownership import Ownership
from app.services.state.link import RobotLink
from cobot.errors import ExecutionError
from cobot.robot.description import RobotDescription

STALE_S = 60.0
"""The cycle is stepped by hand: what it has published may be old."""


def test_a_motion_that_a_restart_has_swallowed_has_failed(rig: Rig, robot: RobotDescription) -> None:
    """rtloop acknowledges, and dies before it has published the motion: its successor knows nothing of it."""
    rig.step(10)
    link = RobotLink(rig.memory.path.name.removeprefix("cobot-"), STALE_S)
    planning = PlanningService(None, 1)
    ownership = Ownership(link)
    service = MotionService(robot, link, planning)
    caller = Caller("test", None, ownership.stops, 10.0, asyncio.Event())

    async def arrive() -> None:
        with ownership.claim(caller) as claim:
            claim.motion_id = 1
            waiting = asyncio.create_task(service.arrival(claim))
            await asyncio.sleep(0.02)
            assert not waiting.done(), "the state may be of the cycle before"
            rig.step()
            await waiting

    with pytest.raises(ExecutionError, match="rtloop was restarted; the motion has not begun"):
        asyncio.run(arrive())
    planning.close()
    link.close()
