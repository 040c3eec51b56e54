"""A reset in steps: each packet is answered meanwhile, and the arm goes on from where it is, without a jump.

Oracle: the device, which counts packets and steps, and keeps what it was told.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from rig import Rig
from stepwise_arm import STEPS, StepwiseArm

from cobot.config import Settings
from cobot.ipc.layout import Command, MotionResult
from cobot.planners import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import RobotDescription
from cobot.types import LoopMode, PlannerName, Scaling


@pytest.fixture
def arm(settings: Settings, robot: RobotDescription) -> StepwiseArm:
    return StepwiseArm(settings, robot.limits)


@pytest.fixture
def rig(settings: Settings, robot: RobotDescription, arm: StepwiseArm) -> Iterator[Rig]:
    made = Rig(settings, robot, backend=arm)
    yield made
    made.close()


def failed(rig: Rig, arm: StepwiseArm) -> None:
    """In a fault, somewhere else than it was commanded to be."""
    rig.loop.controller.fault("drive 3 is hot")
    arm.enabled = False
    rig.step(10)
    arm._position += 0.02
    rig.step(10)
    assert rig.mode is LoopMode.FAULT


def test_each_packet_is_answered_with_where_the_arm_is(rig: Rig, arm: StepwiseArm) -> None:
    failed(rig, arm)
    begun = len(arm.written)
    assert rig.answer(rig.send(Command.RESET)) == ""
    assert rig.mode is LoopMode.HOLD
    assert [what for what, _ in arm.steps] == ["recover"] * STEPS + ["enable"] * STEPS
    answered = [packets for _, packets in arm.steps]
    assert np.diff(answered).tolist() == [1] * (2 * STEPS - 1), "one packet for each step"
    told = np.array(arm.written[begun + 2 :])
    assert np.abs(told - arm._position).max() < 1e-12, "no jump"
    here = rig.loop.controller.safety.position.copy()
    goal = here + 0.1
    request = MotionRequest(here, goal, PlannerName.PTP, Scaling(1.0))
    assert rig.start(plan_ptp(rig.robot, request, goal)) == ""
    rig.run()
    assert rig.result is MotionResult.ARRIVED


def test_why_it_cannot_be_enabled_is_said_and_it_may_be_tried_again(rig: Rig, arm: StepwiseArm) -> None:
    failed(rig, arm)
    arm.refuses = "the enabling switch is not pressed"
    assert rig.answer(rig.send(Command.RESET)) == (
        "the robot cannot be enabled: the enabling switch is not pressed"
    )
    assert rig.mode is LoopMode.FAULT
    arm.refuses = ""
    assert rig.answer(rig.send(Command.RESET)) == ""
    assert rig.mode is LoopMode.HOLD


def test_a_stop_meanwhile_ends_it(rig: Rig, arm: StepwiseArm) -> None:
    failed(rig, arm)
    reset = rig.send(Command.RESET)
    rig.step(5)
    rig.request()
    assert rig.answer(reset) == "a stop has been requested in the meantime"
    rig.step(200)
    assert rig.mode is LoopMode.FAULT
    assert not arm.enabled


@pytest.mark.parametrize("latched", ["a fault", "an e-stop"])
@pytest.mark.parametrize("outside", [False, True])
def test_an_estop_meanwhile_ends_it(rig: Rig, arm: StepwiseArm, latched: str, outside: bool) -> None:
    """Also where one is latched already, and whoever asks for it: the service, or `cobot stop --estop`."""
    failed(rig, arm)
    if latched == "an e-stop":
        rig.request("estops")
        rig.step(10)
    reset = rig.send(Command.RESET)
    rig.step(5)
    assert arm.steps
    if outside:
        rig.memory.outside_estops.add()
    else:
        rig.request("estops")
    assert rig.answer(reset) == "a stop has been requested in the meantime"
    rig.step(200)
    assert rig.mode is LoopMode.ESTOP
    assert not arm.enabled
