"""Converts Cartesian targets to joint references, with motion along some axes and force along the others.

Poses consist of x, y, z in m and a quaternion (w, x, y, z). Errors and twists have the linear part first. All
are in the base frame.

Along axes with force control, the force error replaces the pose error. One least-squares step then solves for
all axes (`c_step_joints`).
"""

from libc.math cimport cbrt, fabs, isfinite, sqrt
from libc.string cimport memcpy, memset

from cobot.arrays cimport MAX_DOF, doubles
from cobot.robot.linear cimport cholesky_solve
from cobot.robot.quaternion cimport cross3, quat_between, quat_product, quat_rotated, quat_to_matrix
from rtloop.sources.source cimport FINE, JUMP, LEAD_RAD, NOT_FINITE, Setpoint, Source, flaw_of
from rtloop.sources.target_checks cimport (
    POSE_PASSES,
    SLACK_S,
    c_clamped_interval,
    c_is_finite,
    c_pose_jump,
)

import numpy as np

from cobot.ipc.layout import Interpolation
from cobot.ipc.session_rules import FORCE_RATE_RAD_S
from rtloop.generators.pose_interpolation import MinJerkMove, PoseInterpolator
from rtloop.generators.pose_limiter import PoseLimiter
from rtloop.generators.target_range import PoseRange
from rtloop.sources.target_checks import ANGULAR_VELOCITY, LINEAR_VELOCITY

# Damping of the inverse, m². Near a singularity, the joint velocity limits take over.
cdef double DAMPING = 1e-5
cdef double POSTURE_RATE_RAD_S = 1.0
cdef double POSTURE_VELOCITY_RAD_S = 0.2
# Time constants. The pull towards the posture and the motion by forces each pass through two filters, so that
# they do not jerk the joints.
cdef double POSTURE_FILTER_S = 0.1
cdef double FORCE_FILTER_S = 0.03
cdef double VELOCITY_SHARE = 0.98
cdef double UNIT_TOLERANCE = 1e-3
cdef double MAX_LINEAR = LINEAR_VELOCITY
cdef double MAX_ANGULAR = ANGULAR_VELOCITY


cdef inline double clamped(double value, double bound) noexcept nogil:
    return min(max(value, -bound), bound)


cdef inline double low_pass(double* first, double* second, double value, double share) noexcept nogil:
    """Return the value after two low-pass filters in series."""
    first[0] += share * (value - first[0])
    second[0] += share * (first[0] - second[0])
    return second[0]


cdef inline bint c_moves(const double* twist) noexcept nogil:
    """Whether a stated twist is not zero."""
    cdef int axis
    for axis in range(TASK):
        if twist[axis] != 0.0:
            return True
    return False


cdef inline double norm3(const double* v) noexcept nogil:
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


