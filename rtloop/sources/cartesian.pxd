from cobot.arrays cimport MAX_DOF
from cobot.robot.chain cimport Chain
from rtloop.generators.pose_interpolation cimport MinJerkMove, PoseInterpolator
from rtloop.generators.pose_limiter cimport PoseLimiter
from rtloop.generators.target_range cimport PoseRange
from rtloop.sources.source cimport Source

cdef enum:
    TASK = 6  # The dimensions of a pose's error, a twist and a wrench.


cdef struct ForceControl:
    # The control along the axes of the force frame.
    bint enabled
    bint in_tcp  # Whether the frame is given in the TCP frame; if not, in the base frame.
    bint axes[TASK]
    double velocity[TASK]  # Maximum speed, m/s and rad/s.
    double gain[TASK]  # m/s per N, rad/s per N·m.
    double wrench[TASK]  # Requested at the TCP, N and N·m.
    double origin[3]
    double orientation[4]
    double turn[9]  # Rotation of the frame in the base frame; its axes are the columns.
    double lever[3]  # From the TCP to the frame's origin, in the base frame.
    double pull[2 * TASK]  # Two stages of a low-pass filter.


cdef class CartesianSource(Source):
    cdef readonly bint move_running
    cdef Chain chain
    cdef PoseInterpolator interpolator
    cdef PoseLimiter limiter
    cdef PoseRange poses
    cdef bint looks_ahead
    cdef MinJerkMove move
    cdef ForceControl force
    cdef double period_s, command_s
    cdef double tcp_velocity[2]
    cdef double tcp_acceleration[2]
    cdef double tcp_jerk[2]
    cdef double lowest[MAX_DOF]
    cdef double highest[MAX_DOF]
    cdef double max_velocity[MAX_DOF]
    cdef double posture[MAX_DOF]
    cdef double pull[2 * MAX_DOF]
    cdef double before[MAX_DOF]
    cdef double commanded[MAX_DOF]
    cdef double jacobian[6 * MAX_DOF]  # The Jacobian at the reference of the previous cycle.
    cdef double goal[7]
    cdef double last[7]
    cdef bint own_posture
    cdef double spoilt_norm

    cdef void c_press(self, const double* wrench) noexcept nogil
    cdef int c_start_move(self, const double* pose, double duration_s) noexcept nogil
    cdef void c_cancel_move(self) noexcept nogil
    cdef bint c_is_pose(self, const double* pose, const double* wrench, const double* twist) noexcept nogil
    cdef void c_find_fastest(self, double interval_s, double* fastest) noexcept nogil
    cdef double c_shortest_move_s(self, const double* pose) noexcept nogil
    cdef const double* c_next_pose(self, const double* external_effort, const double* wrench) noexcept nogil
    cdef void c_step_joints(self, const double* pose, const double* wrench) noexcept nogil
    cdef void c_pull_at_posture(self, double* step) noexcept nogil
    cdef void c_distance_to(
        self, const double* pose, double* here, double* error, double* jacobian
    ) noexcept nogil
    cdef void c_replace_by_force(
        self, const double* here, const double* wrench, double* error
    ) noexcept nogil
