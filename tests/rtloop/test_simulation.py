"""The whole loop on MuJoCo's dynamics.

Oracle: MuJoCo integrates the arm's true motion under the torques; pinocchio's is compared in tests/cobot.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from rig import Rig

from cobot.config import Settings
from cobot.layout import MotionResult
from cobot.planners.ptp import plan_ptp
from cobot.planners.request import MotionRequest
from cobot.robot import Robot
from cobot.types import Mode, PlannerName, Scaling

GOALS = np.array([[1.2, 0.7, -0.4, -1.2, 0.6, 1.0, -1.0], [-1.0, -0.3, 0.5, -2.0, -0.5, 0.4, 0.8]])


@pytest.fixture
def rig(settings: Settings, robot: Robot) -> Iterator[Rig]:
    made = Rig(settings, robot, simulated=True)
    yield made
    made.close()


def measured_along(rig: Rig, goal: np.ndarray, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Measured and commanded positions during a motion."""
    here = rig.loop.controller.safety.position.copy()
    request = MotionRequest(here, goal, PlannerName.PTP, Scaling(speed))
    assert rig.start(plan_ptp(rig.robot, request, goal)) == ""
    rows = []
    while rig.loop.controller.moving:
        rig.step()
        rows.append((rig.memory.state.data["position"].copy(), rig.commanded[-1]))
    measured, commanded = np.array(rows).transpose(1, 0, 2)
    return measured, commanded


@pytest.mark.parametrize("speed", [0.2, 1.0])
def test_the_arm_follows_within_a_milliradian(rig: Rig, speed: float) -> None:
    for goal in GOALS:
        measured, commanded = measured_along(rig, goal, speed)
        assert rig.result is MotionResult.ARRIVED
        assert np.abs(measured - commanded).max() < 1e-3
        np.testing.assert_allclose(measured[-1], goal, atol=rig.settings.rt.settle_position_rad)
    assert sum(rig.interventions) == 0


def test_the_same_commands_give_the_same_motion_bit_for_bit(settings: Settings, robot: Robot) -> None:
    runs = []
    for _ in range(2):
        rig = Rig(settings, robot, simulated=True)
        runs.append(measured_along(rig, GOALS[0], 0.7)[0])
        rig.close()
    np.testing.assert_array_equal(runs[0], runs[1])


def test_effort_keeps_its_limits_when_the_arm_is_pushed(rig: Rig, robot: Robot) -> None:
    rig.simulation._data.qfrc_applied[1] = 1000.0  # far beyond the 320 N·m of the drive
    efforts = []
    for _ in range(300):
        rig.step()
        efforts.append(rig.memory.state.data["effort"].copy())
    assert (np.abs(efforts) <= robot.limits.max_effort).all()
    assert np.abs(efforts).max(axis=0)[1] == robot.limits.max_effort[1]
    assert rig.mode is Mode.FAULT
    assert rig.reason.startswith("joint2 is ")


def test_holding_needs_the_gravity_torques(rig: Rig, robot: Robot) -> None:
    rig.step(200)
    state = rig.memory.state.read()
    np.testing.assert_allclose(state["effort"], robot.model.gravity_torques(rig.home), atol=0.05)
    assert int(state["settled"]) == 1


def test_the_simulation_continues_where_a_dead_rtloop_has_left_it(
    rig: Rig, settings: Settings, robot: Robot
) -> None:
    measured_along(rig, GOALS[0], 0.5)
    left = rig.memory.state.read()["position"].copy()
    successor = Rig(settings, robot, simulated=True, memory=rig.memory)
    np.testing.assert_array_equal(successor.simulation._position, left)
    successor.step(200)
    np.testing.assert_allclose(successor.memory.state.data["position"], left, atol=1e-4)
