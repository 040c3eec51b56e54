"""The simulated arm's compiled laws. Oracle: their plain statement in numpy, on random states.

Tolerances are shares of the terms that are added, for their sum may be small.
"""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from laws import simulated_arm as law
from sample_counts import samples
from scipy.spatial.transform import Rotation

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from cobot.types import Array
from rtloop.backends import Impedance, Measured
from rtloop.backends.mujoco import MujocoBackend
from rtloop.backends.springs import Springs

EACH = 10
POSTURES = samples(2_000)
STATES = POSTURES * EACH
SHARE = 1e-12


class Recorded:
    """What was in MuJoCo's data in each of `n` cycles."""

    def __init__(self, n: int, backend: MujocoBackend, dof: int) -> None:
        self.model, self.data = backend._model, backend._data
        self.bias, self.torque, self.control = np.zeros((3, n, dof))
        self.friction, self.after, self.effort = np.zeros((3, n, dof))
        self.wrench, self.jacobian = np.zeros((n, 6)), np.zeros((n, 6, dof))
        self.inertia = np.zeros((n, dof, dof))
        self._measured = Measured(dof)
        self._tcp = self.model.site("tcp").id

    def add(self, row: int, backend: MujocoBackend) -> None:
        """After `write`: inertia, bias and places are still of the period's beginning."""
        data = self.data
        backend.read(self._measured)
        self.bias[row], self.torque[row], self.control[row] = data.qfrc_bias, data.qfrc_actuator, data.ctrl
        self.friction[row], self.after[row] = data.efc_force[: data.nf] if data.nf else 0.0, data.qvel
        self.effort[row], self.wrench[row] = self._measured.external_effort, self._measured.wrench
        mujoco.mj_fullM(self.model, data, self.inertia[row])
        mujoco.mj_jacSite(self.model, data, self.jacobian[row][:3], self.jacobian[row][3:], self._tcp)


@pytest.fixture(scope="module")
def cycles(settings: Settings, robot: RobotDescription) -> tuple[Recorded, Array, Array]:
    """20,000 cycles of all joints in position control, each from another state: what was recorded, the
    states (2, n, dof) and the commands (n, 3, dof).
    """
    dof, home = robot.limits.dof, np.array(robot.positions["home"].joints)
    random = np.random.default_rng(1)
    states = random.uniform(-0.4, 0.4, (2, STATES, dof))
    states[0] += home
    commands = random.normal(0.0, 1.0, (STATES, 3, dof)) * np.array([0.05, 0.5, 5.0])[:, None]
    commands[:, 0] += states[0]
    backend = MujocoBackend(settings, robot.limits)
    backend.open(home)
    recorded = Recorded(STATES, backend, dof)
    position, velocity = backend._data.qpos, backend._data.qvel
    for row in range(STATES):
        position[:], velocity[:] = states[:, row]
        backend.write(commands[row])
        recorded.add(row, backend)
    return recorded, states, commands


def test_the_drives_get_the_torque_of_the_law(
    cycles: tuple[Recorded, Array, Array], settings: Settings
) -> None:
    recorded, states, commands = cycles
    then = commands[:, 1] - 0.5 * settings.rt.period_s * commands[:, 2]
    pull = law.stiff_pull(commands[:, 0] - states[0], then - states[1], recorded.inertia)
    inertial = law.times(recorded.inertia, commands[:, 2])
    expected = inertial + recorded.bias + pull
    scale = (
        np.abs(inertial)
        + np.abs(recorded.bias)
        + np.abs(pull)
        + 3600.0 * np.abs(recorded.inertia).sum(axis=2)
    )
    assert (np.abs(recorded.control - expected) <= SHARE * scale).all()


def test_the_observer_follows_the_momentum(cycles: tuple[Recorded, Array, Array], settings: Settings) -> None:
    recorded, _, _ = cycles
    period_s = settings.rt.period_s
    before = np.vstack([np.zeros_like(recorded.after[:1]), recorded.after[:-1]])
    effort = np.vstack([np.zeros_like(recorded.effort[:1]), recorded.effort[:-1]])
    momentum = law.times(recorded.inertia, recorded.after - before)
    damping = recorded.model.dof_damping * recorded.after
    torques = recorded.bias, damping, recorded.torque, recorded.friction
    expected = law.observed_effort(effort, momentum, *torques, period_s)
    scale = np.abs(recorded.inertia).sum(axis=(1, 2)).max() / period_s
    assert (np.abs(recorded.effort - expected) <= SHARE * scale).all()


def test_the_wrench_explains_the_effort_best(cycles: tuple[Recorded, Array, Array]) -> None:
    recorded, _, _ = cycles
    expected = law.felt_wrench(recorded.effort, recorded.jacobian)
    off = np.linalg.norm(recorded.wrench - expected, axis=1) / np.linalg.norm(expected, axis=1)
    assert (off <= SHARE).all()


