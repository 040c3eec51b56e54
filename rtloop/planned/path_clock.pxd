from cobot.arrays cimport MAX_DOF
from rtloop.generators.otg cimport Profile
from rtloop.generators.rates cimport Rates
from rtloop.planned.path cimport Path


cdef struct Place:  # A place on a candidate profile: the path time, the rate and its first two derivatives.
    double path_time_s, rate, slope, bend


cdef class PathClock:
    cdef readonly double path_time_s, rate, rate_slope, target_rate, share
    cdef double asked_rate  # the requested rate, before it is scaled
    # target of the next profile: the requested rate, or a lower one on the way there from rest
    cdef double aim
    cdef int dof
    cdef double period_s, patience_s
    cdef Rates rates
    cdef Profile profile, candidate
    # target rate of the active profile, and time since its start; negative without a profile
    cdef double profile_target, profile_s
    cdef bint pending, held, urgent
    cdef int rung, failed_at_rest
    cdef int crest
    cdef double tried  # share of the steepest profile that a stop at contact has tried last
    cdef double waited_s

    cdef void c_reset(self) noexcept nogil
    cdef bint c_at_rest(self) noexcept nogil
    cdef bint c_slowing(self) noexcept nogil
    cdef bint c_stuck(self) noexcept nogil
    cdef double c_committed_s(self) noexcept nogil
    cdef void c_shift(self, double offset_s) noexcept nogil
    cdef void c_request(self, double rate) noexcept nogil
    cdef void c_scale(self, double share) noexcept nogil
    cdef void c_hold(self, bint held) noexcept nogil
    cdef void c_end_urgently(self) noexcept nogil
    cdef void c_begin(self) noexcept nogil
    cdef void c_advance(self, Path path) noexcept nogil
    cdef void _try_rung(self, Path path) noexcept nogil
    cdef void _try_sooner(self, Path path) noexcept nogil
    cdef bint _find_steepest(self, Path path) noexcept nogil
    cdef void _try_shorter(self, Path path) noexcept nogil
    cdef void _begin_search(self) noexcept nogil
    cdef bint _try(self, Path path, double share) noexcept nogil
    cdef void _lower_aim(self) noexcept nogil
    cdef void _take_candidate(self) noexcept nogil
    cdef bint _plan(self, Path path, double share, double crest=*) noexcept nogil
    cdef bint _admissible(self, Path path) noexcept nogil
    cdef bint _hold_samples(
        self, Path path, const Place* places, int count, int begin, int end
    ) noexcept nogil
    cdef bint _hold_breakpoints(self, Path path, const Place* places, int count) noexcept nogil
    cdef bint _holds(
        self, Path path, double path_time_s, double rate, double slope, double bend
    ) noexcept nogil
