"""Streams that touch: the simulated arm presses, gives way and is pushed, on the virtual clock.

Oracles: what the simulation has applied (its pushes, MuJoCo's contact force on the floor), Hooke's law, and
for torques the equation of motion, integrated by scipy with the mass matrix of pinocchio.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from independent_models import second_robot
from rig import Rig
from scipy.integrate import solve_ivp

from cobot.config import Settings
from cobot.ipc.layout import Stream
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import inverse
from cobot.types import Array, LoopMode, Pose

HEIGHT_M = 0.05


def tcp(rig: Rig, joints: Array) -> Array:
    pose = np.zeros(7)
    rig.robot.model.forward_into(joints, pose)
    return pose


def require_limits(rig: Rig) -> None:
    for share in rig.rates():
        assert share.max() <= 1.011


@pytest.fixture
def simulated(settings: Settings, robot: RobotDescription) -> Iterator[Rig]:
    made = Rig(settings, robot, simulated=True)
    made.step(50)
    yield made
    made.close()


@pytest.fixture
def above_floor(settings: Settings, robot: RobotDescription) -> Iterator[Rig]:
    """The tool points down, some way above the floor."""
    home = np.array(robot.positions["home"].joints)
    pose = robot.model.forward(home)
    goal = Pose(np.array([0.5, 0.0, HEIGHT_M]), pose.quaternion)
    made = Rig(settings, robot, simulated=True, start=inverse(robot.model, goal, home))
    made.step(50)
    yield made
    made.close()


def press(rig: Rig, cycles: int, wrench: Array, pose: Array) -> Array:
    """Stream this; the force on the floor in the last half second, as MuJoCo computes it, N."""
    forces = []
    for cycle in range(cycles):
        if cycle % 10 == 0:
            rig.aim(pose=pose, wrench=wrench)
        rig.step()
        if cycle >= cycles - 500:
            forces.append(rig.floor_force())
    return np.array(forces)


@pytest.mark.parametrize(
    ("frame", "wrench"),
    [
        ({}, [0.0, 0.0, -10.0, 0.0, 0.0, 0.0]),  # down, in the world
        ({"force_in_tcp": 1}, [0.0, 0.0, 10.0, 0.0, 0.0, 0.0]),  # forward, as the tool points down
    ],
)
def test_ten_newtons_on_the_floor_are_ten_newtons(
    above_floor: Rig, frame: dict[str, int], wrench: list[float]
) -> None:
    rig = above_floor
    axes = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    assert rig.stream(Stream.CARTESIAN, force_axes=axes, **frame) == ""
    pose = tcp(rig, rig.commanded[-1])
    forces = press(rig, 7000, np.array(wrench), pose)
    assert forces.mean() == pytest.approx(10.0, abs=0.5)
    assert np.ptp(forces) < 0.5
    assert rig.mode is LoopMode.CARTESIAN
    assert not {"COLLISION", "JUMP"} & set(rig.counted())
    require_limits(rig)


def test_it_slides_along_the_floor_while_it_presses(above_floor: Rig) -> None:
    rig = above_floor
    assert rig.stream(Stream.CARTESIAN, force_axes=np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])) == ""
    pose, wrench = tcp(rig, rig.commanded[-1]), np.array([0.0, 0.0, -10.0, 0.0, 0.0, 0.0])
    press(rig, 6000, wrench, pose)
    forces = []
    for cycle in range(2000):
        if cycle % 10 == 0:
            pose[1] += 0.0005  # 50 mm/s
            rig.aim(pose=pose, wrench=wrench)
        rig.step()
        forces.append(rig.floor_force())
    assert tcp(rig, rig.commanded[-1])[1] == pytest.approx(pose[1], abs=2e-3)
    mean = np.convolve(forces[500:], np.full(100, 0.01), "valid")  # MuJoCo's contact itself flickers
    assert np.abs(mean - 10.0).max() < 2.0
    require_limits(rig)


def test_in_free_space_a_force_moves_the_tcp_no_faster_than_permitted(simulated: Rig) -> None:
    rig = simulated
    axes = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert rig.stream(Stream.CARTESIAN, force_axes=axes, force_velocity=np.full(6, 0.02)) == ""
    begin = tcp(rig, rig.commanded[-1])
    for cycle in range(1500):
        if cycle % 10 == 0:
            rig.aim(pose=begin, wrench=np.array([40.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
        rig.step()
    poses = np.array([tcp(rig, joints) for joints in rig.commanded[-500:]])
    speed = np.diff(poses[:, 0]) / 1e-3
    assert speed.max() <= 0.0202
    assert speed.mean() == pytest.approx(0.02, rel=0.02)
    np.testing.assert_allclose(poses[:, 1:3], np.tile(begin[1:3], (500, 1)), atol=1e-4)
    require_limits(rig)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("force", [30.0, -50.0])
def test_pushed_at_the_tcp_it_yields_by_force_over_stiffness(simulated: Rig, axis: int, force: float) -> None:
    rig = simulated
    stiffness = np.array([3000.0, 2000.0, 2500.0, 200.0, 200.0, 200.0])
    assert rig.stream(Stream.CARTESIAN, cartesian_stiffness=stiffness) == ""
    rig.simulation.push[axis] = force
    rig.step(1500)
    state = rig.memory.state.data
    moved = state["tcp"][:3] - tcp(rig, rig.commanded[-1])[:3]
    assert moved[axis] == pytest.approx(force / stiffness[axis], rel=0.05)
    assert state["wrench"][axis] == pytest.approx(force, rel=0.05)
    expected = rig.robot.model.jacobian(state["position"]).T @ rig.simulation.push
    np.testing.assert_allclose(state["external_effort"], expected, atol=0.05 * np.abs(expected).max())
    rig.simulation.push[axis] = 0.0
    rig.step(1000)
    assert np.abs(rig.memory.state.data["tcp"][:3] - tcp(rig, rig.commanded[-1])[:3]).max() < 5e-4


def test_pushed_on_a_joint_it_yields_by_torque_over_stiffness(simulated: Rig) -> None:
    rig = simulated
    stiffness = np.array([800.0, 800.0, 600.0, 600.0, 300.0, 200.0, 200.0])
    assert rig.stream(Stream.JOINT_IMPEDANCE, stiffness=stiffness) == ""
    rig.simulation.push[:] = [0.0, 40.0, 0.0, 0.0, 0.0, 0.0]
    rig.step(1500)
    state = rig.memory.state.data
    torque = rig.robot.model.jacobian(state["position"]).T @ rig.simulation.push
    np.testing.assert_allclose(
        state["position"] - rig.commanded[-1],
        torque / stiffness,
        atol=0.05 * np.abs(torque / stiffness).max(),
    )


@pytest.mark.parametrize(
    ("limits", "what"),
    [
        ({"max_contact_wrench": np.full(6, 25.0)}, "along x at the TCP"),
        ({"max_contact_torque": np.full(7, 8.0)}, "on joint"),
    ],
)
def test_too_hard_a_contact_ends_the_session(simulated: Rig, limits: dict[str, Array], what: str) -> None:
    rig = simulated
    assert rig.stream(Stream.CARTESIAN, **limits) == ""
    rig.step(100)
    assert rig.mode is LoopMode.CARTESIAN
    rig.simulation.push[0] = 40.0
    rig.step(200)
    rig.run()
    assert rig.mode is LoopMode.HOLD
    assert rig.reason.startswith("contact: ")
    assert what in rig.reason
    assert rig.counted()["CONTACT"] == 1


def test_a_pushed_arm_is_held_where_it_is_when_the_session_ends(simulated: Rig) -> None:
    rig = simulated
    assert rig.stream(Stream.CARTESIAN) == ""
    rig.simulation.push[0] = 20.0
    rig.step(1500)
    there = rig.memory.state.data["position"].copy()
    rig.end_stream()
    rig.run()
    rig.step(500)
    assert rig.mode is LoopMode.HOLD
    np.testing.assert_allclose(rig.memory.state.data["position"], there, atol=0.015)


def test_a_joint_that_gives_way_too_far_is_a_fault(simulated: Rig) -> None:
    rig = simulated
    assert rig.stream(Stream.JOINT_IMPEDANCE, stiffness=np.full(7, 20.0)) == ""
    rig.simulation.push[1] = 60.0
    rig.step(1500)
    rig.run()
    assert rig.mode is LoopMode.FAULT
    assert "allowed: 0.5 rad" in rig.reason


def test_torques_move_the_arm_as_the_equation_of_motion_says(simulated: Rig) -> None:
    rig = simulated
    assert rig.stream(Stream.JOINT_TORQUE, decimation=1) == ""
    torque = np.array([2.0, 0.0, 1.0, 0.0, 0.4, 0.0, 0.1])
    damping, second = rig.robot.model.mj.dof_damping, second_robot()

    def motion(_: float, state: Array) -> Array:
        acceleration = np.linalg.solve(second.mass_matrix(state[:7]), torque - damping * state[7:])
        return np.concatenate([state[7:], acceleration])

    def run(cycles: int) -> Array:
        for _ in range(cycles):
            rig.aim(joints=torque)
            rig.step()
        return np.concatenate([rig.memory.state.data["position"], rig.memory.state.data["velocity"]])

    begin = run(100)  # by then the jerk limits have let the torques in
    end = run(200)
    wanted = solve_ivp(motion, (0.0, 0.2), begin, rtol=1e-8).y[:, -1]
    change = (wanted - begin)[:7]
    np.testing.assert_allclose((end - begin)[:7], change, atol=0.05 * np.abs(change).max())
    assert rig.counted() == {}
    require_limits(rig)


def test_a_torque_against_an_obstacle_becomes_that_torque(simulated: Rig) -> None:
    """The obstacle: a push that grows until it holds the arm."""
    rig = simulated
    assert rig.stream(Stream.JOINT_TORQUE) == ""
    here = rig.memory.state.data["tcp"][:3].copy()
    torque = rig.robot.model.jacobian(rig.memory.state.data["position"]).T @ [20.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    for _ in range(3000):
        rig.aim(joints=torque)
        spring = 3000.0 * (rig.memory.state.data["tcp"][:3] - here)
        damper = 150.0 * rig.memory.state.data["tcp_velocity"][:3]
        rig.simulation.push[:3] = -spring - damper
        rig.step()
    assert rig.memory.state.data["wrench"][0] == pytest.approx(-20.0, rel=0.05)
    assert np.abs(rig.memory.state.data["velocity"]).max() < 0.02
    require_limits(rig)


def test_no_torque_drives_a_joint_beyond_its_limits(simulated: Rig) -> None:
    rig = simulated
    assert rig.stream(Stream.JOINT_TORQUE) == ""
    for _ in range(4000):
        rig.aim(joints=np.array([300.0, 0.0, 0.0, 0.0, 0.0, 0.0, 40.0]))
        rig.step()
    assert rig.mode is LoopMode.JOINT_TORQUE
    position = np.array(rig.commanded)
    assert (position <= rig.limits.max_position + 1.1e-5).all()
    require_limits(rig)


@pytest.mark.parametrize(("stream", "force"), [(Stream.JOINT_IMPEDANCE, 20.0), (Stream.CARTESIAN, 20.0)])
def test_a_soft_arm_that_is_pushed_is_not_kicked_when_its_session_ends(
    simulated: Rig, stream: Stream, force: float
) -> None:
    rig = simulated
    soft = np.array([500.0] * 3 + [50.0] * 3)
    assert rig.stream(stream, stiffness=np.full(7, 100.0), cartesian_stiffness=soft) == ""
    rig.simulation.push[0] = force
    rig.step(3000)
    begin = rig.memory.state.data["tcp"][:3].copy()
    rig.end_stream()
    velocities = []
    for _ in range(1000):
        rig.step()
        velocities.append(rig.memory.state.data["velocity"].copy())
    assert rig.mode is LoopMode.HOLD
    acceleration = np.diff(np.array(velocities), axis=0) / 1e-3
    assert (np.abs(acceleration) <= 3.0 * rig.limits.max_acceleration).all()
    assert np.linalg.norm(rig.memory.state.data["tcp"][:3] - begin) < 0.01