cdef class CartesianSource(Source):
    """A source of joint references that follow TCP poses, interpolated and within the Cartesian limits.

    Along an axis with force control, the arm moves in proportion to the force error.

    Attributes:
        move_running: whether a `move_to_pose` is running.
    """

    def __init__(self, kind, model, limits, within, double period_s, double command_s, request):
        """
        Args:
            kind: kind of interpolation between poses.
            model: model of the robot.
            limits, within: joint and TCP limits.
            period_s: cycle period.
            command_s: interval between two poses.
            request: request for the session, a record of `cobot.ipc.layout.session_dtype`.
        """
        super().__init__(limits.dof)
        self.chain = model.chain
        self.period_s = period_s
        self.command_s = command_s
        self.interpolator = PoseInterpolator(
            kind,
            period_s,
            within.max_linear_velocity,
            within.max_linear_acceleration,
            within.max_linear_jerk,
            within.max_angular_velocity,
            within.max_angular_acceleration,
            within.max_angular_jerk,
        )
        self.limiter = PoseLimiter(period_s, within)
        self.poses = PoseRange(period_s, command_s)
        # whether the motion continues after a pose; otherwise the TCP stops at each pose
        self.looks_ahead = kind is not Interpolation.NONE
        if self.looks_ahead:
            self.limiter.c_stay_within(self.poses)
        nowhere = np.array([0.0, 0, 0, 1, 0, 0, 0])
        self.move = MinJerkMove(nowhere, nowhere, 1.0, period_s)
        self.move_running = False
        self.tcp_velocity[0], self.tcp_velocity[1] = within.max_linear_velocity, within.max_angular_velocity
        self.tcp_acceleration[0] = within.max_linear_acceleration
        self.tcp_acceleration[1] = within.max_angular_acceleration
        self.tcp_jerk[0], self.tcp_jerk[1] = within.max_linear_jerk, within.max_angular_jerk
        for joint in range(self.dof):
            self.lowest[joint], self.highest[joint] = limits.min_position[joint], limits.max_position[joint]
            self.max_velocity[joint] = limits.max_velocity[joint]
            self.posture[joint] = request["posture"][joint]
        self.own_posture = not np.isfinite(request["posture"]).all()
        self.spoilt_norm = 0.0
        memset(self.goal, 0, sizeof(self.goal))
        self._set_force_control(request)

    def _set_force_control(self, request):
        cdef ForceControl* force = &self.force
        stiffness = request["cartesian_stiffness"]
        memset(force, 0, sizeof(ForceControl))
        for axis in range(TASK):
            force.axes[axis] = bool(request["force_axes"][axis] > 0.0)
            force.velocity[axis] = request["force_velocity"][axis]
            # A backend without compliance has no stiffness, and its sessions have no force axes.
            stiffest = float(stiffness[:3].max() if axis < 3 else stiffness[3:].max())
            force.gain[axis] = FORCE_RATE_RAD_S / stiffest if stiffest else 0.0
        force.enabled = bool((request["force_axes"] > 0.0).any())
        force.in_tcp = bool(request["force_in_tcp"])
        for axis in range(3):
            force.origin[axis] = request["force_frame"][axis]
        for axis in range(4):
            force.orientation[axis] = request["force_frame"][3 + axis]
        quat_to_matrix(force.orientation, force.turn)

    def explain(self):
        if self.spoilt_norm:
            return f"the streamed quaternion's norm is {self.spoilt_norm:.4f}, not 1"
        return "a streamed pose, wrench or velocity is not finite"

    def press(self, wrench):
        """From now on, exert this wrench, shape (6,), in the force frame. A wrench that is not finite is
        ignored.
        """
        wanted = np.array(wrench, float)
        self.c_press(doubles(wanted, TASK))

    def start_move(self, pose, double duration_s):
        """Move to a pose on a minimum-jerk motion. A running motion to the same pose continues. Returns the
        flaw of the pose, or None.
        """
        goal = np.array(pose, float)
        return flaw_of(self.c_start_move(doubles(goal, 7), duration_s))

    def cancel_move(self):
        """Cancel the move. The next target then determines the motion."""
        self.c_cancel_move()

    cdef void c_begin(self, const double* command) noexcept nogil:
        cdef double twist[TASK]
        cdef int joint, axis
        memcpy(self.ref, command, 3 * self.dof * sizeof(double))
        memcpy(self.commanded, command, self.dof * sizeof(double))
        memcpy(self.before, command + self.dof, self.dof * sizeof(double))
        memset(self.pull, 0, sizeof(self.pull))
        memset(self.force.pull, 0, sizeof(self.force.pull))
        if self.own_posture:
            memcpy(self.posture, command, self.dof * sizeof(double))
            self.own_posture = False
        self.chain.c_forward_jacobian(command, self.last, self.jacobian)
        for axis in range(TASK):
            twist[axis] = 0.0
            for joint in range(self.dof):
                twist[axis] += self.jacobian[axis * self.dof + joint] * command[self.dof + joint]
        self.interpolator.c_begin(self.last, twist, NULL)
        self.limiter.c_begin(self.last, twist)
        self.poses.c_begin(self.last)
        self.move_running = False

    cdef int c_take(self, const Setpoint* setpoint, double interval_s) noexcept nogil:
        cdef double fastest[2]
        cdef bint states_twist
        if not self.c_is_pose(setpoint.pose, setpoint.wrench, setpoint.twist):
            return NOT_FINITE
        memcpy(self.force.wrench, setpoint.wrench, sizeof(self.force.wrench))
        self.c_find_fastest(interval_s, fastest)
        if c_pose_jump(setpoint.pose, self.last, interval_s, fastest[0], fastest[1]) != POSE_PASSES:
            return JUMP
        memcpy(self.last, setpoint.pose, sizeof(self.last))
        # A pose that does not change has no twist, even if one is stated.
        states_twist = setpoint.feed_forward[0] and not self.poses.c_stands(setpoint.pose)
        self.poses.c_update(setpoint.pose, states_twist and c_moves(setpoint.twist))
        self.interpolator.c_aim(setpoint.pose, setpoint.twist if states_twist else NULL, self.command_s)
        return FINE

    cdef bint c_is_pose(self, const double* pose, const double* wrench, const double* twist) noexcept nogil:
        """Whether all values are finite, and the quaternion has unit length."""
        cdef double norm
        self.spoilt_norm = 0.0
        if not (c_is_finite(pose, 7) and c_is_finite(wrench, TASK) and c_is_finite(twist, TASK)):
            return False
        norm = sqrt(pose[3] * pose[3] + pose[4] * pose[4] + pose[5] * pose[5] + pose[6] * pose[6])
        if fabs(norm - 1.0) <= UNIT_TOLERANCE:
            return True
        self.spoilt_norm = norm
        return False

    cdef void c_find_fastest(self, double interval_s, double* fastest) noexcept nogil:
        """Calculate the maximum TCP speed, m/s and rad/s: the specified limit or, if lower, the speed at the
        joints' velocity limits. The latter has a margin for the client's jitter.
        """
        cdef double slack = 1.0 + SLACK_S / c_clamped_interval(interval_s)
        cdef double reach[TASK]
        cdef int axis, joint
        for axis in range(TASK):
            reach[axis] = 0.0
            for joint in range(self.dof):
                reach[axis] += fabs(self.jacobian[axis * self.dof + joint]) * self.max_velocity[joint]
        fastest[0] = min(MAX_LINEAR, norm3(reach) * slack)
        fastest[1] = min(MAX_ANGULAR, norm3(reach + 3) * slack)

    cdef void c_press(self, const double* wrench) noexcept nogil:
        """Like `press`, for compiled code."""
        if c_is_finite(wrench, TASK):
            memcpy(self.force.wrench, wrench, sizeof(self.force.wrench))

    cdef int c_start_move(self, const double* pose, double duration_s) noexcept nogil:
        """Like `start_move`, for compiled code."""
        cdef bint same = self.move_running
        cdef int index
        if not self.c_is_pose(pose, self.force.wrench, self.force.wrench) or not isfinite(duration_s):
            return NOT_FINITE
        for index in range(7):
            same = same and pose[index] == self.goal[index]
        if not same:
            memcpy(self.goal, pose, sizeof(self.goal))
            self.move.c_begin(self.limiter.c_pose, pose, max(duration_s, self.c_shortest_move_s(pose)))
            self.move_running = True
            self.poses.c_open()
        return FINE

    cdef void c_cancel_move(self) noexcept nogil:
        """Like `cancel_move`, for compiled code."""
        self.move_running = False
        self.poses.c_begin(self.last)

    cdef double c_shortest_move_s(self, const double* pose) noexcept nogil:
        """Return the shortest duration of a move within the limits. For a minimum-jerk motion of length l in
        time t, the maximum velocity is 15/8 l/t, the maximum acceleration 10/√3 l/t², and the maximum jerk 60
        l/t³.
        """
        cdef double way[TASK]
        cdef double length, shortest_s = 0.0
        cdef int part
        for part in range(3):
            way[part] = pose[part] - self.limiter.c_pose[part]
        quat_between(self.limiter.c_pose + 3, pose + 3, way + 3)
        for part in range(2):
            length = norm3(way + 3 * part)
            shortest_s = max(shortest_s, 1.875 * length / self.tcp_velocity[part])
            shortest_s = max(shortest_s, sqrt(5.7735 * length / self.tcp_acceleration[part]))
            shortest_s = max(shortest_s, cbrt(60.0 * length / self.tcp_jerk[part]))
        return shortest_s

    cdef void c_advance(self, const double* external_effort, const double* wrench) noexcept nogil:
        cdef double lead = 0.0
        cdef int joint
        for joint in range(self.dof):
            lead = max(lead, fabs(self.ref[joint] - self.commanded[joint]))
        if lead > LEAD_RAD:
            memset(self.ref + self.dof, 0, 2 * self.dof * sizeof(double))
            return
        self.c_step_joints(self.c_next_pose(external_effort, wrench), wrench)

    cdef const double* c_next_pose(self, const double* external_effort, const double* wrench) noexcept nogil:
        """Return the commanded TCP pose in this cycle."""
        if not self.move_running:
            self.poses.c_advance()
            self.interpolator.c_advance()
            self.limiter.c_step(self.interpolator.c_pose)
            return self.limiter.c_pose
        self.move.c_advance()
        self.limiter.c_step(self.move.c_pose)
        if self.move.done and not self.limiter.limited:
            self.move_running = False
            memcpy(self.last, self.goal, sizeof(self.last))
            self.interpolator.c_begin(self.limiter.c_pose, NULL, NULL)
            self.poses.c_begin(self.goal)
        return self.limiter.c_pose

    cdef void c_follow(self, const double* command) noexcept nogil:
        memcpy(self.commanded, command, self.dof * sizeof(double))

    cdef void c_heading(self, double* step) noexcept nogil:
        """Calculate the heading. Only a stream that is held because of a collision needs it, so it is
        calculated on request.
        """
        cdef double here[7]
        cdef double error[TASK]
        cdef double jacobian[TASK * MAX_DOF]
        cdef int joint, axis
        self.c_distance_to(&self.goal[0] if self.move_running else &self.last[0], here, error, jacobian)
        solve_damped(jacobian, self.dof, error)
        for joint in range(self.dof):
            step[joint] = 0.0
            for axis in range(TASK):
                step[joint] += jacobian[axis * self.dof + joint] * error[axis]

    cdef void c_step_joints(self, const double* pose, const double* wrench) noexcept nogil:
        """Make the joint step that reduces the distance to the pose, by least squares. In the null space, the
        posture is pulled towards its reference: z + J⁺ (e - J z).
        """
        cdef double here[7]
        cdef double error[TASK]
        cdef double step[MAX_DOF]
        cdef double excess = 0.0, most, velocity, target
        cdef double* jacobian = self.jacobian
        cdef int dof = self.dof, joint, axis
        self.c_distance_to(pose, here, error, jacobian)
        if self.force.enabled:
            self.c_replace_by_force(here, wrench, error)
        self.c_pull_at_posture(step)
        for axis in range(TASK):
            for joint in range(dof):
                error[axis] -= jacobian[axis * dof + joint] * step[joint]
        solve_damped(jacobian, dof, error)
        for joint in range(dof):
            for axis in range(TASK):
                step[joint] += jacobian[axis * dof + joint] * error[axis]
            most = VELOCITY_SHARE * self.max_velocity[joint] * self.period_s
            excess = max(excess, fabs(step[joint]) / most)
        for joint in range(dof):
            if excess > 1.0:
                step[joint] /= excess
            target = min(max(self.ref[joint] + step[joint], self.lowest[joint]), self.highest[joint])
            velocity = (target - self.ref[joint]) / self.period_s
            self.ref[2 * dof + joint] = (velocity - self.before[joint]) / self.period_s
            self.ref[dof + joint] = self.before[joint] = velocity
            self.ref[joint] = target

    cdef void c_pull_at_posture(self, double* step) noexcept nogil:
        """Calculate the joint step for the null space, rad."""
        cdef double wanted
        cdef int joint
        for joint in range(self.dof):
            wanted = clamped(
                POSTURE_RATE_RAD_S * (self.posture[joint] - self.ref[joint]), POSTURE_VELOCITY_RAD_S
            )
            step[joint] = self.period_s * low_pass(
                &self.pull[joint], &self.pull[self.dof + joint], wanted, self.period_s / POSTURE_FILTER_S
            )

    cdef void c_distance_to(
        self, const double* pose, double* here, double* error, double* jacobian
    ) noexcept nogil:
        """Calculate the distance from the reference's TCP pose to a pose, in the base frame, m and rad, and
        the Jacobian at the reference.
        """
        cdef int axis
        self.chain.c_forward_jacobian(self.ref, here, jacobian)
        for axis in range(3):
            error[axis] = pose[axis] - here[axis]
        quat_between(here + 3, pose + 3, error + 3)

    cdef void c_exert(self, double* rows) noexcept nogil:
        cdef ForceControl* force = &self.force
        cdef double moment[3]
        cdef int part, axis, index
        for part in range(2):
            for axis in range(3):
                for index in range(3):
                    if force.axes[3 * part + index]:
                        rows[3 * part + axis] += (
                            force.turn[3 * axis + index] * force.wrench[3 * part + index]
                        )
        cross3(force.lever, rows, moment)
        for axis in range(3):
            rows[3 + axis] += moment[axis]

    cdef void c_replace_by_force(
        self, const double* here, const double* wrench, double* error
    ) noexcept nogil:
        """Along the force axes, replace the step with one in proportion to the force error."""
        cdef ForceControl* force = &self.force
        cdef double orientation[4]
        cdef double moment[3]
        cdef double rows[TASK]
        cdef double in_frame[TASK]
        cdef double missing, smooth
        cdef int axis
        if force.in_tcp:
            quat_product(here + 3, force.orientation, orientation)
            quat_to_matrix(orientation, force.turn)
            quat_rotated(here + 3, force.origin, force.lever)
        memcpy(rows, wrench, sizeof(rows))
        cross3(force.lever, rows, moment)
        subtract3(rows + 3, moment)
        into_frame(force.turn, rows, in_frame)
        for axis in range(TASK):
            # The TCP exerts the opposite of the external wrench.
            missing = force.wrench[axis] + in_frame[axis]
            smooth = low_pass(
                &force.pull[axis],
                &force.pull[TASK + axis],
                clamped(force.gain[axis] * missing, force.velocity[axis]),
                self.period_s / FORCE_FILTER_S,
            )
            in_frame[axis] = smooth
        memcpy(rows, error, sizeof(rows))
        cross3(force.lever, rows + 3, moment)
        subtract3(rows, moment)
        replace_axes(force, rows, in_frame, self.period_s)
        cross3(force.lever, rows + 3, moment)
        for axis in range(3):
            rows[axis] += moment[axis]
        memcpy(error, rows, sizeof(rows))


