"""A simulated torque-controlled arm: MuJoCo's dynamics under joint impedance control.

The drives get, each cycle,

    tau = M(q) ddq_cmd + bias(q, dq) + friction + springs

clamped to the effort limits. In position control the springs are K (q_cmd - q) + D (dq_cmd - dq), stiff,
and the friction is what the model knows at dq_cmd. On a planned motion the first three terms do the work
and the springs see only what the model does not know; pushed, the arm yields by force over stiffness. With
an `Impedance` the springs are softer, and such an arm's torque sensors, behind the gears, let the drives
make up for most of the dry friction that was really there in the last cycle.
"""

from __future__ import annotations

import mujoco
import numpy as np

from cobot.config import Settings
from cobot.robot.model import RobotModel
from cobot.types import Array, JointLimits
from rtloop.backends import BackendError, Impedance, Measured
from rtloop.backends.observer import Observer
from rtloop.backends.springs import Springs

NATURAL_FREQUENCY_RAD_S = 60.0
DAMPING_RATIO = 0.7
"""Of each joint about its inertia at the start. 60 rad/s gives some 5000 N·m/rad in the large joints and
500 in the small ones, the range in which the LBR's own joint impedance works, and is a hundredth of the
rate of a 1 kHz cycle, far from what discrete damping would make unstable."""
FRICTION_VELOCITY_RAD_S = 0.01
"""Commanded speed over which the compensation of dry friction grows to its full value."""
FRICTION_SHARE = 0.9
"""Of the measured dry friction, made up for: all of it would leave a joint without any."""
TRANSITION_S = 0.1
"""In which the arm goes over to another impedance."""


