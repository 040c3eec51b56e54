from cobot.arrays cimport MAX_DOF
from rtloop.generators.rates cimport Rates
from rtloop.inboxes.point_queue cimport PointQueue
from rtloop.sources.servo_base cimport ServoSource

cdef enum:
    PIECES = 512  # Maximum number of pieces of the curve ahead: half a second of points at 1 kHz.


cdef class ThroughPoints(ServoSource):
    cdef Rates rates
    cdef double usual[2]
    # The pieces from `first` up to, but not including, `count` are ahead of the arm or contain it.
    cdef int first, count
    cdef double ends[PIECES]  # σ at the end of each piece.
    cdef double spans[PIECES]
    cdef double places[PIECES][MAX_DOF]  # The point at the end of each piece.
    cdef bint passes[MAX_DOF]  # Whether a joint does not stop at the next point.
    cdef bint enters  # Whether the arm has entered a new piece.
    cdef double highest_rates[PIECES]  # The maximum rate on each piece.
    # The maximum joint speeds on each piece, from the limits of acceleration and jerk.
    cdef double speeds[PIECES][2]
    cdef object coefficient_rows  # (PIECES, 6, dof)
    cdef double* coefficients
    cdef double knot[3 * MAX_DOF]  # The curve's end: position, and derivatives by σ.
    # The point after the curve's end, with its span and time; there is one if the span is above 0.
    cdef double pending[MAX_DOF]
    cdef double pending_span, pending_time_s, pending_age_s
    cdef bint hungry  # Whether points have arrived since the last underrun.
    cdef double distance, rate, slope  # σ, and its derivatives by time.

    cdef void c_bound(self) noexcept nogil
    cdef void c_rest(self) noexcept nogil
    cdef void c_move_on(self, double end) noexcept nogil
    cdef double c_max_rate(self, double slope, double bend) noexcept nogil
    cdef void c_extend(self) noexcept nogil
    cdef void c_close(self, const double* following, double following_span) noexcept nogil
    cdef void c_find_knot(self, const double* following, double following_span) noexcept nogil
    cdef void c_measure(self, int number, double span) noexcept nogil
    cdef void c_make_room(self) noexcept nogil
