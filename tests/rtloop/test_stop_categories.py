"""Stops of category 1: as fast as the limits permit, then the drives go off, until a reset.

Oracle: the limits, by differences of what was commanded; the arm, which keeps whether its drives are on.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hardware_arm import HardwareArm
from paced_arm import PacedArm
from rig import Rig

from cobot.config import Settings
from cobot.ipc.device_record import DeviceReport, device_of
from cobot.ipc.layout import Command, MotionResult
from cobot.planners import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import RobotDescription
from cobot.types import LoopMode, PlannerName, Scaling

AWAY = np.array([1.2, -0.4, 0.3, 0.5, -0.4, -0.3, 0.6])


class Stage:
    """A rig with an arm of its own."""

    def __init__(
        self, settings: Settings, robot: RobotDescription, kind: type[HardwareArm | PacedArm]
    ) -> None:
        self.arm = kind(settings, robot.limits)
        self.rig = Rig(settings, robot, backend=self.arm)

    def move(self) -> None:
        rig = self.rig
        here = rig.loop.controller.safety.position.copy()
        request = MotionRequest(here, here + AWAY, PlannerName.PTP, Scaling(1.0))
        assert rig.start(plan_ptp(rig.robot, request, here + AWAY)) == ""

    def fast_stop(self) -> None:
        requests = self.rig.memory.requests.data
        requests["stops"] += 1
        requests["fast_stops"] += 1
        self.rig.memory.requests.publish()

    def cycles_to_rest(self) -> int:
        rig = self.rig
        for cycle in range(5000):
            rig.step()
            if not rig.loop.controller.safety.velocity.any():
                return cycle
        raise AssertionError("it goes on")

    def device(self) -> DeviceReport:
        assert self.rig.memory.device.try_read()
        return device_of(self.rig.memory.device.data)

    def reset(self) -> str:
        return self.rig.answer(self.rig.send(Command.RESET))


@pytest.fixture
def stage(settings: Settings, robot: RobotDescription) -> Iterator[Stage]:
    made = Stage(settings, robot, HardwareArm)
    yield made
    made.rig.close()


@pytest.mark.parametrize("cycles", [60, 150, 300, 600])
def test_a_fast_stop_is_within_the_limits_and_no_slower_than_one_on_the_path(
    stage: Stage, cycles: int
) -> None:
    rig = stage.rig
    stage.move()
    rig.step(cycles)
    rig.request()
    on_the_path = stage.cycles_to_rest()
    rig.run()
    stage.move()
    rig.step(cycles)
    stage.fast_stop()
    assert stage.cycles_to_rest() <= on_the_path
    rig.step(3000)
    assert (rig.mode, rig.reason) == (LoopMode.ESTOP, "fast stop requested")
    assert rig.result is MotionResult.FAILED
    for rate in rig.rates():
        assert rate.max() <= 1.01


def test_a_fast_stop_is_faster_where_the_path_bends(stage: Stage) -> None:
    """While it speeds up: on the path the acceleration of all joints has to be taken back at one rate."""
    rig, ends = stage.rig, []
    for stop in (rig.request, stage.fast_stop):
        stage.move()
        rig.step(100)
        stop()
        ends.append(stage.cycles_to_rest())
        rig.run() if rig.mode is not LoopMode.ESTOP else None
    assert ends[1] < ends[0]


def test_the_drives_go_off_once_the_arm_rests_and_on_with_a_reset(stage: Stage) -> None:
    rig, arm = stage.rig, stage.arm
    assert isinstance(arm, HardwareArm)
    stage.move()
    rig.step(300)
    stage.fast_stop()
    stage.cycles_to_rest()
    assert arm.drives_on, "they hold the arm until it has settled"
    rig.step(1000)
    assert not arm.drives_on
    assert stage.device().drives_off
    assert rig.mode is LoopMode.ESTOP
    arm._position += 0.01  # it sags, or somebody pushes it
    rig.step(100)
    written = len(arm.commands)
    assert stage.reset() == ""
    assert arm.drives_on
    rig.step(100)
    assert (rig.mode, rig.reason, stage.device().drives_off) == (LoopMode.HOLD, "", False)
    held = np.array(arm.commands[written:])[:, 0]
    assert np.abs(held - held[0]).max() < 1e-12, "no jump"
    assert np.abs(held[0] - arm._position).max() < 1e-12
    stage.move()
    rig.run()
    assert rig.result is MotionResult.ARRIVED


def test_at_rest_the_drives_go_off_too_and_in_a_fault(stage: Stage) -> None:
    rig, arm = stage.rig, stage.arm
    assert isinstance(arm, HardwareArm)
    for prepare in (lambda: None, lambda: rig.loop.controller.fault("hot")):
        prepare()
        stage.fast_stop()
        rig.step(3000)
        assert not arm.drives_on
        assert rig.mode is LoopMode.ESTOP
        assert stage.reset() == ""


def test_drives_that_do_not_go_off_are_said_and_the_arm_is_held(stage: Stage) -> None:
    rig, arm = stage.rig, stage.arm
    assert isinstance(arm, HardwareArm)
    arm.refuses = "contactor K1 sticks"
    stage.fast_stop()
    rig.step(3000)
    assert rig.reason == "fast stop requested; the drives could not be switched off: contactor K1 sticks"
    assert not stage.device().drives_off
    assert arm.drives_on
    assert arm.calls.count("disable") == 1, "it is asked once"


def test_a_stream_ends_and_the_drives_go_off(stage: Stage) -> None:
    rig = stage.rig
    assert rig.stream(stiffness=0.0, cartesian_stiffness=0.0) == ""
    rig.aim(joints=rig.home + 0.05)
    rig.step(200)
    stage.fast_stop()
    rig.step(3000)
    assert stage.device().drives_off
    for rate in rig.rates():
        assert rate.max() <= 1.01


def test_a_device_that_wants_its_packets_answered_gets_where_it_is(
    settings: Settings, robot: RobotDescription
) -> None:
    stage = Stage(settings, robot, PacedArm)
    try:
        stage.fast_stop()
        stage.rig.step(3000)
        assert stage.device().drives_off
        assert isinstance(stage.arm, PacedArm)
        assert len(stage.arm.written) == 3000
        assert stage.reset() == ""
    finally:
        stage.rig.close()


def test_drives_that_are_off_stay_off_when_rtloop_is_restarted(
    settings: Settings, robot: RobotDescription, stage: Stage
) -> None:
    stage.fast_stop()
    stage.rig.step(3000)
    arm = HardwareArm(settings, robot.limits)
    again = Rig(settings, robot, backend=arm, memory=stage.rig.memory)
    again.step(100)
    assert not arm.drives_on
    assert again.mode is LoopMode.ESTOP
    assert again.answer(again.send(Command.RESET)) == ""
    assert arm.drives_on
