"""The arm angle of S-R-S arms, for compiled code; see `srs.pyx`."""

from cobot.robot.inverse_kinematics.arm cimport Arm, Candidate, Problem
from cobot.robot.inverse_kinematics.triple cimport Triple
from cobot.robot.inverse_kinematics.vectors cimport Hinge

cdef enum:
    # The limits of six joints, each at two angles, and where a triple of axes that are not square ends.
    MAX_BREAKS = 32
    MAX_SEGMENTS = 64


cdef struct Elbow:
    double angle      # of the fourth joint, from rest
    double front[9]   # the frame in which the arm angle is counted, z from shoulder to wrist, in the base
    double back[9]    # the same in the upper arm, as it is at rest
    double inner[9]   # the same in the forearm at rest, transposed
    double kept[9]    # frontᵀ times what the joints have to turn


cdef struct Turned:
    bint shoulder_fits[2]
    bint wrist_fits[2]
    double shoulder[2][3]
    double wrist[2][3]


cdef class SrsArm(Arm):
    cdef Triple shoulder
    cdef Triple wrist
    cdef double centre[3]         # of the shoulder, in the base frame
    cdef double wrist_centre[3]   # at rest
    cdef Hinge elbow
    cdef double pole[9]           # the frame of the arm angle for a wrist straight along the first axis

    cdef bint c_joints(self, const double* pose, double angle, int branch, double* joints) noexcept nogil
    cdef bint _elbow(self, const Problem* problem, bint minus, Elbow* out) noexcept nogil
    cdef void _to_wrist(self, const Problem* problem, double* out) noexcept nogil
    cdef void _frame(self, const double* direction, double* out) noexcept nogil
    cdef bint _upper_frame(self, double angle, double* out) noexcept nogil
    cdef void _turn(
        self, const Problem* problem, const Elbow* elbow, double angle, Turned* out
    ) noexcept nogil
    cdef void _assemble(
        self, const Elbow* elbow, const Turned* turned, int branch, double* joints
    ) noexcept nogil
    cdef int _breaks(self, const Elbow* elbow, double* out) noexcept nogil
    cdef int _breaks_of(
        self, const Triple* triple, int joint, const double* left, const double* right, double sense,
        double* out
    ) noexcept nogil
    cdef int _segments(self, const Elbow* elbow, double* out) noexcept nogil
    cdef int _candidates(
        self, const Problem* problem, bint minus, Candidate* found, int count
    ) noexcept nogil
    cdef int _runs(
        self, const Problem* problem, const Elbow* elbow, const double* points, const Turned* turned,
        int segments, int branch, Candidate* found, int count
    ) noexcept nogil
    cdef double _cost_at(
        self, const Problem* problem, const Elbow* elbow, double angle, int branch, double* joints
    ) noexcept nogil
    cdef double _elbow_cost(self, const Problem* problem, const Elbow* elbow) noexcept nogil
    cdef double _try(
        self, const Problem* problem, const Elbow* elbow, double angle, Candidate* candidate, double* joints
    ) noexcept nogil
    cdef void _parabola(
        self, const Problem* problem, const Elbow* elbow, Candidate* candidate, double width
    ) noexcept nogil
    cdef void _grid(
        self, const double* poses, Py_ssize_t n, const double* angles, Py_ssize_t m, int wanted, double* out
    ) noexcept nogil
