"""A simulated torque-controlled arm: MuJoCo's dynamics under joint impedance control.

In position control the drives get the computed torque in each cycle,

    tau = M(q) (ddq_cmd + w² (q_cmd - q) + 2 z w (dq_cmd - dq)) + bias(q, dq)

clamped to the effort limits. Every arm then has the frequency w and the damping ratio z in every posture and
with every payload, so the stability in a cycle of 1 ms does not depend on masses. Springs with a fixed
stiffness do not have this property: with dampers for the inertia of one posture, or even for the current
diagonal of M, light arms and coupled axes become unstable. Efforts are measured at the output of the gears.
The drives compensate the model's dry friction and damping, so neither slows the arm down.

With an `Impedance` the drives get M(q) ddq_cmd + bias + friction + springs instead, and friction and damping
act on the arm. The drives, which have torque sensors at the output of the gears, compensate most of the dry
friction of the last cycle.

Each `write` advances drives, dynamics and sensors by one period (`_step`); `read` reports the state after it.
"""

from libc.math cimport NAN, fabs, fmin, sqrt
from libc.string cimport memcpy, memset

import mujoco
import numpy as np

from cobot.arrays cimport MAX_DOF, checked_dof, doubles
from cobot.ipc.layout import PULL_S
from cobot.ipc.state_block cimport (
    DESIRED_EFFORT_ROW,
    EFFORT_ROW,
    EXTERNAL_EFFORT_ROW,
    MEASURED_ROWS,
    POSITION_ROW,
    VELOCITY_ROW,
    count_measured,
)
from cobot.robot.mujoco cimport (
    data_of,
    mj_applyFT,
    mj_jacSite,
    mj_mulM,
    mj_step1,
    mj_step2,
    mjData,
    mjModel,
    model_of,
)
from rtloop.backends.compiled cimport CompiledBackend, Measured
from rtloop.backends.observer cimport Observer
from rtloop.backends.springs cimport Springs

from cobot.robot.device import Capabilities
from cobot.robot.model import RobotModel
from rtloop.backends import BackendError

# Position control. For the inertias of the iiwa, 60 rad/s corresponds to about 5000 N·m/rad at the large
# joints and 500 at the small ones, the range of the LBR's own joint impedance. It is a hundredth of the rate
# of a 1 kHz cycle, so a discrete controller is far from unstable.
cdef double NATURAL_FREQUENCY_RAD_S = 60.0
cdef double DAMPING_RATIO = 0.7
# Share of the measured dry friction that is compensated. At 1, a joint would have no friction.
cdef double FRICTION_SHARE = 0.9
# Duration of the transition to another impedance.
cdef double TRANSITION_S = 0.1
# A pull at a link acts like a hand: as a spring with a damper. It loads no joint with more than this share of
# its effort limit.
cdef double PULL_N_M = 300.0
cdef double PULL_NS_M = 40.0
cdef double MAX_PULL_N = 50.0
cdef double MAX_PULL_SHARE = 0.15


