"""Parts of streaming that need no network: sessions on the stepped cycle, the tick, the log, states as JSON.

Oracle: the cycle itself (tests/support/rig.py); the standard library's JSON parser with its extensions
switched off.
"""

from __future__ import annotations

import asyncio
import json
import logging
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from rig import Rig

from app.api.stream_frames import SessionFrame, state_frame
from app.services.motion.execution import MotionService
from app.services.motion.planning import PlanningService
from app.services.rights.ownership import Ownership
from app.services.state.interventions import InterventionLog
from app.services.state.link import RobotLink
from app.services.streaming.sessions import StreamService
from cobot.errors import ConflictError, ExecutionError, InputError, NotReadyError, UnavailableError
from cobot.ipc.layout import Interpolation, Intervention, Stream, chunk_dtype, setpoint_dtype
from cobot.ipc.session_rules import nominal_session
from cobot.ipc.state_fields import state_dtype
from cobot.robot.description import RobotDescription
from cobot.ticker import Ticker
from cobot.types import LoopMode

NAME = "WS test"


@pytest.fixture
def link(rig: Rig) -> Iterator[RobotLink]:
    rig.step(30)
    made = RobotLink(rig.memory.path.name.removeprefix("cobot-"), 60.0)
    yield made
    made.close()


@pytest.fixture
def streams(rig: Rig, link: RobotLink, robot: RobotDescription) -> Iterator[StreamService]:
    planning = PlanningService(None, 1)
    ownership = Ownership(link)
    motion = MotionService(robot, link, planning)
    section = rig.settings.streaming.model_copy(update={"command_timeout_s": 0.05})
    made = StreamService(link, ownership, motion, section)
    rig.describe()
    yield made
    made.close()
    planning.close()


def test_what_rtloop_drives_is_heard_of_when_it_says_so(rig: Rig, streams: StreamService) -> None:
    """The service may have begun before: until then a session is refused, not divided by a period of 0."""
    with pytest.raises(NotReadyError, match="has not reported its robot yet"):
        SessionFrame(type="session").record(streams.info)
    info = rig.memory.info
    info.data["period_s"], info.data["stiffness"] = 0.002, 400.0
    info.publish()
    assert float(streams.info["period_s"]) == 0.002
    assert SessionFrame(type="session").record(streams.info)["stiffness"].tolist() == [400.0] * 7


def request(streams: StreamService, **values: Any) -> np.ndarray:
    made = nominal_session(streams.info)
    made["stream"], made["interpolation"], made["decimation"] = (
        Stream.JOINT_IMPEDANCE,
        Interpolation.LINEAR,
        10,
    )
    for name, value in values.items():
        made[name] = value
    return made


async def stepping(rig: Rig, work: Any) -> Any:
    """The result of `work` while the cycle goes on."""
    task = asyncio.ensure_future(work)
    while not task.done():
        rig.step()
        await asyncio.sleep(0.0005)
    return task.result()


def test_a_session_owns_the_motion_until_the_arm_rests(rig: Rig, streams: StreamService) -> None:
    async def live() -> None:
        session = await stepping(rig, streams.open(request(streams), NAME, 1.0))
        assert streams.session is session
        assert rig.mode is LoopMode.JOINT_IMPEDANCE
        with pytest.raises(ConflictError, match="in use by WS test"):
            await streams.open(request(streams), "WS other", 1.0)
        target = np.zeros((), setpoint_dtype(7))
        target["number"], target["joints"] = 1, rig.home + 0.001
        session.take_setpoint(1, target)
        rig.step(300)
        np.testing.assert_allclose(rig.commanded[-1], rig.home + 0.001, atol=1e-5)
        session.end()
        session.end()
        reason = await stepping(rig, asyncio.wait_for(session.ended, 10.0))
        assert reason == "the client has ended the session"
        assert rig.mode is LoopMode.HOLD
        assert streams.session is None
        again = await stepping(rig, streams.open(request(streams), "WS other", 1.0))
        assert again.number == session.number + 1

    asyncio.run(live())


