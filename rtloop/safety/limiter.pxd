from cobot.arrays cimport MAX_DOF
from rtloop.generators.moving_frame cimport Motion
from rtloop.generators.rates cimport Rates
from rtloop.generators.target_range cimport TargetRange
from rtloop.generators.tracking cimport Tracker


cdef class Safety:
    cdef readonly object command, position, velocity, acceleration, interventions, intervened_ns
    cdef readonly bint pursuing
    cdef public long long now_ns
    cdef readonly long long counted
    cdef double* c_command  # (3, dof)
    cdef unsigned long long* c_interventions
    cdef long long* c_intervened_ns
    cdef object _limits  # the limits of the positions
    cdef object _request  # a copy of a request from Python code
    cdef double* c_request
    cdef int dof
    cdef double period_s, share, catch_up
    cdef Rates own  # the arm's own limits, with which it decelerates
    cdef Rates used
    cdef double low[MAX_DOF]  # limits of the position, with their tolerance
    cdef double high[MAX_DOF]
    cdef double lowest[MAX_DOF]  # the same, but for a joint beyond them its position
    cdef double highest[MAX_DOF]
    cdef bint beyond  # whether a joint is beyond them
    # the calm region: between these positions, and up to these rates, no future excess is possible
    cdef double calm_low[MAX_DOF]
    cdef double calm_high[MAX_DOF]
    cdef double calm_speed[MAX_DOF]
    cdef double calm_acceleration[MAX_DOF]
    cdef double past[3][MAX_DOF]  # the last positions that have passed, the newest last
    cdef double pursued[3 * MAX_DOF]  # state of the pursuit, (3, dof)
    cdef unsigned int caught  # kinds of intervention in this pursuit, one bit each
    cdef Tracker tracker
    cdef TargetRange targets  # None if the stream has no joint targets
    cdef bint ranged
    cdef bint quiet  # whether this pursuit only keeps the target range; then no rates are counted
    cdef int settled  # number of cycles in which rates are not counted, because such a pursuit has just ended

    cdef bint c_apply(self, const double* request, bint streamed) noexcept nogil
    cdef bint c_brake(self) noexcept nogil
    cdef void c_slow_down(self, double share) noexcept nogil
    cdef void c_count(self, int kind) noexcept nogil
    cdef int _excess(self) noexcept nogil
    cdef int _foresee(self) noexcept nogil
    cdef bint _overruns(self) noexcept nogil
    cdef bint _is_calm(self) noexcept nogil
    cdef bint _meets(self) noexcept nogil
    cdef bint _catch(self, const double* request, int excess, int ahead, bint streamed) noexcept nogil
    cdef void _catch_kind(self, int kind) noexcept nogil
    cdef void _approach(self, const double* request, bint streamed) noexcept nogil
    cdef bint _pursue_along(self, const double* request) noexcept nogil
    cdef void _keep_in_range(self, int joint, double* wanted) noexcept nogil
    cdef void _let_through_pursuit(self) noexcept nogil
    cdef void _remember(self) noexcept nogil
    cdef void _come_back(self) noexcept nogil
    cdef void _find_calm(self) noexcept nogil
    cdef void c_motion(self, double* state) noexcept nogil
    cdef double _step_of(self, int joint) noexcept nogil
    cdef double _way(self, int joint, double speed, double acceleration) noexcept nogil
