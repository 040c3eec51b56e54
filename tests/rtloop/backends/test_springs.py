"""The simulated arm gives way and feels: the backend alone.

Oracles: Hooke's law and the wrench that the simulator was made to apply; pinocchio for the Jacobian, the
inertia and the TCP's pose; MuJoCo's contact solver for contact forces.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from independent_models import MJCF, changed_world, second_robot
from scipy.spatial.transform import Rotation

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from cobot.types import Array
from rtloop.backends import Impedance, ImpedanceControlled, Measured
from rtloop.backends.mujoco import MujocoBackend

POSTURES = np.array(
    [
        [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0],
        [1.2, 0.7, -0.4, -1.2, 0.6, 1.0, -1.0],
        [-1.0, -0.3, 0.5, -2.0, -0.5, 0.4, 0.8],
        [0.3, 0.9, 0.2, -1.0, 1.2, -1.1, 0.5],
    ]
)
STRETCHED = np.array([0.0, 0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
TOOL_KG = 0.3
"""What the model hangs behind its sensor: link7."""


class Arm:
    """A simulation that is told to stay where it began."""

    def __init__(
        self, settings: Settings, robot: RobotDescription, posture: Array, model: Path | None = None
    ) -> None:
        if model is not None:
            changed = settings.robot.model_copy(update={"model": model})
            settings = settings.model_copy(update={"robot": changed})
        self.backend = MujocoBackend(settings, robot.limits)
        self.backend.open(posture)
        self.command = np.zeros((3, robot.limits.dof))
        self.command[0] = posture
        self.measured = Measured(robot.limits.dof)

    def give_way(self, cartesian: bool, stiffness: Array, damping_ratio: float = 0.7) -> None:
        ratio = np.full(len(stiffness), damping_ratio)
        self.backend.set_impedance(Impedance(cartesian, np.asarray(stiffness, dtype=float), ratio))

    def step(self, cycles: int = 1) -> Array:
        """Everything that was measured, shape (cycles, 47)."""
        rows = []
        for _ in range(cycles):
            self.backend.write(self.command)
            self.backend.read(self.measured)
            rows.append(self.measured.values.copy())
        return np.array(rows)

    def displacement(self) -> Array:
        """Of the TCP from its commanded pose: translation and rotation vector, base frame, shape (6,)."""
        place, turn = second_robot().forward(self.measured.position)
        wanted, wanted_turn = second_robot().forward(self.command[0])
        return np.concatenate([place - wanted, Rotation.from_matrix(turn @ wanted_turn.T).as_rotvec()])


@pytest.fixture
def arm(settings: Settings, robot: RobotDescription) -> Arm:
    return Arm(settings, robot, POSTURES[0])


def wrenches(seed: int) -> list[Array]:
    """Forces of 20, 40 and 60 N in some directions, and a torque."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(4, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    none = np.zeros(3)
    forces = [np.concatenate([size * d, none]) for size, d in zip([20, 40, 60], directions, strict=False)]
    return [*forces, np.concatenate([none, 3.0 * directions[3]])]


def near(actual: Array, expected: Array, share: float = 0.05) -> bool:
    return bool(np.linalg.norm(actual - expected) <= share * np.linalg.norm(expected))


@pytest.mark.parametrize("stiffness", [1000.0, 3000.0])
@pytest.mark.parametrize("posture", range(len(POSTURES)))
def test_pushed_the_tcp_yields_by_force_over_stiffness_and_feels_the_push(
    settings: Settings, robot: RobotDescription, posture: int, stiffness: float
) -> None:
    springs = np.array([stiffness] * 3 + [150.0] * 3)
    for wrench in wrenches(posture):
        arm = Arm(settings, robot, POSTURES[posture])
        arm.give_way(True, springs)
        arm.backend.push = wrench
        arm.step(1500)
        measured, moved = arm.measured, arm.displacement()
        half = slice(3) if wrench[:3].any() else slice(3, 6)
        assert near(moved[half], (wrench / springs)[half])
        assert near(measured.wrench[half], wrench[half])
        jacobian = second_robot().jacobian(measured.position)
        assert near(measured.external_effort, jacobian.T @ wrench)
        to_tcp = second_robot().forward(measured.position)[1].T
        weight = to_tcp @ np.array([0.0, 0.0, -9.81 * TOOL_KG])
        assert near(measured.sensor[:3] - weight, to_tcp @ wrench[:3], 0.05) or not wrench[:3].any()
        arm.backend.push = np.zeros(6)
        arm.step(1500)
        assert np.abs(arm.displacement()).max() < 1e-3, "it returns"
        assert np.abs(arm.measured.velocity).max() < 1e-3, "and rests"
        assert np.abs(arm.measured.wrench).max() < 0.1


@pytest.mark.parametrize("joint", range(7))
def test_under_joint_impedance_a_joint_yields_by_torque_over_stiffness(arm: Arm, joint: int) -> None:
    stiffness = np.array([800.0, 800.0, 500.0, 500.0, 200.0, 100.0, 60.0])
    torque = stiffness[joint] * 0.03
    arm.give_way(False, stiffness)
    arm.backend._data.qfrc_applied[joint] = torque
    arm.step(1500)
    deflection = arm.measured.position - arm.command[0]
    assert deflection[joint] == pytest.approx(0.03, rel=0.05)
    assert np.abs(np.delete(deflection, joint)).max() < 0.03 * 0.05
    assert arm.measured.external_effort[joint] == pytest.approx(torque, rel=0.05)