def test_a_wrong_or_late_target_changes_nothing(rig: Rig, streams: StreamService) -> None:
    async def live() -> None:
        session = await stepping(rig, streams.open(request(streams), NAME, 1.0))
        before = rig.memory.setpoint.sequence
        target = np.zeros((), setpoint_dtype(7))
        target["number"], target["joints"] = 1, np.nan
        with pytest.raises(InputError, match="joints must be finite"):
            session.take_setpoint(1, target)
        assert rig.memory.setpoint.sequence == before
        target["joints"] = rig.home
        session.take_setpoint(1, target)
        for sequence in (1, 0):
            with pytest.raises(InputError, match=f"{sequence} comes after 1"):
                session.take_setpoint(sequence, target)
            with pytest.raises(InputError, match=f"{sequence} comes after 1"):
                session.take_chunk(sequence, np.zeros((), chunk_dtype(7)))
        assert session.refused == 4
        assert rig.memory.setpoint.sequence == before + 2

    asyncio.run(live())


def test_rtloops_refusal_is_told_and_the_arm_stays_free(rig: Rig, streams: StreamService) -> None:
    async def live() -> None:
        with pytest.raises(ExecutionError, match="stiffness must be above 0"):
            await stepping(rig, streams.open(request(streams, stiffness=1e9), NAME, 1.0))
        with pytest.raises(InputError, match="force_axes"):
            await streams.open(request(streams, force_axes=2.0), NAME, 1.0)
        with pytest.raises(UnavailableError, match=r"rtloop has not answered for 0\.05 s"):
            await streams.open(request(streams), NAME, 0.05)
        rig.step(50)  # what was not answered for does not begin later
        assert rig.mode is LoopMode.HOLD
        await stepping(rig, streams.open(request(streams), NAME, 1.0))

    asyncio.run(live())


def test_there_is_no_session_in_estop(rig: Rig, streams: StreamService) -> None:
    rig.request("estops")
    rig.step(10)
    with pytest.raises(NotReadyError, match="e-stop requested"):
        asyncio.run(streams.open(request(streams), NAME, 1.0))


def test_a_lost_client_has_its_time_and_then_the_session_ends(rig: Rig, streams: StreamService) -> None:
    async def live() -> None:
        session = await stepping(rig, streams.open(request(streams), NAME, 1.0))
        streams.lose(session)
        assert not session.over
        assert (await stepping(rig, asyncio.wait_for(session.ended, 10.0))) == (
            "the connection to the client was lost"
        )

    asyncio.run(live())


def test_ticks_that_nobody_could_take_are_counted() -> None:
    async def live() -> None:
        ticks: list[int] = []
        ticker = Ticker(1000.0, ticks.append)
        while not ticks:
            await asyncio.sleep(0.001)
        time.sleep(0.05)  # nothing else gets its turn
        ticks.clear()
        while not ticks:
            await asyncio.sleep(0.0)
        assert ticks[0] >= 40
        ticker.close()
        await asyncio.sleep(0.01)
        ticks.clear()
        await asyncio.sleep(0.01)
        assert not ticks

    asyncio.run(live())


def test_an_intervention_is_logged_once_in_an_episode(
    rig: Rig, link: RobotLink, caplog: pytest.LogCaptureFixture
) -> None:
    seen = InterventionLog()
    state = link.state()
    state.record["interventions"][Intervention.JUMP] = 5  # before this service began
    seen.look(state)

    def jump(count: int, moment_s: float) -> None:
        state.record["interventions"][Intervention.JUMP] = count
        state.record["intervened_ns"][Intervention.JUMP] = int(moment_s * 1e9)
        seen.look(state)

    with caplog.at_level(logging.WARNING, "cobot.interventions"):
        for count, moment_s in ((6, 100.0), (7, 100.5), (8, 101.4), (8, 101.4), (9, 103.0)):
            jump(count, moment_s)
    assert [message.split(" at ")[0] for message in caplog.messages] == ["intervention jump"] * 2
    assert caplog.messages[0].endswith(", 6 so far")
    assert caplog.messages[1].endswith(", 9 so far")


def test_a_state_with_values_that_are_no_numbers_is_json_all_the_same() -> None:
    state = np.zeros((), state_dtype(7))
    state["sensor"] = [np.nan, np.inf, 1.0, 0.0, 0.0, 0.0]
    state["reason"] = "señal".encode()

    def forbidden(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    content = json.loads(state_frame(state, 3), parse_constant=forbidden)
    assert content["sensor"] == [None, None, 1.0, 0.0, 0.0, 0.0]
    assert (content["type"], content["sequence"], content["mode"]) == ("state", 3, "HOLD")
    assert content["reason"] == "señal"
