"""How the simulated arm gives way: springs and dampers on its joints or on its TCP.

Joint impedance, with D_i = 2 Z_i sqrt(K_i M_ii):

    tau = K (q_cmd - q) + D (dq_cmd - dq)

Cartesian impedance, with the pose error e and L = (J M⁻¹ J')⁻¹, the inertia that is felt at the TCP:

    tau = J' (K e + D J (dq_cmd - dq)) + (1 - J' L J M⁻¹) tau_null

The second term lets springs on the joints act where they do not accelerate the TCP (Khatib 1987). D is
found along the axes in which K and L are both diagonal (double diagonalisation: Albu-Schäffer, Ott, Frese
and Hirzinger, ICRA 2003), so that no configuration is damped less than asked for, nor so much that a
1 kHz cycle could not follow.
"""

from __future__ import annotations

import mujoco
import numpy as np

from cobot.robot.model import RobotModel
from cobot.types import Array
from rtloop.backends import Impedance

NOMINAL_FREQUENCY_RAD_S = 100.0
"""Of the stiffest springs on the least inertia that they meet. A 1 kHz cycle carries ten times the
stiffness and more before it becomes unstable."""
POSTURES = 200
"""In which the least inertia is looked for."""
NULL_FREQUENCY_SHARE = 0.2
"""Of the nominal, for what holds the null space: soft, for near a singularity some of it reaches the TCP."""
NULL_DAMPING_RATIO = 1.0
MIN_MOBILITY = 1e-4
"""1/kg: where the TCP is heavier than the inverse of this, the arm is singular and its joints' own
springs take over."""
MIN_SQUARED_FREQUENCY = 1.0
"""(rad/s)²: slower motions are damped no more than this one."""


def nominal_stiffness(robot: RobotModel) -> tuple[Array, Array]:
    """Of the joints, shape (dof,), N·m/rad, and of the TCP, shape (6,), N/m and N·m/rad; zero where it
    cannot move.
    """
    limits = robot.limits
    postures = np.random.default_rng(0).uniform(
        limits.min_position, limits.max_position, (POSTURES, limits.dof)
    )
    inertia, mobility = np.full(limits.dof, np.inf), np.zeros(6)
    for posture in postures:
        mass, jacobian = robot.mass_matrix(posture), robot.jacobian(posture)
        inertia = np.minimum(inertia, mass.diagonal())
        mobility = np.maximum(mobility, (jacobian @ np.linalg.solve(mass, jacobian.T)).diagonal())
    moves = mobility > 1e-9
    cartesian = np.divide(1.0, mobility, out=np.zeros(6), where=moves)
    return NOMINAL_FREQUENCY_RAD_S**2 * inertia, NOMINAL_FREQUENCY_RAD_S**2 * cartesian


