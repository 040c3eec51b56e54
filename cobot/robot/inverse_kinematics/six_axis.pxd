"""Six-axis arms in closed form, for compiled code; see `six_axis.pyx`."""

from cobot.robot.inverse_kinematics.arm cimport Arm, Candidate, Problem
from cobot.robot.inverse_kinematics.triple cimport Triple
from cobot.robot.inverse_kinematics.vectors cimport Hinge


cdef class SixAxisArm(Arm):
    cdef int kind
    cdef double axes[6][3]
    cdef double points[6][3]   # a point on each axis, at rest
    cdef double wrist[3]       # where the last axes meet, at rest
    # 1, or -1 if the third and fourth axis have the opposite direction of the second one
    cdef double sense[2]
    cdef Triple triple         # of the wrist, or of the second, fifth and sixth axis
    cdef Hinge hinge           # the joint that determines the distance of the wrist

    cdef int _solutions(self, const Problem* problem, Candidate* found) noexcept nogil
    cdef void _about(self, int joint, double angle, const double* point, double* out) noexcept nogil
    cdef void _wrist_of(self, const Problem* problem, double* out) noexcept nogil
    cdef int _base_angles(
        self, const Problem* problem, const double* wrist, double* angles, int* ways
    ) noexcept nogil
    cdef double _across(self, int joint, const double* point) noexcept nogil
    cdef int _planar(
        self, const Problem* problem, double first, const double* there, double theta[2][6]
    ) noexcept nogil
    cdef int _crossing(self, const Problem* problem, const double* wrist, Candidate* found) noexcept nogil
    cdef int _solve_stack(self, const Problem* problem, const double* wrist, Candidate* found) noexcept nogil
    cdef int _in_a_plane(self, const Problem* problem, const double* wrist, Candidate* found) noexcept nogil
    cdef int _parallel(self, const Problem* problem, const double* wrist, Candidate* found) noexcept nogil
    cdef int _with_wrist(
        self, const Problem* problem, double* theta, int branch, Candidate* found, int count
    ) noexcept nogil
    cdef int _with_plane(
        self, const Problem* problem, const double* five, double turn, int branch, Candidate* found, int count
    ) noexcept nogil
    cdef int _offer(
        self, const Problem* problem, const double* theta, int branch, Candidate* found, int count
    ) noexcept nogil
    cdef int _turn_to(
        self, const Problem* problem, double* theta, const double* start, const double* goal, bint any_angle,
        int branch, Candidate* found, int count
    ) noexcept nogil
    cdef void _about_wrist(self, int joint, double angle, const double* point, double* out) noexcept nogil