cdef inline void subtract3(double* from_, const double* other) noexcept nogil:
    cdef int index
    for index in range(3):
        from_[index] -= other[index]


cdef void into_frame(const double* turn, const double* rows, double* in_frame) noexcept nogil:
    """Transform two vectors from the base frame into the frame whose axes are the columns of `turn`."""
    cdef int part, axis, index
    for part in range(2):
        for axis in range(3):
            in_frame[3 * part + axis] = 0.0
            for index in range(3):
                in_frame[3 * part + axis] += rows[3 * part + index] * turn[3 * index + axis]


cdef void replace_axes(
    const ForceControl* force, double* rows, const double* velocity, double period_s
) noexcept nogil:
    """Along the force axes, replace a step in the base frame with the motion at these velocities in one
    period.
    """
    cdef double in_frame[TASK]
    cdef int part, axis, index
    into_frame(force.turn, rows, in_frame)
    for axis in range(TASK):
        if force.axes[axis]:
            in_frame[axis] = velocity[axis] * period_s
    for part in range(2):
        for axis in range(3):
            rows[3 * part + axis] = 0.0
            for index in range(3):
                rows[3 * part + axis] += in_frame[3 * part + index] * force.turn[3 * axis + index]


cdef void solve_damped(const double* jacobian, int dof, double* error) noexcept nogil:
    """Calculate (J J' + damping)⁻¹ e in place."""
    cdef double square[TASK * TASK]
    cdef int row, column, joint
    for row in range(TASK):
        for column in range(row + 1):
            square[TASK * row + column] = DAMPING if row == column else 0.0
            for joint in range(dof):
                square[TASK * row + column] += jacobian[row * dof + joint] * jacobian[column * dof + joint]
            square[TASK * column + row] = square[TASK * row + column]
    cholesky_solve(square, TASK, error)
