"""Inertia and bias forces in memory of their own. Oracle: MuJoCo's forward pass, by its own bindings."""

from __future__ import annotations

import copy

import mujoco
import numpy as np
import pytest
from odd_arm import odd_arm

from cobot.robot.description import RobotDescription
from cobot.robot.dynamics import Dynamics
from cobot.types import Array

COUNT = 100_000


@pytest.fixture
def states(robot: RobotDescription) -> Array:
    """Shape (COUNT, 2, dof): joints and velocities."""
    return np.random.default_rng(5).uniform(-3.0, 3.0, (COUNT, 2, robot.model.dof))


def test_the_mass_matrix_is_that_of_mujoco(robot: RobotDescription, states: Array) -> None:
    mj, dynamics = robot.model.mj, Dynamics(robot.model.mj)
    data, full = mujoco.MjData(mj), np.zeros((mj.nv, mj.nv))
    for joints, _ in states:
        data.qpos[:] = joints
        mujoco.mj_kinematics(mj, data)
        mujoco.mj_comPos(mj, data)
        mujoco.mj_crb(mj, data)
        mujoco.mj_fullM(mj, data, full)
        assert abs(dynamics.mass_matrix(joints) - full).max() < 1e-12


def test_bias_torques_are_those_of_the_whole_forward_pass(robot: RobotDescription, states: Array) -> None:
    mj, dynamics = robot.model.mj, Dynamics(robot.model.mj)
    data = mujoco.MjData(mj)
    for joints, velocity in states[:20_000]:
        data.qpos[:], data.qvel[:] = joints, velocity
        mujoco.mj_fwdPosition(mj, data)
        mujoco.mj_fwdVelocity(mj, data)
        torques = dynamics.bias_torques(joints, velocity)
        assert abs(torques - data.qfrc_bias).max() < 1e-12 * max(1.0, abs(torques).max())


def test_values_that_are_not_finite_end_nothing(robot: RobotDescription) -> None:
    for strange in (np.nan, np.inf, 1e300):
        robot.model.dynamics.mass_matrix(np.full(7, strange))
        robot.model.dynamics.bias_torques(np.zeros(7), np.full(7, strange))
        robot.model.forward(np.zeros(7))


def check_inverse(mj: mujoco.MjModel, dynamics: Dynamics, rows: Array) -> None:
    """`rows`: joints, velocities and accelerations, shape (n, 3, dof)."""
    free = copy.copy(mj)
    free.dof_damping[:], free.dof_frictionloss[:] = 0.0, 0.0
    free.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(free)
    found = dynamics.inverse(rows[:, 0], rows[:, 1], rows[:, 2])
    for (joints, velocity, acceleration), torques in zip(rows, found, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = joints, velocity, acceleration
        mujoco.mj_inverse(free, data)
        assert abs(torques - data.qfrc_inverse).max() < 1e-12 * max(1.0, abs(torques).max())


def test_inverse_dynamics_are_those_of_mujoco(robot: RobotDescription, states: Array) -> None:
    mj = robot.model.mj
    check_inverse(mj, Dynamics(mj), states[:6000].reshape(-1, 3, 7))


def test_inverse_dynamics_of_slides_branches_and_turned_axes_are_those_of_mujoco() -> None:
    mj = odd_arm()
    mj.dof_armature[:] = np.linspace(0.0, 0.3, mj.nv)
    dynamics = Dynamics(mj)
    rows = np.random.default_rng(6).uniform(-2.0, 2.0, (501, 3, mj.nv))
    check_inverse(mj, dynamics, rows)
    mj.body_mass[-2:], mj.body_ipos[-1], mj.opt.gravity[:] = (3.0, 0.0), (0.1, -0.2, 0.3), (1.0, 2.0, -9.0)
    check_inverse(mj, dynamics, rows)
    mj.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_GRAVITY
    for count in (0, 1, 7, 8, 9):
        check_inverse(mj, dynamics, rows[:count])