class Springs:
    """Torques that pull the arm to where it is commanded to be. Real-time safe.

    Attributes:
        joint_stiffness, tcp_stiffness: the nominal ones.
    """

    def __init__(self, robot: RobotModel, data: mujoco.MjData, jacobian: Array) -> None:
        model, dof = robot.mj, robot.dof
        self._robot, self._model, self._data, self._jacobian = robot, model, data, jacobian
        self.joint_stiffness, self.tcp_stiffness = nominal_stiffness(robot)
        self._position, self._velocity, self._inertia = data.qpos, data.qvel, data.M
        self._diagonal = model.M_rowadr + model.M_rownnz - 1
        self._error, self._gains, self._pull = np.zeros((3, 2, dof))
        self._stiffness, self._damping = self._gains
        self._damping_squared = np.zeros(dof)
        self._torque = np.zeros(dof)
        self._cartesian = False
        self._tcp_stiffness, self._damping_roots = np.zeros((2, 6))
        self._there, self._here = np.zeros((2, 7))
        self._pose_error, self._force, self._scratch = np.zeros((3, 6))
        self._response = np.zeros((6, dof))
        self._mobility, self._stiffness_roots, self._curvature = np.zeros((3, 6, 6))
        self._mobility_diagonal = self._mobility.reshape(-1)[::7]

    def use(self, impedance: Impedance) -> None:
        """These springs from now on."""
        self._cartesian = impedance.cartesian
        if impedance.cartesian:
            np.copyto(self._tcp_stiffness, impedance.stiffness)
            roots = np.sqrt(self._tcp_stiffness)
            np.multiply(roots[:, None], roots, out=self._stiffness_roots)
            np.multiply(np.sqrt(2.0 * impedance.damping_ratio), roots, out=self._damping_roots)
            np.multiply(self.joint_stiffness, NULL_FREQUENCY_SHARE**2, out=self._stiffness)
            np.multiply(self._stiffness, (2.0 * NULL_DAMPING_RATIO) ** 2, out=self._damping_squared)
        else:
            np.copyto(self._stiffness, impedance.stiffness)
            np.multiply(self._stiffness, (2.0 * impedance.damping_ratio) ** 2, out=self._damping_squared)

    def torques(self, command: Array) -> Array:
        """Towards `command`, shape (3, dof), from MuJoCo's present state: shape (dof,), N·m, overwritten by
        the next call.
        """
        position, velocity = self._error
        np.subtract(command[0], self._position, out=position)
        np.subtract(command[1], self._velocity, out=velocity)
        np.take(self._inertia, self._diagonal, out=self._damping, mode="clip")
        np.multiply(self._damping, self._damping_squared, out=self._damping)
        np.sqrt(self._damping, out=self._damping)
        np.multiply(self._gains, self._error, out=self._pull)
        np.add.reduce(self._pull, axis=0, out=self._torque)
        if self._cartesian:
            self._pull_tcp(command[0])
        return self._torque

    def _pull_tcp(self, position: Array) -> None:
        """Keep of the joints' springs what does not move the TCP, and add the TCP's own."""
        jacobian, mobility, force, scratch = self._jacobian, self._mobility, self._force, self._scratch
        mujoco.mj_solveM(self._model, self._data, self._response, jacobian)
        np.dot(self._response, jacobian.T, out=mobility)
        np.multiply(mobility, self._stiffness_roots, out=self._curvature)
        squared_frequencies, axes = np.linalg.eigh(self._curvature)  # the one thing here that allocates
        np.maximum(squared_frequencies, MIN_SQUARED_FREQUENCY, out=squared_frequencies)
        np.dot(jacobian, self._error[1], out=force)
        np.multiply(force, self._damping_roots, out=force)
        np.dot(force, axes, out=scratch)
        np.divide(scratch, np.sqrt(squared_frequencies, out=squared_frequencies), out=scratch)
        np.dot(axes, scratch, out=force)
        np.multiply(force, self._damping_roots, out=force)
        self._find_pose_error(position)
        np.multiply(self._pose_error, self._tcp_stiffness, out=scratch)
        np.add(force, scratch, out=force)
        np.dot(self._response, self._torque, out=scratch)
        self._mobility_diagonal += MIN_MOBILITY
        mujoco.mju_cholFactor(mobility, 0.0)
        mujoco.mju_cholSolve(scratch, mobility, scratch)
        np.subtract(force, scratch, out=force)
        np.dot(force, jacobian, out=self._pull[0])
        np.add(self._torque, self._pull[0], out=self._torque)

    def _find_pose_error(self, position: Array) -> None:
        """From where the TCP is to where it should be: translation and rotation vector, base frame."""
        there, here = self._there, self._here
        self._robot.forward_into(position, there)
        self._robot.forward_into(self._position, here)
        np.subtract(there[:3], here[:3], out=self._pose_error[:3])
        turn = self._pose_error[3:]
        mujoco.mju_subQuat(turn, there[3:], here[3:])  # in the TCP's own frame
        mujoco.mju_rotVecQuat(turn, turn, here[3:])
