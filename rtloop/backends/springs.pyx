"""The compliance of the simulated arm: springs and dampers on its joints or on its TCP.

Joint impedance:

    tau = K (q_cmd - q) + D (dq_cmd - dq)

Cartesian impedance, with the pose error e and the apparent inertia at the TCP, L = (J M⁻¹ J')⁻¹:

    tau = J' (K e + D J (dq_cmd - dq)) + (1 - J' L J M⁻¹) tau_null

The second term lets springs on the joints act where they do not accelerate the TCP (Khatib 1987). D is
calculated along the axes in which K and the inertia, M or L, are both diagonal (double diagonalisation:
Albu-Schäffer, Ott, Frese and Hirzinger, ICRA 2003). In any configuration the damping is at least the
requested one, but never so high that a 1 kHz cycle becomes unstable. A damper for the diagonal of M alone
would be unstable with coupled axes, such as the parallel axes of a UR.
"""

from libc.math cimport sqrt

import numpy as np

from cobot.arrays cimport MAX_DOF, checked_dof, doubles
from cobot.robot.linear cimport apply_inverse_root, cholesky_solve
from cobot.robot.mujoco cimport data_of, mj_solveM, mju_rotVecQuat, mju_subQuat, model_of

# The stiffest springs have this frequency with the smallest inertia that acts on them. A 1 kHz cycle becomes
# unstable only above ten times that stiffness.
NOMINAL_FREQUENCY_RAD_S = 100.0
# Maximum ratio between the inertia assumed for a joint and its inertia with its neighbours free.
MAX_COUPLING = 2.0
# Number of postures that are searched for the smallest inertia.
POSTURES = 200
# Frequency of the null space's springs as a share of the nominal one. They are soft, because near a
# singularity some of their force reaches the TCP.
NULL_FREQUENCY_SHARE = 0.2
NULL_DAMPING_RATIO = 1.0
# (rad/s)²: slower motions get no more damping than this one. If even the stiffest springs on the TCP are
# slower, the arm is singular, and the springs of its joints take over.
cdef double MIN_SQUARED_FREQUENCY = 1.0


def nominal_stiffness(robot):
    """Calculate the nominal stiffness of the joints, shape (dof,), N·m/rad, and of the TCP, shape (6,), N/m
    and N·m/rad, which is zero in directions in which the TCP cannot move.
    """
    limits = robot.limits
    postures = np.random.default_rng(0).uniform(
        limits.min_position, limits.max_position, (POSTURES, limits.dof)
    )
    inertia, mobility = np.full(limits.dof, np.inf), np.zeros(6)
    for posture in postures:
        mass, jacobian = robot.mass_matrix(posture), robot.jacobian(posture)
        free = 1.0 / np.linalg.inv(mass).diagonal()
        inertia = np.minimum(inertia, np.minimum(mass.diagonal(), MAX_COUPLING * free))
        mobility = np.maximum(mobility, (jacobian @ np.linalg.solve(mass, jacobian.T)).diagonal())
    moves = mobility > 1e-9
    cartesian = np.divide(1.0, mobility, out=np.zeros(6), where=moves)
    return NOMINAL_FREQUENCY_RAD_S**2 * inertia, NOMINAL_FREQUENCY_RAD_S**2 * cartesian