def test_a_push_is_felt_within_50_ms_in_position_control(arm: Arm) -> None:
    wrench = np.array([30.0, -20.0, 25.0, 0.0, 0.0, 0.0])
    arm.step(50)
    arm.backend.push = wrench
    arm.step(50)
    assert near(arm.measured.wrench[:3], wrench[:3])
    assert near(arm.measured.external_effort, second_robot().jacobian(arm.command[0]).T @ wrench)


@pytest.mark.parametrize("kind", ["position", "joint", "cartesian"])
def test_free_motion_shows_no_external_effort(arm: Arm, robot: RobotDescription, kind: str) -> None:
    if kind != "position":
        cartesian = kind == "cartesian"
        nominal = arm.backend.nominal_cartesian_stiffness if cartesian else arm.backend.nominal_stiffness
        arm.give_way(cartesian, nominal * 0.2)
    start = arm.command[0].copy()
    size = 0.25 * robot.limits.max_velocity * np.where(start > 0.0, -1.0, 1.0)  # away from the stops
    rate = 2.0 * np.pi
    for cycle in range(2000):  # velocities up to half of the limits, 70 % of the accelerations
        t = cycle * 1e-3
        arm.command[0] = start + size * (t - np.sin(rate * t) / rate)
        arm.command[1] = size * (1.0 - np.cos(rate * t))
        arm.command[2] = size * rate * np.sin(rate * t)
        arm.step()
        assert np.abs(arm.measured.external_effort).max() < 1e-6
        assert np.abs(arm.measured.position - arm.command[0]).max() < 5e-3


@pytest.mark.parametrize("damping_ratio", [0.7, 1.0])
@pytest.mark.parametrize("times", [1.0, 8.0])
@pytest.mark.parametrize("cartesian", [False, True])
def test_the_nominal_stiffness_does_not_oscillate_nor_does_eight_times_as_much(
    settings: Settings, robot: RobotDescription, cartesian: bool, times: float, damping_ratio: float
) -> None:
    for posture in (*POSTURES, STRETCHED):
        arm = Arm(settings, robot, posture)
        assert isinstance(arm.backend, ImpedanceControlled)
        nominal = arm.backend.nominal_cartesian_stiffness if cartesian else arm.backend.nominal_stiffness
        arm.give_way(cartesian, times * nominal, damping_ratio)
        arm.backend.push = np.array([20.0, -20.0, 15.0, 1.0, 1.0, -1.0])
        arm.step(200)
        arm.backend.push = np.zeros(6)
        velocity = np.abs(arm.step(800)[-100:, 7:14])
        assert velocity.max() < 0.02, posture
        if posture is not STRETCHED:  # there the joints' soft springs do the last of the way
            assert velocity.max() < 1e-3, posture


@pytest.mark.parametrize("posture", range(len(POSTURES)))
def test_critically_damped_the_tcp_does_not_swing_past(
    settings: Settings, robot: RobotDescription, posture: int
) -> None:
    springs = np.array([2000.0] * 3 + [150.0] * 3)
    for axis in range(6):
        arm = Arm(settings, robot, POSTURES[posture])
        arm.give_way(True, springs, 1.0)
        arm.backend.push = np.eye(6)[axis] * np.array([30.0] * 3 + [3.0] * 3)
        arm.step(1000)
        begin = arm.displacement()[axis]
        arm.backend.push = np.zeros(6)
        past = 0.0
        for _ in range(60):
            arm.step(10)
            past = max(past, -arm.displacement()[axis] / begin)
        assert past < 0.02


def test_the_null_space_gives_way_without_moving_the_tcp(arm: Arm) -> None:
    arm.give_way(True, np.array([2000.0] * 3 + [150.0] * 3))
    null = np.linalg.svd(second_robot().jacobian(arm.command[0]))[2][-1]
    arm.backend._data.qfrc_applied[:] = 40.0 * second_robot().mass_matrix(arm.command[0]) @ null
    arm.step(600)
    moved = arm.displacement()
    assert np.abs(arm.measured.position - arm.command[0]).max() > 0.02
    assert np.abs(moved[:3]).max() < 1e-3
    arm.backend._data.qfrc_applied[:] = 0.0
    arm.step(1500)
    np.testing.assert_allclose(arm.measured.position, arm.command[0], atol=1e-3)


