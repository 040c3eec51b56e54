"""What the service asks of rtloop, against the real cycle, stepped by hand."""

from __future__ import annotations

import asyncio
import threading

import numpy as np
import pytest
from rig import CAPACITY, Rig

from app.services.state import commands
from app.services.state.commands import IN_THREAD_SEGMENTS, loading_s
from app.services.state.link import RobotLink
from cobot.errors import NotReadyError, UnavailableError
from cobot.motions.requests import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import RobotDescription
from cobot.trajectory import ORDER, Trajectory
from cobot.types import Array, LoopMode, PlannerName, Scaling

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

    with pytest.raises(NotReadyError, match="a stop has been requested in the meantime"):
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


def test_an_output_that_waits_for_a_long_reset_is_not_set_later(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its client has given up by then. A device that hangs delays the answer to a reset."""
    rig.request("estops")
    rig.step(10)
    link = attached(rig)
    monkeypatch.setattr(commands, "ACKNOWLEDGE_S", 0.05)

    async def refused() -> None:
        reset = asyncio.ensure_future(link.commands.reset(STALE_S))
        await asyncio.sleep(0)
        with pytest.raises(UnavailableError, match="suction is not set, because rtloop has been busy"):
            await link.commands.set_output("suction", 1.0)
        while not reset.done():
            rig.step()
            await asyncio.sleep(0)
        await reset
        with pytest.raises(UnavailableError, match="has not answered a OUTPUT"):  # the turn is free again
            await link.commands.set_output("suction", 1.0)

    asyncio.run(refused())
    assert int(link.memory.head.data["id"]) == 2
    link.close()


class SlowSlot:
    """A slot that a thread writes into until it is let go."""

    def __init__(self) -> None:
        self.go_on = threading.Event()
        self.written: list[int] = []
        self.at_once = self.most_at_once = 0

    def write(self, motion_id: int, *_: object) -> None:
        self.at_once += 1
        self.most_at_once = max(self.most_at_once, self.at_once)
        self.go_on.wait(60.0)
        self.written.append(motion_id)
        self.at_once -= 1


def long_motion(home: Array) -> Trajectory:
    rest = np.zeros((IN_THREAD_SEGMENTS + 1, len(home), ORDER))
    rest[:, :, 0] = home
    return Trajectory(np.arange(len(rest) + 1.0), rest)


@pytest.mark.parametrize("command", ["start", "replace"])
def test_a_cancelled_command_keeps_its_turn_until_its_thread_has_ended(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    """A second thread in the same slot could mix two motions into one that nobody has checked."""
    rig.step(10)
    link, slot = attached(rig), SlowSlot()
    monkeypatch.setattr(link.memory, "slots", (slot, slot))
    motion, head = long_motion(rig.home), int(rig.memory.head.data["id"])

    def begin() -> asyncio.Task[object]:
        if command == "start":
            return asyncio.ensure_future(link.commands.start(motion, link.stops))
        return asyncio.ensure_future(link.commands.replace(motion, 0.0, link.stops))

    async def cancelled() -> None:
        first = begin()
        while not slot.at_once:
            await asyncio.sleep(0.001)
        second = begin()
        for _ in range(3):  # a task may be cancelled more than once
            first.cancel()
            await asyncio.sleep(0.001)
        assert not first.done()
        assert slot.most_at_once == 1
        slot.go_on.set()
        with pytest.raises(asyncio.CancelledError):
            await first
        second.cancel()
        with pytest.raises(asyncio.CancelledError):
            await second

    asyncio.run(cancelled())
    assert slot.most_at_once == 1
    assert int(rig.memory.head.data["id"]) == head, "nothing has been sent"
    assert link.commands.handed_over is None
    rig.step(10)
    assert rig.mode is LoopMode.HOLD
    link.close()
