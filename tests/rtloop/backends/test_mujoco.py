"""The whole loop on MuJoCo's dynamics, and the faults that the simulated device can have.

Oracle: MuJoCo integrates the arm's true motion under the torques; pinocchio's is compared in tests/cobot.
How the arm gives way and feels is in test_impedance.py.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from independent_models import MJCF
from rig import Rig

from cobot.config import Settings
from cobot.ipc.layout import MotionResult
from cobot.motions.requests import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import RobotDescription
from cobot.types import LoopMode, PlannerName, Scaling
from rtloop.backends import BackendError, Measured
from rtloop.backends.mujoco import MujocoBackend

GOALS = np.array([[1.2, 0.7, -0.4, -1.2, 0.6, 1.0, -1.0], [-1.0, -0.3, 0.5, -2.0, -0.5, 0.4, 0.8]])


@pytest.fixture
def rig(settings: Settings, robot: RobotDescription) -> Iterator[Rig]:
    made = Rig(settings, robot, simulated=True)
    yield made
    made.close()


@pytest.fixture
def backend(settings: Settings, robot: RobotDescription) -> MujocoBackend:
    """One that has been opened at home."""
    made = MujocoBackend(settings, robot.limits)
    made.open(np.array(robot.positions["home"].joints))
    return made


def held(backend: MujocoBackend, robot: RobotDescription, cycles: int = 1) -> Measured:
    """What is measured after some cycles at home."""
    measured = Measured(robot.limits.dof)
    command = np.zeros((3, robot.limits.dof))
    command[0] = robot.positions["home"].joints
    for _ in range(cycles):
        backend.write(command)
    backend.read(measured)
    return measured


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


def test_the_same_commands_give_the_same_motion_bit_for_bit(
    settings: Settings, robot: RobotDescription
) -> None:
    runs = []
    for _ in range(2):
        rig = Rig(settings, robot, simulated=True)
        runs.append(measured_along(rig, GOALS[0], 0.7)[0])
        rig.close()
    np.testing.assert_array_equal(runs[0], runs[1])


def test_effort_keeps_its_limits_when_the_arm_is_pushed(rig: Rig, robot: RobotDescription) -> None:
    rig.simulation._data.qfrc_applied[1] = 1000.0  # far beyond the 320 N·m of the drive
    efforts = []
    for _ in range(300):
        rig.step()
        efforts.append(rig.memory.state.data["effort"].copy())
    assert (np.abs(efforts) <= robot.limits.max_effort).all()
    assert np.abs(efforts).max(axis=0)[1] == robot.limits.max_effort[1]
    assert rig.mode is LoopMode.FAULT
    assert rig.reason.startswith("joint2 is ")


def test_holding_needs_the_gravity_torques(rig: Rig, robot: RobotDescription) -> None:
    rig.step(200)
    state = rig.memory.state.read()
    np.testing.assert_allclose(state["effort"], robot.model.gravity_torques(rig.home), atol=0.05)
    assert int(state["settled"]) == 1


def test_the_simulation_continues_where_a_dead_rtloop_has_left_it(
    rig: Rig, settings: Settings, robot: RobotDescription
) -> None:
    measured_along(rig, GOALS[0], 0.5)
    left = rig.memory.state.read()["position"].copy()
    successor = Rig(settings, robot, simulated=True, memory=rig.memory)
    np.testing.assert_array_equal(successor.simulation._position, left)
    successor.step(200)
    np.testing.assert_allclose(successor.memory.state.data["position"], left, atol=1e-4)


def test_what_was_asked_of_a_drive_is_reported_beside_what_it_gave(
    backend: MujocoBackend, robot: RobotDescription
) -> None:
    backend._data.qfrc_applied[1] = 1000.0  # far beyond the 320 N·m of the drive
    measured = held(backend, robot, 60)
    assert measured.effort[1] == -robot.limits.max_effort[1]
    assert measured.desired_effort[1] < -robot.limits.max_effort[1]
    assert measured.external_effort[1] == pytest.approx(1000.0, rel=0.01)


def test_a_push_moves_the_position_controlled_arm_and_ends_when_it_is_taken_away(
    backend: MujocoBackend, robot: RobotDescription
) -> None:
    rest = held(backend, robot, 100).position.copy()
    backend.push = np.array([0.0, 50.0, 0.0, 0.0, 0.0, 0.0])
    pushed = held(backend, robot, 300).position.copy()
    before, after = (robot.model.forward(joints).position for joints in (rest, pushed))
    assert 1e-3 < after[1] - before[1] < 2e-2
    backend.push[:] = 0.0
    measured = held(backend, robot, 500)
    np.testing.assert_allclose(measured.position, rest, atol=1e-4)
    np.testing.assert_allclose(measured.wrench, 0.0, atol=0.05)


def test_stale_readings_stay_while_the_arm_moves_on(backend: MujocoBackend, robot: RobotDescription) -> None:
    before = held(backend, robot).values.copy()
    backend.stale = True
    backend.push[1] = 50.0
    np.testing.assert_array_equal(held(backend, robot, 50).values, before)
    backend.stale = False
    assert np.abs(held(backend, robot).position - before[:7]).max() > 1e-3


def test_a_jump_is_an_offset_of_the_measured_position_only(
    backend: MujocoBackend, robot: RobotDescription
) -> None:
    before = held(backend, robot)
    backend.jump[2] = 0.3
    after = held(backend, robot)
    np.testing.assert_allclose(after.position - before.position, backend.jump, atol=1e-9)
    np.testing.assert_allclose(after.values[7:], before.values[7:], atol=1e-6)


def test_a_broken_torque_sensor_reports_no_number(backend: MujocoBackend, robot: RobotDescription) -> None:
    backend.not_finite = True
    measured = held(backend, robot)
    assert np.isnan(measured.effort).any()
    assert np.isfinite(measured.position).all()
    backend.not_finite = False
    assert np.isfinite(held(backend, robot).values).all()


def test_a_drive_fault_lasts_until_its_cause_is_gone(backend: MujocoBackend, robot: RobotDescription) -> None:
    backend.drive_fault = "joint3: overheated"
    for call in (backend.enable, lambda: backend.read(Measured(7))):
        with pytest.raises(BackendError, match="joint3: overheated"):
            call()
    backend.drive_fault = ""
    backend.enable()
    assert np.isfinite(held(backend, robot).values).all()


def test_reading_twice_in_a_cycle_gives_the_same(backend: MujocoBackend, robot: RobotDescription) -> None:
    backend.push[0] = 30.0
    first = held(backend, robot, 5).values.copy()
    np.testing.assert_array_equal(held(backend, robot, 0).values, first)


def test_a_model_without_a_force_torque_sensor_reports_zeros(
    settings: Settings, robot: RobotDescription, tmp_path: Path
) -> None:
    words = MJCF.read_text()
    bare = tmp_path / "bare.xml"
    bare.write_text(words[: words.index("  <sensor>")] + "</mujoco>")
    changed = settings.robot.model_copy(update={"model": bare})
    backend = MujocoBackend(settings.model_copy(update={"robot": changed}), robot.limits)
    backend.open(np.array(robot.positions["home"].joints))
    backend.push[:3] = 30.0
    measured = held(backend, robot, 100)
    np.testing.assert_array_equal(measured.sensor, np.zeros(6))
    np.testing.assert_allclose(measured.wrench[:3], 30.0, rtol=0.05)


def test_the_sensor_reads_at_the_tcp_wherever_that_is(
    settings: Settings, robot: RobotDescription, tmp_path: Path
) -> None:
    """Closed form: a force through a TCP 0.2 m in front of the flange and turned has no torque about it."""
    words = MJCF.read_text()
    site = '<site name="tcp" pos="0 0 0.045" size="0.01"/>'
    assert site in words
    tool = tmp_path / "tool.xml"
    tool.write_text(
        words.replace(site, '<site name="tcp" pos="0.05 0 0.245" quat="0.6 0 0.8 0" size="0.01"/>')
    )
    changed = settings.robot.model_copy(update={"model": tool})
    backend = MujocoBackend(settings.model_copy(update={"robot": changed}), robot.limits)
    backend.open(np.array(robot.positions["home"].joints))
    weight = held(backend, robot, 100).sensor.copy()
    backend.push = np.array([20.0, -10.0, 30.0, 0.0, 0.0, 0.0])
    felt = held(backend, robot, 500).sensor - weight
    assert np.linalg.norm(felt[:3]) == pytest.approx(np.linalg.norm(backend.push), rel=0.01)
    np.testing.assert_allclose(felt[3:], 0.0, atol=0.05)
