"""The arm angle of S-R-S arms, for compiled code; see `srs.pyx`."""

from cobot.robot.inverse_kinematics.arm cimport Arm, Candidate, Problem
from cobot.robot.inverse_kinematics.triple cimport Triple
from cobot.robot.inverse_kinematics.vectors cimport Hinge

cdef enum:
    # Six joints have two limits each, and each is reached at up to two arm angles. In addition: the ends of
    # the range of a triple whose axes are not at right angles.
    MAX_BREAKS = 32
    MAX_SEGMENTS = 320


cdef struct Elbow:
    double angle      # of the fourth joint, from rest
    # the frame from which the arm angle is measured, z from shoulder to wrist, in the base frame
    double front[9]
    double back[9]    # the same in the upper arm, as it is at rest
    double inner[9]   # the same in the forearm at rest, transposed
    double kept[9]    # frontᵀ times the rotation that the joints must give


cdef struct Turned:
    bint shoulder_fits[2]
    bint wrist_fits[2]
    double shoulder[2][3]
    double wrist[2][3]


cdef struct Places:
    int count
    double begins[MAX_SEGMENTS + 1]   # of segments of the arm angle, ascending, and the end of the last one
    Turned turned[MAX_SEGMENTS]       # in the middle of each


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
    cdef void _look(self, const Problem* problem, const Elbow* elbow, Places* places) noexcept nogil
    cdef void _look_along(
        self, const Problem* problem, const Elbow* elbow, double begin, double end, const Turned* middle,
        Places* places
    ) noexcept nogil
    cdef void _look_at(
        self, const Problem* problem, const Elbow* elbow, Places* places, int segment, const Turned* whole
    ) noexcept nogil
    cdef void _divide(
        self, const Problem* problem, const Elbow* elbow, double best, Places* places
    ) noexcept nogil
    cdef bint _is_coarse(
        self, const Problem* problem, const Elbow* elbow, const Places* places, int one, int other,
        double best
    ) noexcept nogil
    cdef void _split(
        self, const Problem* problem, const Elbow* elbow, Places* places, int segment
    ) noexcept nogil
    cdef double _least_cost(
        self, const Problem* problem, const Elbow* elbow, const Turned* turned, int without, double slack
    ) noexcept nogil
    cdef double _triple_cost(
        self, const Problem* problem, int joint, const bint* fits, const double* one, const double* other
    ) noexcept nogil
    cdef int _candidates(
        self, const Problem* problem, bint minus, int kind, Candidate* found, int count
    ) noexcept nogil
    cdef int _runs(
        self, const Problem* problem, const Elbow* elbow, const Places* places, int branch, int kind,
        Candidate* found, int count
    ) noexcept nogil
    cdef int _run(
        self, const Problem* problem, const Elbow* elbow, const Places* places, int branch, int kind,
        int first, int length, Candidate* found, int count
    ) noexcept nogil
    cdef double _cost_at(
        self, const Problem* problem, const Elbow* elbow, double angle, int branch, double* joints
    ) noexcept nogil
    cdef double _elbow_cost(self, const Problem* problem, const Elbow* elbow) noexcept nogil
    cdef double _try(
        self, const Problem* problem, const Elbow* elbow, double angle, Candidate* candidate, double* joints
    ) noexcept nogil
    cdef void _grid(
        self, const double* poses, Py_ssize_t n, const double* angles, Py_ssize_t m, const double* only,
        int count, double* out
    ) noexcept nogil
    cdef void _lead_on(
        self, const double* poses, Py_ssize_t n, const double* angles, Py_ssize_t m, const double* start,
        int branch, int window, double step_rad, char* near, double* out
    ) noexcept nogil
    cdef void _fill(
        self, const Problem* problem, const Elbow* elbow, const double* angles, Py_ssize_t m, int branch,
        const char* near, double* out, int every
    ) noexcept nogil
