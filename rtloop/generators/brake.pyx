"""Decelerates to rest within the acceleration and jerk limits."""

from libc.math cimport fabs

from cobot.arrays cimport doubles
from rtloop.generators.interpolation cimport clipped, copy_row, plain
from rtloop.generators.otg cimport OTG_OK, Problem, otg_velocity, profile_at

cdef double ROUNDING = 1e-9  # Rates up to this value are rest, rad/s and rad/s².


cdef class Brake:
    """Brings a reference to rest as fast as the limits permit, without reversing, each coordinate separately.
    Real-time safe.
    """

    def __init__(self, double period_s, max_acceleration, max_jerk):
        self.n, self.period_s = len(max_jerk), period_s
        copy_row(self.max_acceleration, max_acceleration, self.n)
        copy_row(self.max_jerk, max_jerk, self.n)

    cdef void c_begin(self, const double* reference) noexcept nogil:
        """Begin to decelerate from this state, (3, n).

        An acceleration beyond the limit is clipped to the limit. With the maximum jerk, reducing it would
        take so long that the velocity would become much too high.
        """
        cdef Problem problem
        cdef int i, n = self.n
        problem.target_position = problem.target_velocity = 0.0
        problem.min_velocity = problem.max_velocity = 0.0  # not used in this problem
        self.time_s, self.planned = 0.0, True
        for i in range(n):
            problem.position, problem.velocity = reference[i], reference[n + i]
            problem.acceleration = clipped(reference[2 * n + i], self.max_acceleration[i])
            problem.max_acceleration = self.max_acceleration[i]
            problem.min_acceleration = -self.max_acceleration[i]
            problem.max_jerk = self.max_jerk[i]
            if otg_velocity(&problem, &self.profiles[i]) != OTG_OK:
                self.planned = False
                return

    cdef bint c_advance(self, double* reference) noexcept nogil:
        """Advance by one period. Returns whether the reference is at rest, and True if it is NaN."""
        cdef double state[3]
        cdef double fastest = 0.0
        cdef int i, n = self.n
        self.time_s += self.period_s
        if self.planned:
            for i in range(n):
                profile_at(&self.profiles[i], self.time_s, state)
                reference[i], reference[n + i], reference[2 * n + i] = state[0], state[1], state[2]
                fastest = max(fastest, fabs(state[1]), fabs(state[2]))
            if fastest > ROUNDING:
                return False
        for i in range(n, 3 * n):
            reference[i] = 0.0
        return True

    def begin(self, reference):
        copy = plain(reference, (3, self.n))
        self.c_begin(doubles(copy, 3 * self.n))

    def advance(self, reference):
        return self.c_advance(doubles(reference, 3 * self.n))
