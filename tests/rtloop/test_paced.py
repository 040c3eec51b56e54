"""A device that gives the beat: the path goes on with its packets, and no packet's command jumps.

Oracle: the device itself, which keeps what it was told; nothing in here goes by the computer's clock.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from paced_arm import PacedArm
from rig import Rig

from cobot.config import Settings
from cobot.ipc.device_record import device_of
from cobot.ipc.layout import Command, MotionResult
from cobot.planners import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import RobotDescription
from cobot.robot.device import DeviceStatus
from cobot.strict import shown
from cobot.types import LoopMode, PlannerName, Scaling


class PacedRig(Rig):
    """A rig whose cycles are the device's packets."""

    def __init__(self, settings: Settings, robot: RobotDescription) -> None:
        self.arm = PacedArm(settings, robot.limits)
        super().__init__(settings, robot, backend=self.arm)

    def step(self, cycles: int = 1, late_ns: int = 0) -> None:
        for _ in range(cycles):
            self.loop.beat()
            super().step()

    def reset(self) -> str:
        return self.answer(self.send(Command.RESET))

    def move(self) -> str:
        goal = self.home + np.array([0.3, -0.2, 0.1, 0.2, -0.1, 0.2, 0.3])
        request = MotionRequest(self.home, goal, PlannerName.PTP, Scaling(1.0))
        return self.start(plan_ptp(self.robot, request, goal))

    def told(self) -> DeviceStatus:
        assert self.memory.device.try_read()
        status = device_of(self.memory.device.data).status
        assert status is not None
        return status


@pytest.fixture
def rig(settings: Settings, robot: RobotDescription) -> Iterator[PacedRig]:
    rig = PacedRig(settings, robot)
    yield rig
    rig.close()


def rates_on_the_wire(rig: PacedRig) -> list[float]:
    """Velocity, acceleration and jerk from packet to packet, as shares of the limits."""
    positions, period_s, limits = np.array(rig.arm.written), rig.settings.rt.period_s, rig.limits
    bounds = limits.max_velocity, limits.max_acceleration, limits.max_jerk
    return [
        float((np.abs(np.diff(positions, order, axis=0)) / period_s**order / bound).max())
        for order, bound in enumerate(bounds, start=1)
    ]


def test_a_packet_is_a_cycle(rig: PacedRig) -> None:
    rig.step(50)
    assert len(rig.arm.written) == 50
    assert set(rig.arm.waited_s) == {1.5 * rig.settings.rt.period_s}
    assert rig.told() == rig.arm.report


def test_a_move_under_five_per_cent_loss_arrives_within_the_limits_on_the_wire(rig: PacedRig) -> None:
    seed = 15
    lost = np.random.default_rng(seed).random(100_000) < 0.05
    assert rig.move() == ""
    rig.arm.beats = iter((~lost).tolist())
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    assert all(rate <= 1.0 + 1e-6 for rate in rates_on_the_wire(rig)), f"seed {seed}"
    assert rig.loop.controller.commands.command_seen > 0
    assert rig.settings.rt.period_s in rig.arm.waited_s, "after a lost packet the next is due in a period"


def test_silence_is_a_fault_and_the_arm_goes_on_from_where_it_is(rig: PacedRig) -> None:
    assert rig.move() == ""
    rig.step(300)
    written = len(rig.arm.written)
    silent = 500
    rig.arm.beats = itertools.repeat(False, silent)
    rig.step(silent)
    assert rig.mode is LoopMode.FAULT
    assert rig.reason == "no packet from the robot, which clocks the cycle, for 0.020 s"
    assert len(rig.arm.written) == written, "nothing is written without a beat"
    rig.step(3000)
    stayed = np.array(rig.arm.written[written:])
    assert np.abs(stayed - rig.arm.written[written - 1]).max() < 1e-12, "no jump at re-entry"
    assert rig.reset() == ""
    rig.step(10)
    assert rig.mode is LoopMode.HOLD


def test_a_connection_that_is_gone_is_a_fault_with_its_reason(rig: PacedRig) -> None:
    rig.step(10)
    rig.arm.gone = "no route to 192.0.2.1"
    rig.step(3)
    assert rig.mode is LoopMode.FAULT
    assert rig.reason == "no packets from the robot, which clocks the cycle: no route to 192.0.2.1"
    rig.arm.gone = ""
    rig.step(10)
    assert rig.reset() == ""


def test_a_few_lost_packets_are_no_fault(rig: PacedRig) -> None:
    assert rig.move() == ""
    rig.step(300)
    rig.arm.beats = itertools.repeat(False, rig.settings.rt.overruns_to_stop - 1)
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    assert all(rate <= 1.0 + 1e-6 for rate in rates_on_the_wire(rig))


def test_the_path_follows_the_speed_override_of_the_device(rig: PacedRig) -> None:
    rig.arm.report = DeviceStatus(operation_mode="T1", speed_scaling=0.25, text="by hand")
    rig.step(300)
    assert rig.told().speed_scaling == 0.25
    assert rig.move() == ""
    rig.step(500)
    assert rig.loop.controller.clock.rate == 0.25
    rig.arm.report = DeviceStatus(speed_scaling=1.0)
    rig.step(2000)
    assert rig.loop.controller.clock.rate == 1.0
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    assert all(rate <= 1.0 + 1e-6 for rate in rates_on_the_wire(rig))


def test_words_that_are_too_long_are_cut(rig: PacedRig) -> None:
    rig.arm.report = DeviceStatus(text="ü" * 1000, device_time_s=12.5)
    rig.step(300)
    assert rig.told().text == "ü" * 200
    assert rig.told().device_time_s == 12.5


@pytest.mark.parametrize("scaling", [float("nan"), float("inf"), -0.5, "half", None])
def test_a_speed_override_that_is_none_is_a_fault_with_its_value(rig: PacedRig, scaling: object) -> None:
    assert rig.move() == ""
    rig.step(300)
    rig.arm.report = replace(rig.arm.report, speed_scaling=scaling)
    rig.step(300)
    assert rig.mode is LoopMode.FAULT
    said = f"the backend's status().speed_scaling is {shown(scaling)}; it must be a number of 0 or more"
    assert rig.reason == said
    assert rig.told().speed_scaling == 1.0, "what it said before"
    rig.arm.report = replace(rig.arm.report, speed_scaling=np.float32(0.5))
    rig.run()
    rig.step(300)
    assert rig.reset() == ""
    assert rig.told().speed_scaling == 0.5


def test_contact_limits_need_a_device_that_measures_forces(rig: PacedRig) -> None:
    rigid = {"stiffness": 0.0, "cartesian_stiffness": 0.0}
    for wish, row in (("max_contact_torque", "external_effort"), ("max_contact_wrench", "wrench")):
        assert (
            f"{wish} needs {row}, which the backend mujoco does not measure; it measures position, velocity"
            in rig.stream(**rigid, **{wish: 5.0})
        )
    assert "a stiffness needs impedance control, which the backend mujoco does not have" in rig.stream()
    assert rig.stream(**rigid) == ""