class Pushed:
    """Postures in which springs pull at the arm, ten commands each: all that the law needs to know.

    Attributes:
        torques: what the compiled springs do, shape (n, dof).
    """

    def __init__(self, robot: RobotDescription, cartesian: bool) -> None:
        self.model, self.limits, self.tcp = robot.model.mj, robot.limits, robot.model.tcp_site
        self.data, self._jacobian = mujoco.MjData(self.model), np.zeros((6, self.limits.dof))
        self.springs = Springs(robot.model, self.data, self._jacobian)
        dof, random = self.limits.dof, np.random.default_rng(2)
        nominal = self.springs.tcp_stiffness if cartesian else self.springs.joint_stiffness
        self.positions = random.uniform(self.limits.min_position, self.limits.max_position, (POSTURES, dof))
        self.velocity = random.normal(0.0, 0.5, (STATES, dof))
        self.stiffness = random.uniform(0.01, 1.0, (POSTURES, len(nominal))) * nominal
        self.ratio = random.uniform(0.3, 1.0, self.stiffness.shape)
        self.commands = random.normal(0.0, 0.5, (STATES, 3, dof))
        self.commands[:, 0] = self.positions.repeat(EACH, axis=0) + 0.1 * self.commands[:, 0]
        self.torques, self.cartesian = np.zeros((STATES, dof)), cartesian
        self.inertia, self.jacobians = np.zeros((POSTURES, dof, dof)), np.zeros((POSTURES, 6, dof))
        for posture in range(POSTURES):
            self._pull(posture)
        for name in ("positions", "stiffness", "ratio", "inertia", "jacobians"):
            setattr(self, name, getattr(self, name).repeat(EACH, axis=0))
        self.errors = self.commands[:, 0] - self.positions, self.commands[:, 1] - self.velocity

    def _pull(self, posture: int) -> None:
        model, data, jacobian = self.model, self.data, self._jacobian
        data.qpos[:] = self.positions[posture]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fullM(model, data, self.inertia[posture])
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], self.tcp)
        self.jacobians[posture] = jacobian
        self.springs.use(Impedance(self.cartesian, self.stiffness[posture], self.ratio[posture]))
        velocity = data.qvel
        for row in range(posture * EACH, (posture + 1) * EACH):
            velocity[:] = self.velocity[row]
            self.torques[row] = self.springs.torques(self.commands[row])

    def pose_errors(self) -> Array:
        """From where the TCP is to where it should be: translation and rotation vector, shape (n, 6)."""
        (place, turn), (wanted, wanted_turn) = self._places(self.positions), self._places(self.commands[:, 0])
        return np.hstack(
            [wanted - place, Rotation.from_matrix(wanted_turn @ law.transposed(turn)).as_rotvec()]
        )

    def _places(self, positions: Array) -> tuple[Array, Array]:
        """Of the TCP: positions (n, 3) and rotation matrices (n, 3, 3)."""
        data = self.data
        joints, place, turn = data.qpos, data.site_xpos[self.tcp], data.site_xmat[self.tcp]
        rows = np.zeros((STATES, 12))
        for row in range(STATES):
            joints[:] = positions[row]
            mujoco.mj_kinematics(self.model, data)
            rows[row, :3], rows[row, 3:] = place, turn
        return rows[:, :3], rows[:, 3:].reshape(-1, 3, 3)


def test_springs_on_the_joints_pull_by_the_law(robot: RobotDescription) -> None:
    pushed = Pushed(robot, cartesian=False)
    expected = law.joint_springs(*pushed.errors, pushed.inertia, pushed.stiffness, pushed.ratio)
    assert (np.abs(pushed.torques - expected) <= SHARE * (np.abs(expected) + pushed.stiffness)).all()


def test_springs_on_the_tcp_pull_by_the_law(robot: RobotDescription) -> None:
    pushed = Pushed(robot, cartesian=True)
    soft = law.NULL_STIFFNESS_SHARE * pushed.springs.joint_stiffness
    null_torques = law.joint_springs(*pushed.errors, pushed.inertia, soft, np.ones(robot.limits.dof))
    pose_error, velocity_error = pushed.pose_errors(), pushed.errors[1]
    expected = law.tcp_springs(
        *(pose_error, velocity_error, null_torques, pushed.inertia, pushed.jacobians),
        *(pushed.stiffness, pushed.ratio, pushed.springs.tcp_stiffness),
    )
    off = np.linalg.norm(pushed.torques - expected, axis=1) / np.linalg.norm(expected, axis=1)
    assert np.quantile(off, 0.999) <= SHARE
    assert off.max() <= 10.0 * SHARE, "near a singularity rounding is amplified, in numpy as well"
