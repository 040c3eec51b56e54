"""Inverse kinematics of any serial arm, for compiled code; see `arm.pyx`."""

from cobot.arrays cimport MAX_DOF
from cobot.robot.chain cimport Chain

cdef enum:
    MAX_CANDIDATES = 192

cdef enum:
    # Which rotation of the TCP a pose leaves free: none, or all three; 0 to 2 is an axis of the TCP.
    FIXED = -1
    ANY_ROTATION = 3

cdef enum:
    NEAREST = 0
    LIMITS = 1
    MANIPULABILITY = 2


cdef struct Problem:
    double position[3]       # of the TCP in the base frame, m
    double rotation[9]
    double moved[9]          # the motion that the joints must give to the frames at rest: rotation ...
    double shift[3]          # ... and then translation
    double seed[MAX_DOF]     # of the joints
    double near[MAX_DOF]     # the seed, moved into the limits and counted from rest
    int criterion
    double slack             # angle by which a closed form may exceed the limits before it is corrected, rad
    double slop              # distance by which a closed form may be out of reach before it is corrected, m
    int patience             # number of steps without a tenth of progress after which a descent ends
    double accepted_m        # distance below which a descent that cannot continue has reached the pose
    double accepted_rad
    bint every               # whether all branches are asked for, not the best one alone


cdef struct Candidate:
    double cost              # by the criterion; lower is better
    double joints[MAX_DOF]
    int branch
    bint refined             # whether its free angle, if it has one, is optimal
    double bound             # a lower bound of the cost after refinement
    double begin             # the bracket of the best free angle, rad
    double angle
    double end


cdef class Arm:
    cdef readonly Chain chain
    cdef readonly int dof
    cdef readonly bint lacking
    cdef readonly bint redundant
    cdef int c_free                   # see FIXED
    cdef double c_weight              # weight of 1 m relative to 1 rad in a descent
    cdef object _limits, _low, _high, _given, _found
    cdef double* c_low                # position limits of the joints
    cdef double* c_high
    cdef double* c_given              # scratch: a pose and joints from Python
    cdef double* c_found
    cdef double c_rest[MAX_DOF]       # joints at which the frames are at rest
    cdef bint c_hinge[MAX_DOF]        # false for a slide
    cdef double c_least[MAX_DOF]      # the limits, counted from `c_rest`
    cdef double c_most[MAX_DOF]
    cdef double c_home_rotation[9]    # of the TCP at rest
    cdef double c_home_position[3]
    # a point on the first joint's axis, and the largest distance of the TCP from it
    cdef double c_root[3]
    cdef double c_reach
    cdef double c_slop                # error of the geometry that a closed form assumes, m

    cdef void c_state(
        self, const double* pose, const double* seed, int criterion, Problem* out
    ) noexcept nogil
    cdef int c_closed_form(self, const Problem* problem, Candidate* found) noexcept nogil
    cdef void c_refine(self, const Problem* problem, Candidate* candidate) noexcept nogil
    cdef double c_gap(self, const Problem* problem) noexcept nogil
    cdef bint c_solve(self, const Problem* problem, unsigned long long random, double* joints) noexcept nogil
    cdef bint c_verify(self, const Problem* problem, double* joints) noexcept nogil
    cdef bint c_descend(
        self, const Problem* problem, double* joints, int steps, bint bounded, double* distance
    ) noexcept nogil
    cdef bint _from_random(
        self, const Problem* problem, double* joints, int attempt
    ) noexcept nogil
    cdef int _attempts(self, int candidates) noexcept nogil
    cdef int c_search(
        self, const Problem* problem, unsigned long long random, int attempts, int wanted, Candidate* found
    ) noexcept nogil
    cdef double c_cost(self, const Problem* problem, const double* joints) noexcept nogil
    cdef double c_manipulability(self, const double* joints) noexcept nogil
    cdef int _prepare(self, object pose, object seed, int criterion, Problem* out) except -1
    cdef void _clip(self, double* joints) noexcept nogil
    cdef void _turn_error(
        self, const Problem* problem, const double* rotation, double* jacobian, double* error
    ) noexcept nogil
    cdef void _weigh(self, double* jacobian, double* error) noexcept nogil
    cdef bint _damped_step(
        self, const double* joints, double* jacobian, const double* error, double off, bint bounded,
        double* step
    ) noexcept nogil
