"""The first contact with hardware: slow, nothing streamed, and in words, until somebody acknowledges.

Oracle: the numbers of the arm's home position, and its own record of how fast it was told to move.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hardware_arm import HardwareArm
from rig import Rig

from cobot.config import Settings
from cobot.ipc.device_record import DeviceReport, device_of
from cobot.ipc.layout import Command, MotionResult
from cobot.planners import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import RobotDescription, load_robot
from cobot.types import Array, PlannerName, Scaling
from rtloop.device_limits import differences
from rtloop.first_contact import first_contact, place


@pytest.fixture
def rig(settings: Settings, robot: RobotDescription) -> Iterator[Rig]:
    made = Rig(settings, robot, backend=HardwareArm(settings, robot.limits), acknowledged=False)
    yield made
    made.close()


def device(rig: Rig) -> DeviceReport:
    assert rig.memory.device.try_read()
    return device_of(rig.memory.device.data)


def move(rig: Rig, goal: Array) -> float:
    """How long it takes, s."""
    here = rig.loop.controller.safety.position.copy()
    begun = len(rig.commanded)
    assert (
        rig.start(plan_ptp(rig.robot, MotionRequest(here, goal, PlannerName.PTP, Scaling(1.0)), goal)) == ""
    )
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    return float((len(rig.commanded) - begun) * rig.settings.rt.period_s)


def test_it_says_where_the_arm_is_and_what_it_carries(rig: Rig) -> None:
    found = device(rig).unacknowledged
    assert "joint4 -90.0 degrees" in found
    assert "TCP should be, seen from the base, 0.40 m in front, 0.00 m left, 0.65 m above." in found
    assert "Tool and load: never set" in found
    assert "POST /robot/acknowledge" in found
    assert "POST /robot/plan/" in found


def test_it_goes_at_a_tenth_of_the_speed_until_it_is_acknowledged(rig: Rig) -> None:
    assert device(rig).share == pytest.approx(0.1)
    goal = rig.home + 0.2
    slow_s = move(rig, goal)
    assert rig.rates()[0].max() <= 0.101
    assert rig.answer(rig.send(Command.ACKNOWLEDGE)) == ""
    assert (device(rig).share, device(rig).unacknowledged) == (1.0, "")
    fast_s = move(rig, rig.home)
    assert slow_s > 4.0 * fast_s


def test_to_acknowledge_in_a_motion_changes_its_speed_within_the_limits(rig: Rig) -> None:
    goal = rig.home + 0.5
    assert (
        rig.start(plan_ptp(rig.robot, MotionRequest(rig.home, goal, PlannerName.PTP, Scaling(1.0)), goal))
        == ""
    )
    rig.step(1000)
    assert rig.answer(rig.send(Command.ACKNOWLEDGE)) == ""
    rig.run()
    assert rig.result is MotionResult.ARRIVED
    for rate in rig.rates():
        assert rate.max() <= 1.01


def test_nothing_is_streamed_until_then(rig: Rig) -> None:
    stiff = {"stiffness": 0.0, "cartesian_stiffness": 0.0}
    assert "first contact with the robot is not acknowledged" in rig.stream(**stiff)
    rig.loop.controller.acknowledge()
    assert rig.stream(**stiff) == ""


def test_a_restart_of_rtloop_does_not_ask_again(
    settings: Settings, robot: RobotDescription, rig: Rig
) -> None:
    again = Rig(
        settings, robot, backend=HardwareArm(settings, robot.limits), memory=rig.memory, acknowledged=False
    )
    assert device(again).unacknowledged, "as long as nobody has"
    again.loop.controller.acknowledge()
    again = Rig(
        settings, robot, backend=HardwareArm(settings, robot.limits), memory=rig.memory, acknowledged=False
    )
    assert (device(again).unacknowledged, device(again).share) == ("", 1.0)


def test_a_simulation_is_met_without_words(settings: Settings, robot: RobotDescription) -> None:
    rig = Rig(settings, robot, acknowledged=False)
    try:
        assert (device(rig).unacknowledged, device(rig).share) == ("", 1.0)
    finally:
        rig.close()


def test_what_does_not_fit_the_model_is_named(robot: RobotDescription) -> None:
    position = np.array(robot.positions["home"].joints)
    position[1] = np.radians(150.0)
    found = first_contact(robot.model, position)
    assert "joint2 is outside the model's range of -120.3 degrees to 120.3 degrees" in found
    assert place(np.array([-0.1, -0.2, -0.3])) == "0.10 m behind, 0.20 m right, 0.30 m below"


def test_the_smaller_of_two_limits_counts(settings: Settings) -> None:
    """A device with half the velocity, a quarter of the acceleration: half the speed keeps both."""
    robot = load_robot(settings)
    ours = replace(robot.limits)
    arm = HardwareArm(settings, robot.limits)
    arm.limits = replace(
        ours,
        max_velocity=0.5 * ours.max_velocity,
        max_acceleration=0.25 * ours.max_acceleration,
        max_position=ours.max_position - 0.1,
    )
    assert len(differences(ours, arm.limits)) == 3 * ours.dof
    assert "max_velocity of joint1" in str(differences(ours, arm.limits))
    assert differences(arm.limits, ours) == []
    home = np.array(robot.positions["home"].joints)
    goal = home + 0.2
    plan = plan_ptp(robot, MotionRequest(home, goal, PlannerName.PTP, Scaling(1.0)), goal)  # as fast as ours
    rig = Rig(settings, robot, backend=arm)
    try:
        assert device(rig).share == pytest.approx(0.5)
        assert rig.start(plan) == ""
        rig.run()
        assert rig.result is MotionResult.ARRIVED
        for rate in rig.rates():
            assert rate.max() <= 1.01
        assert rig.limits.max_position[0] == pytest.approx(ours.max_position[0] - 0.1)
    finally:
        rig.close()