cdef class MujocoBackend(CompiledBackend):
    capabilities = Capabilities(impedance=True, freedrive=True, payload=True)

    def __init__(self, settings: object, limits: object) -> None:
        cdef int i, dof = checked_dof(limits.dof)
        names = settings.robot
        robot = RobotModel.load(names.model, limits, base=names.base_frame, tcp=names.tcp)
        self._dof = dof
        self._robot = robot
        self._model = robot.mj
        self._model.opt.timestep = settings.rt.period_s
        self._model.actuator_ctrlrange[:] = np.stack([-limits.max_effort, limits.max_effort], axis=1)
        self._data = mujoco.MjData(self._model)
        # Switch off MuJoCo's timers, which are not used. Each of them would read the clock.
        mujoco.set_mjcb_time(None)
        self._c_model, self._c_data = model_of(self._model), data_of(self._data)
        self._sensed = self._c_data
        self._position = self._data.qpos
        self._tcp = self._model.site(names.tcp).id
        self._tcp_body = self._model.site_bodyid[self._tcp]
        mujoco.mj_kinematics(self._model, self._data)
        self._base = names.base_frame
        base_rotation = self._data.body(names.base_frame).xmat.copy()
        for i in range(9):
            self._base_rotation[i] = base_rotation[i]
        self._base_turned = not np.array_equal(base_rotation, np.eye(3).ravel())
        self._jacobian = np.zeros((6, dof))
        self._c_jacobian = doubles(self._jacobian, 6 * dof)
        self._observer = Observer(self._model, self._data, self._jacobian)
        self._springs = Springs(robot, self._data, self._jacobian)
        self.nominal_stiffness = self._springs.joint_stiffness
        self.nominal_cartesian_stiffness = self._springs.tcp_stiffness
        self._losses = self._model.dof_damping.copy(), self._model.dof_frictionloss.copy()
        self._make_up_for_losses()
        self._transition = np.zeros(dof)
        self._c_transition = doubles(self._transition, dof)
        self._transition_cycles = round(TRANSITION_S / settings.rt.period_s)
        self._reported = Measured(dof)
        self._force_address = self._torque_address = -1
        self._fail_read = self._fail_write = self._drive_fault = ""
        self.push, self.jump = np.zeros(6), np.zeros(dof)
        self._pull_cycles = round(PULL_S / settings.rt.period_s)
        self._max_effort = np.array(limits.max_effort, dtype=np.float64)
        self._c_max_effort = doubles(self._max_effort, dof)

    def open(self, initial_position: object) -> None:
        cdef int i
        self._position[:] = initial_position
        self._data.qvel[:] = 0.0
        for i in range(self._dof):
            self._command[i] = self._position[i]
            self._command[self._dof + i] = self._command[2 * self._dof + i] = 0.0
        mujoco.mj_forward(self._model, self._data)
        self._data.ctrl[:] = self._data.qfrc_bias
        mujoco.mj_forward(self._model, self._data)
        self._transition[:] = 0.0
        self._transition_left = 0
        self._find_jacobian()
        self._observer.reset()
        self._find_sensors()
        self._report()

    def enable(self) -> None:
        if self._drive_fault:
            raise BackendError(self._drive_fault)

    def set_tool(self, tool: object) -> None:
        # The next step calculates torques and motion from the same masses, so the arm does not move.
        self._robot.carry(tool)
        mujoco.mj_kinematics(self._model, self._data)
        self._find_sensors()

    def set_impedance(self, impedance: object) -> None:
        # The torque does not jump: the difference between the springs, and between the commands, becomes a
        # term that fades out. If an impedance is set in each cycle, it fades more slowly.
        cdef int i
        if not self._changing:
            self._find_pull()
            for i in range(self._dof):
                self._transition_from[i] = self._pull[i] + self._c_transition[i]
        self._yielding = impedance is not None
        if self._yielding:
            self._springs.use(impedance)
        self._make_up_for_losses()
        self._changing = True

    def read(self, Measured measured not None) -> None:
        if self._read_fails:
            raise BackendError(self._fail_read or self._drive_fault)
        self._take(self._values_of(measured))

    def write(self, command: object) -> None:
        if self._write_fails:
            self._data.qvel[:] = 0.0  # a robot that gets no commands applies its brakes
            raise BackendError(self._fail_write)
        self._step(doubles(command, 3 * self._dof))

    def disable(self) -> None:
        """Do nothing. The simulated arm has no brakes; rtloop simply stops stepping it."""

    def close(self) -> None:
        """Do nothing, because no resources are held."""

    def restart(self, initial_position: object) -> None:
        self.let_go()
        self.open(initial_position)

    def pull(self, link: str, point: object, target: object) -> None:
        cdef int i, body = self._body_of(link)
        place = self._data.body(self._base).xpos + self._data.body(self._base).xmat.reshape(3, 3) @ target
        self._pull_begins = self._pull_left == 0 or body != self._pull_body
        for i in range(3):
            self._pull_begins |= self._pull_point[i] != point[i]
            self._pull_point[i], self._pull_target[i] = point[i], place[i]
        if self._pull_effort is None:
            self._pull_effort = np.zeros(self._stepped.nv)
            self._c_pull_effort = doubles(self._pull_effort, len(self._pull_effort))
        self._pull_body, self._pull_left = body, self._pull_cycles

    def let_go(self) -> None:
        self._pull_left = min(self._pull_left, 1)  # the next cycle clears the force

    cdef int _body_of(self, str link) except -1:
        """Return the body of a link that the joints move, in the stepped model."""
        bodies = [body for body in range(self._model.nbody) if self._model.body_weldid[body]]
        names = [self._model.body(body).name for body in bodies]
        if link not in names:
            raise BackendError(f"there is no link {link!r} that moves; valid names: {', '.join(names)}")
        return self._stepped.body(link).id

    @property
    def _stepped(self):
        """Return the model that the simulation steps."""
        return self._model

    @property
    def fail_read(self) -> str:
        return self._fail_read

    @fail_read.setter
    def fail_read(self, reason: str) -> None:
        self._fail_read = reason
        self._read_fails = bool(self._fail_read or self._drive_fault)

    @property
    def drive_fault(self) -> str:
        return self._drive_fault

    @drive_fault.setter
    def drive_fault(self, reason: str) -> None:
        self._drive_fault = reason
        self._read_fails = bool(self._fail_read or self._drive_fault)

    @property
    def fail_write(self) -> str:
        return self._fail_write

    @fail_write.setter
    def fail_write(self, reason: str) -> None:
        self._fail_write = reason
        self._write_fails = bool(reason)

    @property
    def push(self) -> object:
        return self._push

    @push.setter
    def push(self, wrench: object) -> None:
        self._c_push = doubles(wrench, 6)
        self._push = wrench

    @property
    def jump(self) -> object:
        return self._jump

    @jump.setter
    def jump(self, offset: object) -> None:
        self._c_jump = doubles(offset, self._dof)
        self._jump = offset

    cdef int c_read(self, double* values) noexcept nogil:
        if self._read_fails or self.read_in_python:
            return 1
        self._take(values)
        return 0

    cdef int c_write(self, const double* command) noexcept nogil:
        if self._write_fails or self.write_in_python:
            return 1
        self._step(command)
        return 0

    cdef void _take(self, double* values) noexcept nogil:
        if not self.stale:
            self._report()
        memcpy(values, self._reported.c_values, count_measured(self._dof) * sizeof(double))

    cdef void _step(self, const double* command) noexcept nogil:
        """Advance by one period. M, bias and torque are those at the beginning of the period."""
        mj_step1(self._c_model, self._c_data)
        self._find_torques(command)
        self._push_on(self._c_data, self._tcp_body)
        self._pull_on(self._c_model, self._c_data)
        mj_step2(self._c_model, self._c_data)
        self._observer.c_update()

    cdef void _find_torques(self, const double* command) noexcept nogil:
        """Calculate the drives' torques, and write them to the data's `ctrl`."""
        cdef mjData* data = self._c_data
        cdef double inertia[MAX_DOF]
        cdef int i, dof = self._dof
        self._find_jacobian()
        memcpy(self._command, command, 3 * dof * sizeof(double))
        self._find_pull()
        if self._changing:
            self._begin_transition()
        mj_mulM(self._c_model, data, inertia, command + 2 * dof)
        self._fade_transition()
        for i in range(dof):
            data.ctrl[i] = self._pull[i] + inertia[i] + self._c_transition[i] + data.qfrc_bias[i]

    cdef void _find_jacobian(self) noexcept nogil:
        """Calculate the TCP Jacobian in the base frame, for all later calculations of this cycle."""
        cdef int row, i, half, dof = self._dof
        cdef const double* turn = self._base_rotation
        cdef double column[3]
        cdef double* part
        mj_jacSite(self._c_model, self._c_data, self._c_jacobian, self._c_jacobian + 3 * dof, self._tcp)
        if not self._base_turned:
            return
        for half in range(2):
            part = self._c_jacobian + half * 3 * dof
            for i in range(dof):
                for row in range(3):
                    column[row] = part[row * dof + i]
                for row in range(3):
                    part[row * dof + i] = (
                        turn[row] * column[0] + turn[3 + row] * column[1] + turn[6 + row] * column[2]
                    )

    cdef void _find_pull(self) noexcept nogil:
        """Calculate the torques towards the commanded position and velocity."""
        cdef int i
        if not self._yielding:
            self._pull_stiffly()
            return
        self._springs.c_torques(self._command, self._pull)
        for i in range(self._dof):
            self._pull[i] += (
                self._c_model.dof_damping[i] * self._command[self._dof + i]
                - FRICTION_SHARE * self._observer.c_friction[i]
            )

    cdef void _pull_stiffly(self) noexcept nogil:
        """Calculate the torques of position control. MuJoCo's velocity is the mean over the last period: the
        distance divided by the duration.
        """
        cdef const double* position = self._c_data.qpos
        cdef const double* velocity = self._c_data.qvel
        cdef const double* wanted = self._command + self._dof
        cdef double half_s = 0.5 * self._c_model.opt.timestep
        cdef double acceleration[MAX_DOF]
        cdef int i
        for i in range(self._dof):
            acceleration[i] = (
                NATURAL_FREQUENCY_RAD_S * NATURAL_FREQUENCY_RAD_S * (self._command[i] - position[i])
                + 2.0 * DAMPING_RATIO * NATURAL_FREQUENCY_RAD_S
                * (wanted[i] - half_s * wanted[self._dof + i] - velocity[i])
            )
        mj_mulM(self._c_model, self._c_data, self._pull, acceleration)

    cdef void _begin_transition(self) noexcept nogil:
        cdef int i
        self._changing = False
        for i in range(self._dof):
            self._transition_from[i] -= self._pull[i]
        self._transition_left = self._transition_cycles

    cdef void _fade_transition(self) noexcept nogil:
        cdef int i
        cdef double share
        if self._transition_left == 0:
            return
        self._transition_left -= 1
        share = <double>self._transition_left / <double>self._transition_cycles
        for i in range(self._dof):
            self._c_transition[i] = self._transition_from[i] * share

    cdef void _push_on(self, mjData* data, int body) noexcept nogil:
        """Apply a wrench to a body. MuJoCo expects it at the body's centre of mass, in the world frame."""
        cdef const double* push = self._c_push
        cdef const double* turn = self._base_rotation
        cdef double* force = data.xfrc_applied + 6 * body
        cdef double lever[3]
        cdef bint pushing = False
        cdef int i
        for i in range(6):
            pushing |= push[i] != 0.0
        if not (pushing or self._pushing):
            return
        self._pushing = pushing
        for i in range(3):
            force[i] = turn[3 * i] * push[0] + turn[3 * i + 1] * push[1] + turn[3 * i + 2] * push[2]
            force[3 + i] = turn[3 * i] * push[3] + turn[3 * i + 1] * push[4] + turn[3 * i + 2] * push[5]
            lever[i] = self._c_data.site_xpos[3 * self._tcp + i] - data.xipos[3 * body + i]
        force[3] += lever[1] * force[2] - lever[2] * force[1]
        force[4] += lever[2] * force[0] - lever[0] * force[2]
        force[5] += lever[0] * force[1] - lever[1] * force[0]

    cdef void _pull_on(self, const mjModel* model, mjData* data) noexcept nogil:
        """Calculate the joint efforts of a hand that pulls at a link; zero after the end of the pull."""
        cdef double* effort = self._c_pull_effort
        cdef double point[3]
        cdef double force[3]
        cdef double none[3]
        cdef const double* turn = data.xmat + 9 * self._pull_body
        cdef double size = 0.0, share = 1.0
        cdef int i, dof = self._dof
        if self._pull_left == 0:
            return
        self._pull_left -= 1
        if not self._yielding:
            self._pull_left = 0
        memset(data.qfrc_applied, 0, dof * sizeof(double))
        if self._pull_left == 0:
            return
        memset(effort, 0, model.nv * sizeof(double))
        for i in range(3):
            none[i] = 0.0
            point[i] = data.xpos[3 * self._pull_body + i] + (
                turn[3 * i] * self._pull_point[0]
                + turn[3 * i + 1] * self._pull_point[1]
                + turn[3 * i + 2] * self._pull_point[2]
            )
            force[i] = PULL_N_M * (self._pull_target[i] - point[i])
            if not self._pull_begins:
                force[i] -= PULL_NS_M * (point[i] - self._pull_last[i]) / model.opt.timestep
            self._pull_last[i] = point[i]
            size += force[i] * force[i]
        self._pull_begins = False
        size = sqrt(size)
        if size > MAX_PULL_N:
            for i in range(3):
                force[i] *= MAX_PULL_N / size
        mj_applyFT(model, data, force, none, point, self._pull_body, effort)
        for i in range(dof):
            if fabs(effort[i]) > MAX_PULL_SHARE * self._c_max_effort[i]:
                share = fmin(share, MAX_PULL_SHARE * self._c_max_effort[i] / fabs(effort[i]))
        for i in range(dof):  # The joints of a hand have their own drives.
            data.qfrc_applied[i] = effort[i] * share

    cdef void _report(self) noexcept nogil:
        cdef const mjData* data = self._c_data
        cdef double* values = self._reported.c_values
        cdef int i, dof = self._dof
        for i in range(dof):
            values[POSITION_ROW * dof + i] = data.qpos[i] + self._c_jump[i]
            values[VELOCITY_ROW * dof + i] = data.qvel[i]
            # The torque, clamped.
            values[EFFORT_ROW * dof + i] = NAN if self.not_finite else data.actuator_force[i]
            values[DESIRED_EFFORT_ROW * dof + i] = data.ctrl[i]
            values[EXTERNAL_EFFORT_ROW * dof + i] = self._observer.c_effort[i]
        values += MEASURED_ROWS * dof
        memcpy(values, self._observer.c_wrench, 6 * sizeof(double))
        self._read_sensors(values + 6)

    cdef void _read_sensors(self, double* wrench) noexcept nogil:
        """Calculate the wrench of the flange's sensors about the TCP, in the TCP frame; zero without
        sensors.
        """
        cdef double readings[6]
        cdef double product
        cdef int row, i
        if self._force_address < 0:
            return
        memcpy(readings, self._sensed.sensordata + self._force_address, 3 * sizeof(double))
        memcpy(readings + 3, self._sensed.sensordata + self._torque_address, 3 * sizeof(double))
        for row in range(6):
            product = 0.0
            for i in range(6):
                product += self._from_sensors[6 * row + i] * readings[i]
            wrench[row] = product

    cdef _make_up_for_losses(self):
        """Make dry friction and damping act on the arm only while it has an impedance."""
        share = 1.0 if self._yielding else 0.0
        self._model.dof_damping[:], self._model.dof_frictionloss[:] = (share * each for each in self._losses)

    cdef _find_sensors(self):
        """Calculate the matrix, shape (6, 6), that converts MuJoCo's sensors `flange_force` and
        `flange_torque`, if the model has them, into a wrench about the TCP in the TCP frame.

        MuJoCo reports the force that holds the flange. The force of the surroundings has the opposite sign.
        """
        cdef double* turns = self._from_sensors
        model, data = self._model, self._data
        names = {model.sensor(index).name: index for index in range(model.nsensor)}
        if not {"flange_force", "flange_torque"} <= names.keys():
            return
        site = model.sensor_objid[names["flange_force"]]
        rotation, to_tcp = (data.site_xmat[i].reshape(3, 3) for i in (site, self._tcp))
        x, y, z = to_tcp.T @ (data.site_xpos[site] - data.site_xpos[self._tcp])
        lever = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turn = -to_tcp.T @ rotation
        whole = np.block([[turn, np.zeros((3, 3))], [lever @ turn, turn]])
        cdef int i
        for i in range(36):
            turns[i] = whole.flat[i]
        self._force_address, self._torque_address = (
            model.sensor_adr[names[name]] for name in ("flange_force", "flange_torque")
        )