cdef class Springs:
    def __init__(self, robot: object, data: object, jacobian: object) -> None:
        self._dof = checked_dof(robot.dof)
        self._owners = robot, data, jacobian
        self._model, self._data = model_of(robot.mj), data_of(data)
        self._jacobian = doubles(jacobian, 6 * self._dof)
        self._unit = np.eye(self._dof)
        self._identity = doubles(self._unit, self._dof * self._dof)
        self._chain = robot.chain
        self.joint_stiffness, self.tcp_stiffness = nominal_stiffness(robot)
        cdef int row
        for row in range(6):  # any stiffness is possible along an axis along which the TCP never moves
            stiffest = self.tcp_stiffness[row]
            self._min_mobility[row] = MIN_SQUARED_FREQUENCY / stiffest if stiffest > 0.0 else 1.0

    def use(self, impedance: object) -> None:
        if impedance.cartesian:
            stiffness = self.joint_stiffness * NULL_FREQUENCY_SHARE**2
            ratio = np.full(self._dof, NULL_DAMPING_RATIO)
            self._use_on_tcp(np.broadcast_to(impedance.stiffness, 6), impedance.damping_ratio)
        else:
            stiffness = np.broadcast_to(impedance.stiffness, self._dof)
            ratio = np.broadcast_to(impedance.damping_ratio, self._dof)
        cdef int i
        for i in range(self._dof):
            self._stiffness[i] = stiffness[i]
            self._stiffness_roots[i] = sqrt(self._stiffness[i])
            self._damping_roots[i] = sqrt(2.0 * ratio[i]) * self._stiffness_roots[i]
        self._cartesian = impedance.cartesian

    def torques(self, command: object) -> object:
        torques = np.zeros(self._dof)
        self.c_torques(doubles(command, 2 * self._dof), doubles(torques, self._dof))
        return torques

    cdef _use_on_tcp(self, stiffness, damping_ratio):
        ratio = np.broadcast_to(damping_ratio, 6)
        cdef int i
        for i in range(6):
            self._tcp_stiffness[i] = stiffness[i]
            self._tcp_stiffness_roots[i] = sqrt(self._tcp_stiffness[i])
            self._tcp_damping_roots[i] = sqrt(2.0 * ratio[i]) * self._tcp_stiffness_roots[i]

    cdef void c_torques(self, const double* command, double* torques) noexcept nogil:
        """Calculate the torques towards `command` (position and velocity) from MuJoCo's current state,
        N·m.
        """
        cdef double velocity_error[MAX_DOF]
        cdef double mobility[MAX_DOF * MAX_DOF]  # M⁻¹
        cdef int i, dof = self._dof
        for i in range(dof):
            velocity_error[i] = command[dof + i] - self._data.qvel[i]
        mj_solveM(self._model, self._data, mobility, self._identity, dof)
        damp(
            dof, mobility, self._stiffness_roots, self._damping_roots, velocity_error, torques
        )
        for i in range(dof):
            torques[i] += self._stiffness[i] * (command[i] - self._data.qpos[i])
        if self._cartesian:
            self._pull_tcp(command, velocity_error, torques)

    cdef void _pull_tcp(
        self, const double* position, const double* velocity_error, double* torques
    ) noexcept nogil:
        """Keep only the part of the joint springs' torques that does not move the TCP, and add the torques of
        the TCP's own springs.
        """
        cdef double force[6]
        cdef double twist[6]
        cdef double pull
        cdef int i, row, dof = self._dof
        self._find_mobility()
        for row in range(6):
            twist[row] = 0.0
            for i in range(dof):
                twist[row] += self._jacobian[row * dof + i] * velocity_error[i]
        damp(6, self._mobility, self._tcp_stiffness_roots, self._tcp_damping_roots, twist, force)
        self._add_pull(position, force)
        self._take_from_null_space(torques, force)
        for i in range(dof):
            pull = 0.0
            for row in range(6):
                pull += self._jacobian[row * dof + i] * force[row]
            torques[i] += pull

    cdef void _find_mobility(self) noexcept nogil:
        cdef int row, column, i, dof = self._dof
        cdef double product
        mj_solveM(self._model, self._data, self._response, self._jacobian, 6)
        for row in range(6):
            for column in range(row + 1):
                product = 0.0
                for i in range(dof):
                    product += self._response[row * dof + i] * self._jacobian[column * dof + i]
                self._mobility[6 * row + column] = self._mobility[6 * column + row] = product

    cdef void _add_pull(self, const double* position, double* force) noexcept nogil:
        """Add the force of the TCP's springs, which depends on the distance of the TCP from its commanded
        pose: translation and rotation vector, base frame.
        """
        cdef double there[7]
        cdef double here[7]
        cdef double error[6]
        cdef int i
        self._chain.c_forward(position, there)
        self._chain.c_forward(self._data.qpos, here)
        for i in range(3):
            error[i] = there[i] - here[i]
        mju_subQuat(error + 3, there + 3, here + 3)  # in the TCP's own frame
        mju_rotVecQuat(error + 3, error + 3, here + 3)
        for i in range(6):
            force[i] += self._tcp_stiffness[i] * error[i]

    cdef void _take_from_null_space(self, const double* torques, double* force) noexcept nogil:
        """Subtract the force L J M⁻¹ tau_null, with which the joints' springs would move the TCP."""
        cdef double mobility[36]
        cdef double moved[6]
        cdef int row, i
        for i in range(36):
            mobility[i] = self._mobility[i]
        for row in range(6):
            mobility[7 * row] += self._min_mobility[row]
            moved[row] = 0.0
            for i in range(self._dof):
                moved[row] += self._response[row * self._dof + i] * torques[i]
        cholesky_solve(mobility, 6, moved)
        for row in range(6):
            force[row] -= moved[row]


cdef void damp(
    int n,
    const double* mobility,
    const double* stiffness_roots,
    const double* damping_roots,
    const double* velocity_error,
    double* force,
) noexcept nogil:
    """Calculate the force of the dampers for `n` springs: D = B V W^(-1/2) V' B with sqrt(K) mobility sqrt(K)
    = V W V', and B² = 2 Z K.
    """
    cdef double curvature[MAX_DOF * MAX_DOF]
    cdef int row, column
    for row in range(n):
        force[row] = damping_roots[row] * velocity_error[row]
        for column in range(n):
            curvature[n * row + column] = (
                mobility[n * row + column] * stiffness_roots[row] * stiffness_roots[column]
            )
    apply_inverse_root(curvature, n, MIN_SQUARED_FREQUENCY, force)
    for row in range(n):
        force[row] *= damping_roots[row]