class MujocoBackend:
    """The `Backend` that needs no robot, `ImpedanceControlled`.

    Attributes:
        nominal_stiffness, nominal_cartesian_stiffness: see `ImpedanceControlled`.
        fail_read, fail_write: what the device shall complain of from now on; "" for nothing.
        drive_fault: what the drives complain of: no reading and no `enable` until it is "" again.
        push: what the surroundings exert at the TCP, shape (6,), N and N·m, base frame.
        jump: by how much the position is misread, shape (dof,), rad.
        stale: whether the readings stay what they are while the arm moves on.
        not_finite: whether the torque sensors report no number.
    """

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        names = settings.robot
        robot = RobotModel.load(names.model, limits, base=names.base_frame, tcp=names.tcp)
        self._model = robot.mj
        self._model.opt.timestep = settings.rt.period_s
        self._model.actuator_ctrlrange[:] = np.stack([-limits.max_effort, limits.max_effort], axis=1)
        self._data = mujoco.MjData(self._model)
        # MuJoCo makes a new view at each access; these stay valid as long as the data.
        self._position, self._velocity = self._data.qpos, self._data.qvel
        self._bias, self._torque = self._data.qfrc_bias, self._data.ctrl
        self._effort = self._data.actuator_force  # the torque, clamped
        dof = limits.dof
        self._tcp = self._model.site(names.tcp).id
        self._tcp_body = self._model.site_bodyid[self._tcp]
        mujoco.mj_kinematics(self._model, self._data)
        self._base_rotation = self._data.body(names.base_frame).xmat.reshape(3, 3).copy()
        self._base_turned = not np.array_equal(self._base_rotation, np.eye(3))
        self._jacobian = np.zeros((6, dof))
        self._observer = Observer(self._model, self._data, self._jacobian)
        self._springs = Springs(robot, self._data, self._jacobian)
        self.nominal_stiffness = self._springs.joint_stiffness
        self.nominal_cartesian_stiffness = self._springs.tcp_stiffness
        self._impedance: Impedance | None = None
        self._friction = self._model.dof_frictionloss.copy()
        self._low, self._high = -self._friction, self._friction
        self._joint_damping = self._model.dof_damping.copy()
        # Two products give all that is linear, from position, velocity and acceleration in a row: what is
        # commanded gives springs and friction, what is measured springs.
        self._from_command = np.zeros((2 * dof, 3 * dof))
        self._from_state = np.zeros((dof, 2 * dof))
        self._command = np.zeros((3, dof))
        self._state = np.zeros(2 * dof)
        self._state_rows = self._state[:dof], self._state[dof:]
        self._terms = np.zeros((5, dof))
        self._commanded, self._pulls = self._terms[:2].ravel(), self._terms[:3]
        self._command_term, self._friction_term, self._state_term, self._inertia_term, self._transition = (
            self._terms
        )
        self._transition_from = np.zeros(dof)
        self._transition_cycles = round(TRANSITION_S / settings.rt.period_s)
        self._transition_left = 0
        self._changing = False  # the impedance, at the next command
        self._reported = Measured(dof)
        self._sensed = self._data.sensordata
        self._pushed = self._data.xfrc_applied[self._tcp_body]
        self._from_sensors = np.zeros((6, self._model.nsensordata))
        self.fail_read = ""
        self.fail_write = ""
        self.drive_fault = ""
        self.push = np.zeros(6)
        self._pushing = False
        self.jump = np.zeros(dof)
        self.stale = False
        self.not_finite = False

    def open(self, initial_position: Array) -> None:
        self._position[:] = initial_position
        self._velocity[:] = 0.0
        mujoco.mj_forward(self._model, self._data)
        dof = len(initial_position)
        inertia = np.zeros((dof, dof))
        mujoco.mj_fullM(self._model, self._data, inertia)
        stiffness = inertia.diagonal() * NATURAL_FREQUENCY_RAD_S**2
        damping = inertia.diagonal() * 2.0 * DAMPING_RATIO * NATURAL_FREQUENCY_RAD_S
        spring, damper, joint_damper, friction = (
            np.diag(gain)
            for gain in (stiffness, damping, self._joint_damping, self._friction / FRICTION_VELOCITY_RAD_S)
        )
        none = np.zeros((dof, dof))
        self._from_command[:] = np.block([[spring, damper + joint_damper, none], [none, friction, none]])
        self._from_state[:] = np.block([-spring, -damper])
        self._torque[:] = self._bias
        mujoco.mj_forward(self._model, self._data)
        self._command[:] = 0.0
        self._command[0] = initial_position
        self._transition[:] = 0.0
        self._transition_left = 0
        self._find_jacobian()
        self._observer.reset()
        self._from_sensors[:] = self._sensors_at_tcp()
        self._report()

    def enable(self) -> None:
        """The simulated drives are always on, but for a fault of theirs."""
        if self.drive_fault:
            raise BackendError(self.drive_fault)

    def set_impedance(self, impedance: Impedance | None) -> None:
        # The torque stays what it is: the difference of the springs, and of what is commanded next, goes into
        # a term that fades. It does so even when an impedance is set in each cycle, only slower.
        if not self._changing:
            self._pull()
            np.add.reduce(self._pulls, axis=0, out=self._transition_from)
            np.add(self._transition_from, self._transition, out=self._transition_from)
        self._impedance = impedance
        if impedance is not None:
            self._springs.use(impedance)
        self._changing = True

    def read(self, measured: Measured) -> None:
        if self.fail_read or self.drive_fault:
            raise BackendError(self.fail_read or self.drive_fault)
        if not self.stale:
            self._report()
        np.copyto(measured.values, self._reported.values)

    def write(self, command: Array) -> None:
        if self.fail_write:
            self._velocity[:] = 0.0  # a robot that is told nothing puts its brakes on
            raise BackendError(self.fail_write)
        mujoco.mj_step1(self._model, self._data)
        self._find_jacobian()
        np.copyto(self._command, command)
        self._pull()
        if self._changing:
            self._changing = False
            np.subtract(self._transition_from, self._pulls.sum(axis=0), out=self._transition_from)
            self._transition_left = self._transition_cycles
        mujoco.mj_mulM(self._model, self._data, self._inertia_term, command[2])
        if self._transition_left:
            self._transition_left -= 1
            share = self._transition_left / self._transition_cycles
            np.multiply(self._transition_from, share, out=self._transition)
        np.add.reduce(self._terms, axis=0, out=self._torque)
        np.add(self._torque, self._bias, out=self._torque)
        self._exert_push()
        mujoco.mj_step2(self._model, self._data)
        self._observer.update()

    def disable(self) -> None:
        """The simulated arm has no brakes: it is simply no longer stepped."""

    def close(self) -> None:
        """Nothing to let go of."""

    def _pull(self) -> None:
        """Springs and friction towards the command: the first three terms."""
        if self._impedance is None:
            position, velocity = self._state_rows
            np.copyto(position, self._position)
            np.copyto(velocity, self._velocity)
            np.dot(self._from_command, self._command.ravel(), out=self._commanded)
            np.maximum(self._friction_term, self._low, out=self._friction_term)
            np.minimum(self._friction_term, self._high, out=self._friction_term)
            np.dot(self._from_state, self._state, out=self._state_term)
        else:
            np.multiply(self._joint_damping, self._command[1], out=self._command_term)
            np.multiply(self._observer.friction, -FRICTION_SHARE, out=self._friction_term)
            np.copyto(self._state_term, self._springs.torques(self._command))

    def _find_jacobian(self) -> None:
        """Of the TCP in the base frame, for all that follows in this cycle."""
        linear, angular = self._jacobian[:3], self._jacobian[3:]
        mujoco.mj_jacSite(self._model, self._data, linear, angular, self._tcp)
        if self._base_turned:
            np.copyto(linear, self._base_rotation.T @ linear)
            np.copyto(angular, self._base_rotation.T @ angular)

    def _exert_push(self) -> None:
        """MuJoCo wants it at the body's centre of mass, in the world frame."""
        pushing = bool(np.count_nonzero(self.push))
        if not (pushing or self._pushing):
            return
        self._pushing = pushing
        force, torque = self._pushed[:3], self._pushed[3:]
        np.dot(self._base_rotation, self.push[:3], out=force)
        np.dot(self._base_rotation, self.push[3:], out=torque)
        lever = self._data.site_xpos[self._tcp] - self._data.xipos[self._tcp_body]
        torque += np.cross(lever, force)

    def _report(self) -> None:
        reported, observer = self._reported, self._observer
        np.add(self._position, self.jump, out=reported.position)
        np.copyto(reported.velocity, self._velocity)
        np.copyto(reported.effort, self._effort)
        np.copyto(reported.desired_effort, self._torque)
        np.copyto(reported.external_effort, observer.effort)
        np.copyto(reported.wrench, observer.wrench)
        np.dot(self._from_sensors, self._sensed, out=reported.sensor)
        if self.not_finite:
            reported.effort[:] = np.nan

    def _sensors_at_tcp(self) -> Array:
        """What turns MuJoCo's readings, shape (nsensordata,), into a wrench about the TCP in its frame, shape
        (6, nsensordata): all zero without sensors `flange_force` and `flange_torque`.

        MuJoCo says what holds the flange; the surroundings do the opposite.
        """
        turns = np.zeros((6, self._model.nsensordata))
        names = {self._model.sensor(index).name: index for index in range(self._model.nsensor)}
        if not {"flange_force", "flange_torque"} <= names.keys():
            return turns
        force, torque = (self._model.sensor_adr[names[name]] for name in ("flange_force", "flange_torque"))
        site = self._model.sensor_objid[names["flange_force"]]
        rotation, to_tcp = (self._data.site_xmat[i].reshape(3, 3) for i in (site, self._tcp))
        x, y, z = to_tcp.T @ (self._data.site_xpos[site] - self._data.site_xpos[self._tcp])
        lever = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turn = -to_tcp.T @ rotation
        turns[:3, force : force + 3] = turns[3:, torque : torque + 3] = turn
        turns[3:, force : force + 3] = lever @ turn
        return turns