def test_another_impedance_under_load_takes_over_without_a_torque_step(arm: Arm) -> None:
    arm.backend.push = np.array([0.0, 40.0, -40.0, 0.0, 0.0, 0.0])
    arm.step(1000)
    soft = Impedance(True, np.array([1000.0] * 3 + [150.0] * 3), np.full(6, 0.7))
    joints = Impedance(False, np.full(7, 150.0), np.full(7, 0.7))
    for impedance in (soft, joints, None, soft, None, joints):
        before = arm.measured.desired_effort.copy()
        arm.backend.set_impedance(impedance)
        arm.backend.set_impedance(impedance)  # told twice it does not begin anew
        first = arm.step(1)[:, 21:28]
        to_bridge = np.abs(arm.backend._transition).max()  # the step that there would have been
        efforts = np.vstack([before, first, arm.step(400)[:, 21:28]])
        assert to_bridge > 5.0
        assert np.abs(np.diff(efforts, axis=0)).max() < 0.05 * to_bridge + 0.5
        assert np.abs(arm.backend._transition).max() == 0.0, "within 0.1 s"
    arm.backend.set_impedance(soft)
    arm.step(1500)
    assert near(arm.displacement()[:3], arm.backend.push[:3] / 1000.0)


def test_pressed_on_a_surface_the_wrench_is_the_contact_force(
    settings: Settings, robot: RobotDescription, tmp_path: Path
) -> None:
    place = second_robot().forward(POSTURES[0])[0]
    top = place[2] - 0.01
    world = changed_world(tmp_path, post=(place[0], 0.0, top / 2.0, 0.1, 0.1, top / 2.0))
    arm = Arm(settings, robot, POSTURES[0], world)
    arm.give_way(True, np.array([2000.0] * 3 + [150.0] * 3))
    below = robot.model.forward(POSTURES[0]).position + np.array([0.0, 0.0, -0.03])
    down = POSTURES[0].copy()
    for _ in range(20):  # Newton towards the place below, orientation kept
        turn = Rotation.from_matrix(
            second_robot().forward(POSTURES[0])[1] @ second_robot().forward(down)[1].T
        )
        error = np.concatenate([below - second_robot().forward(down)[0], turn.as_rotvec()])
        down += np.linalg.pinv(second_robot().jacobian(down)) @ error
    for share in np.linspace(0.0, 1.0, 1000):
        arm.command[0] = POSTURES[0] + share * (down - POSTURES[0])
        arm.step()
    arm.step(1500)
    touching = mean_contact_wrench(arm, 100)
    assert touching[2] == pytest.approx(2000.0 * 0.02, rel=0.05)
    assert near(arm.measured.wrench[:3], touching[:3])
    np.testing.assert_allclose(arm.measured.wrench[3:], touching[3:], atol=0.05 * 0.05 * touching[2])
    assert np.abs(arm.measured.velocity).max() < 1e-3


def mean_contact_wrench(arm: Arm, cycles: int) -> Array:
    """What the next cycles have in common: pressed flat on a surface, the corners of the flange bear the load
    in turns, which the observer, with its lag of 10 ms, does not follow.
    """
    wrenches = []
    for _ in range(cycles):
        arm.step()
        wrenches.append(contact_wrench(arm))
    return np.mean(wrenches, axis=0)


def contact_wrench(arm: Arm) -> Array:
    """About the TCP, shape (6,), of all contacts of link7, in the world frame."""
    model, data = arm.backend._model, arm.backend._data
    wrench, force = np.zeros(6), np.zeros(6)
    tcp = data.site("tcp").xpos
    for index in range(data.ncon):
        contact = data.contact[index]
        mujoco.mj_contactForce(model, data, index, force)
        on_second = contact.frame.reshape(3, 3).T @ force[:3]
        sign = 1.0 if model.geom(contact.geom[1]).name == "link7" else -1.0
        wrench[:3] += sign * on_second
        wrench[3:] += np.cross(contact.pos - tcp, sign * on_second)
    return wrench


def test_a_turned_base_feels_and_yields_in_its_own_frame(
    settings: Settings, robot: RobotDescription, tmp_path: Path
) -> None:
    words = MJCF.read_text()
    turned = tmp_path / "turned.xml"
    turned.write_text(
        words.replace('<body name="base_link">', '<body name="base_link" pos="0 0 1" quat="0.8 0 0.6 0">')
    )
    assert turned.read_text() != words
    arm = Arm(settings, robot, POSTURES[1], turned)
    springs = np.array([1000.0, 2000.0, 3000.0, 150.0, 150.0, 150.0])
    arm.give_way(True, springs)
    arm.backend.push = np.array([30.0, -20.0, 25.0, 0.0, 0.0, 0.0])
    arm.step(1500)
    assert near(arm.displacement()[:3], (arm.backend.push / springs)[:3])
    assert near(arm.measured.wrench[:3], arm.backend.push[:3])


def test_the_stretched_arm_holds_when_it_is_pushed(settings: Settings, robot: RobotDescription) -> None:
    arm = Arm(settings, robot, STRETCHED)
    arm.give_way(True, np.array([2000.0] * 3 + [150.0] * 3))
    arm.backend.push = np.array([20.0, 20.0, 20.0, 0.0, 0.0, 0.0])
    arm.step(1500)
    assert np.abs(arm.displacement()[:3]).max() < 0.05
    arm.backend.push = np.zeros(6)
    arm.step(3000)
    assert np.abs(arm.displacement()).max() < 2e-3
    assert np.abs(arm.measured.velocity).max() < 1e-2
