"""The backend in the real cycle, against a CRX that nobody here wrote.

Oracle: `FakeCRXController` of airo-fanuc, strict: it lags as a real CRX was measured to, and any byte, number
or time of a command that a real controller would not have is a violation. The test gives it its beat.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from crx_arm import CRX_RT
from rig import Rig

from cobot.config import Settings
from cobot.ipc.layout import Command, MotionResult
from cobot.planners import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import load_robot
from cobot.types import Array, LoopMode, PlannerName, Scaling
from rtloop.backends.fanuc import FanucBackend
from rtloop.backends.fanuc.stream import UdpClient

testing = pytest.importorskip("airo_fanuc.testing", reason="airo-fanuc is not installed")
START_DEG = [10.0, 25.0, -30.0, 5.0, -40.0, 15.0]
MAX_CYCLES = 6000
REPLY_S = 0.01
"""Time in which a packet has come from the fake's socket to ours, once it was sent."""


class TickingChannel(UdpClient):
    """The socket to the fake: each wait is a period of its."""

    def __init__(self, fake: Any) -> None:
        super().__init__("127.0.0.1", fake.sm_port)
        self._fake = fake

    def receive(self, timeout_s: float) -> list[bytes]:
        self._fake.tick()
        return super().receive(REPLY_S)


class CrxRig(Rig):
    """A rig whose cycles are the fake's states."""

    def __init__(self, fake: Any, settings: Settings) -> None:
        self.fake = fake
        robot = load_robot(settings)
        self.driver = FanucBackend(
            settings, robot.limits, channel=TickingChannel(fake), clock=fake.clock.now, sleep=time.sleep
        )
        super().__init__(settings, robot, backend=self.driver)

    def step(self, cycles: int = 1, late_ns: int = 0) -> None:
        for _ in range(cycles):
            self.loop.beat()
            super().step()

    def until(self, happened: Callable[[], bool]) -> None:
        for _ in range(MAX_CYCLES):
            if happened():
                return
            self.step()
        raise AssertionError(f"did not happen in {MAX_CYCLES} cycles: {self.mode.name}, {self.reason}")

    def begin(self, goal: Array) -> None:
        here = self.loop.controller.safety.position.copy()
        request = MotionRequest(here, goal, PlannerName.PTP, Scaling(1.0))
        assert self.start(plan_ptp(self.robot, request, goal)) == ""

    def move(self, goal: Array) -> None:
        self.begin(goal)
        self.until(lambda: self.result is MotionResult.ARRIVED)

    def recover(self) -> None:
        """As after a fault: somebody resets, as often as it takes."""
        for _ in range(40):
            self.send(Command.RESET)
            for _ in range(200):
                self.step()
                if self.mode is LoopMode.HOLD:
                    return
        raise AssertionError(f"does not recover: {self.mode.name}, {self.reason}")


@pytest.fixture(params=[3, 4])
def fake(request: pytest.FixtureRequest) -> Iterator[Any]:
    """Of either version, with a number of instructions that an earlier session has left."""
    config = testing.FakeCRXConfig(strict=True, available_version=request.param, seq_seed=7)
    with testing.FakeCRXController(config, initial_q_deg=START_DEG) as started:
        yield started


@pytest.fixture
def rig(fake: Any, made: Callable[..., Settings]) -> Iterator[CrxRig]:
    """The fake has no limits table."""
    ports = {"rmi_port": fake.rmi_port, "stream_port": fake.sm_port}
    settings = made(address="127.0.0.1", limits="model", **ports)
    settings = settings.model_copy(update={"rt": settings.rt.model_copy(update=CRX_RT)})
    started = CrxRig(fake, settings)
    try:
        started.step(5)
        yield started
        started.loop.close()
        fake.tick()
        assert fake.violations == []
    finally:
        started.close()


def test_it_begins_where_the_arm_is_and_moves_it(rig: CrxRig) -> None:
    assert rig.mode is LoopMode.HOLD
    np.testing.assert_allclose(np.degrees(rig.loop.controller.safety.position), START_DEG, atol=1e-4)
    assert not rig.driver._units.horizon
    goal = np.radians([-20.0, 10.0, -10.0, 20.0, -60.0, 40.0])
    rig.move(goal)
    rig.step(100)  # the fake lags by 0.125 s
    np.testing.assert_allclose(rig.fake.q_meas_deg[:6], np.degrees(goal), atol=0.02)
    assert rig.fake.plant.watchdog_tripped is False


def test_an_emergency_stop_is_a_fault_and_a_reset_recovers(rig: CrxRig) -> None:
    rig.begin(np.radians([60.0, 10.0, -10.0, 20.0, -60.0, 40.0]))
    rig.step(60)
    rig.fake.press_estop()
    rig.until(lambda: rig.mode is LoopMode.FAULT)
    assert "an emergency stop is pressed" in rig.reason
    rig.step(100)
    rig.send(Command.RESET)
    rig.step(100)
    assert rig.mode is LoopMode.FAULT
    rig.fake.release_estop()
    rig.step(10)
    rig.recover()
    rig.move(np.radians(START_DEG))
    rig.step(100)
    np.testing.assert_allclose(rig.fake.q_meas_deg[:6], START_DEG, atol=0.02)


@pytest.mark.parametrize(
    ("alarm", "said"),
    [(("SRVO-023", "Stop error excess (J2)"), "an alarm"), (("SYST-348", "Payload monitor"), "an alarm")],
)
def test_an_alarm_is_said(rig: CrxRig, alarm: tuple[str, str], said: str) -> None:
    rig.fake.inject_alarm(*alarm)
    rig.until(lambda: rig.mode is LoopMode.FAULT)
    assert said in rig.reason
    deadline_s = time.monotonic() + 10.0
    while alarm[0] not in rig.driver.status().text:
        assert time.monotonic() < deadline_s
        rig.step()
    rig.step(100)
    rig.recover()


def test_packets_that_are_lost_skipped_or_come_twice_do_no_harm(rig: CrxRig) -> None:
    rig.begin(np.radians([-20.0, 25.0, -30.0, 5.0, -40.0, 15.0]))
    for turn in range(30):
        rig.step(5)
        (rig.fake.drop_status, rig.fake.inject_seq_gap, lambda: rig.fake.duplicate_next_status())[turn % 3]()
    rig.until(lambda: rig.result is MotionResult.ARRIVED)
    rig.step(100)
    assert rig.fake.q_meas_deg[0] == pytest.approx(-20.0, abs=0.02)
    assert rig.driver.status().packets_lost >= 10


def test_the_collaborative_speed_clamp_slows_the_motion(rig: CrxRig) -> None:
    rig.fake.set_safety_scale(0.2)
    rig.step(20)
    rig.begin(np.radians([40.0, 25.0, -30.0, 5.0, -40.0, 15.0]))
    rig.step(150)
    slow = np.abs(rig.fake.qd_meas_deg_s).max()
    rig.fake.set_safety_scale(1.0)
    rig.until(lambda: rig.result is MotionResult.ARRIVED)
    assert 0.0 < slow < 0.25 * 120.0


def test_a_contact_stop_is_said(rig: CrxRig) -> None:
    rig.fake.set_contact_stop(2)
    rig.until(lambda: rig.mode is LoopMode.FAULT)
    assert "the collaborative robot has stopped at a contact" in rig.reason
    rig.step(100)
    rig.fake.set_contact_stop(1)
    rig.step(10)
    rig.recover()
