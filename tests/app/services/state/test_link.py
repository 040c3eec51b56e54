"""The service's end of shared memory, against the real cycle, stepped by hand."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import time

import numpy as np
import pytest
from faults import spoil
from rig import Rig

from app.services.state.link import RobotLink
from cobot.errors import UnavailableError
from cobot.ipc.layout import Command
from cobot.motions.requests import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import RobotDescription
from cobot.types import LoopMode, PlannerName, Scaling

STALE_S = 60.0
"""The cycle is stepped by hand: what it has published may be old."""


def attached(rig: Rig) -> RobotLink:
    return RobotLink(rig.memory.path.name.removeprefix("cobot-"), STALE_S)


def test_what_a_dead_process_has_published_just_now_is_not_how_the_robot_is(rig: Rig) -> None:
    """The oracle is the operating system, whose process with that number has ended."""
    rig.step(10)
    link = attached(rig)
    assert not link.silence(link.state())
    with subprocess.Popen([sys.executable, "-S", "-c", ""]) as process:
        pass
    rig.memory.statistics.data["pid"] = process.pid
    rig.memory.statistics.publish()
    gone = rf"rtloop \(pid {process.pid}\) has ended"
    with pytest.raises(UnavailableError, match=gone + "; cobot run restarts it if it has died"):
        asyncio.run(link.await_fresh_state(0.0))
    link.close()


def test_a_state_whose_writer_died_while_writing_names_the_real_time_process(rig: Rig) -> None:
    """A writer that was killed between its two increments leaves an odd sequence counter."""
    rig.step(10)
    link = attached(rig)
    memory = link.memory
    memory.state._head[0] = memory.state.sequence + 1
    with pytest.raises(UnavailableError, match="no consistent state in 100 reads; rtloop may have died"):
        asyncio.run(link.await_fresh_state(0.0))
    link.close()


@pytest.mark.parametrize("block", ["io", "device", "cell", "info"])
def test_what_rtloop_writes_just_now_is_read_again_and_not_missing(
    rig: Rig, monkeypatch: pytest.MonkeyPatch, block: str
) -> None:
    """A client got a 503 for inputs and outputs whose report was being written. The counter is odd meanwhile,
    as it is for a writer that the computer has interrupted.
    """
    rig.step(10)
    link = attached(rig)
    memory = link.memory
    for each in (memory.io, memory.device, memory.cell, memory.info):
        if each.sequence == 0:
            each.publish()
    before = {"io": link.io(), "device": link.device(), "cell": link.cell(), "info": link.tool_version}
    written = getattr(memory, block)
    written._head[0] = written.sequence + 1
    pauses = []

    def pause(seconds: float) -> None:
        pauses.append(seconds)
        if len(pauses) == 5:
            written._head[0] = written.sequence + 1

    monkeypatch.setattr(time, "sleep", pause)
    after = {"io": link.io(), "device": link.device(), "cell": link.cell(), "info": link.tool_version}
    assert len(pauses) == 5
    assert before[block] is not None
    assert after == before
    link.close()


def test_a_service_stops_the_motion_that_it_finds_under_way(rig: Rig, robot: RobotDescription) -> None:
    """Restarted so quickly that nobody has missed it, it would have the arm go on for who has lost it."""
    goal = rig.home + 0.3
    motion = plan_ptp(robot, MotionRequest(rig.home, goal, PlannerName.PTP, Scaling(0.1)), goal)
    assert rig.start(motion) == ""
    rig.step(300)
    link = attached(rig)
    rig.run()
    assert (rig.mode, rig.reason) == (LoopMode.HOLD, "stop requested")
    assert np.abs(rig.commanded[-1] - goal).max() > 0.1
    link.close()


def test_what_was_spoilt_makes_no_fast_stop_of_the_next_stop(rig: Rig) -> None:
    """The counter of fast stops is known to nobody then. A real one is one still."""
    rig.step(10)
    link = attached(rig)
    link.request_stop(fast=True)
    rig.run()
    assert rig.mode is LoopMode.ESTOP
    assert rig.answer(rig.send(Command.RESET, stops=link.stops)) == ""
    spoil(rig.memory, "requests", np.random.default_rng(3))
    link.close()
    link = attached(rig)
    link.request_stop()
    rig.step(5)
    assert rig.mode is LoopMode.HOLD
    link.request_stop(fast=True)
    rig.run()
    assert rig.mode is LoopMode.ESTOP
    link.close()
