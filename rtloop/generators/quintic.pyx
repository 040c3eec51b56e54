"""References of quintic polynomials, continuous up to the acceleration."""

from libc.string cimport memcpy, memmove

from cobot.polynomials cimport quintic_at, quintic_between
from rtloop.generators.interpolation cimport EARLY, Interpolator, clipped, copy_row, grace_s
from rtloop.generators.online_trajectory cimport OnlineTrajectory
from rtloop.generators.target_estimate cimport Estimate

from rtloop.generators.online_trajectory import WINDOW_S

# A quintic meets the stream this far ahead, s, if the stream continues as it is. With a longer time, less
# jerk is needed to correct the effects of a sender's noise.
cdef double HORIZON_S = 0.2


cdef class Quintic(Interpolator):
    """A reference that is continuous up to the acceleration, and leads to the stream's future position.

    The reference reaches a single target at the end of the period, and meets a stream `HORIZON_S` ahead.
    Without noise, it passes through all of the stream's targets. Between two commands the limits of
    acceleration and jerk are not enforced. If no command has arrived by the end of the period, the reference
    continues the stream's motion for a grace period. Then it settles on the target, as `OnlineTrajectory`
    does.
    """

    def __init__(self, int n, double period_s, max_velocity, max_acceleration, max_jerk):
        copy_row(self.max_velocity, max_velocity, n)
        copy_row(self.max_acceleration, max_acceleration, n)
        self.estimate = Estimate(max_velocity, max_acceleration, WINDOW_S)
        self.end = OnlineTrajectory(n, period_s, max_velocity, max_acceleration, max_jerk)
        self.ended = True

    cdef void c_begin(self, const double* state) noexcept nogil:
        self.c_rebase(state, state)
        self.estimate.c_forget()
        self.end.c_begin(self.ref)
        self.ended = True

    cdef void c_rebase(self, const double* state, const double* target) noexcept nogil:
        memmove(self.ref, state, 3 * self.n * sizeof(double))
        self.estimate.c_rebase(target)

    cdef void c_aim(self, const double* target, const double* velocity, double duration_s) noexcept nogil:
        cdef double there[3 * MAX_DOF]
        cdef double horizon_s
        duration_s = max(duration_s, self.period_s)
        self.estimate.c_update(target, velocity, duration_s)
        horizon_s = max(duration_s, HORIZON_S) if self.estimate.c_moves() else duration_s
        self.estimate.c_extrapolate(horizon_s - duration_s, there)
        quintic_between(self.ref, there, self.n, horizon_s, self.coefficients)
        self.time_s, self.duration_s, self.horizon_s = 0.0, duration_s, horizon_s
        self.ended = False

    cdef void c_advance(self) noexcept nogil:
        if not self.ended:
            self.time_s += self.period_s
            if self._follows_stream():
                return
            self._settle()
        self.end.c_advance()
        memcpy(self.ref, self.end.ref, 3 * self.n * sizeof(double))

    cdef bint _follows_stream(self) noexcept nogil:
        """Continue towards or along the stream's extrapolated motion. Returns whether the stream may still be
        assumed to continue.
        """
        cdef double beyond_s = self.time_s - self.duration_s
        if not beyond_s <= grace_s(self.duration_s):
            return False
        if self.time_s <= self.horizon_s + EARLY * self.period_s:
            quintic_at(self.coefficients, self.n, self.time_s, self.horizon_s, self.ref)
        else:
            self.estimate.c_extrapolate(beyond_s, self.ref)
        return True

    cdef void _settle(self) noexcept nogil:
        """Begin to move to rest at the last target.

        The state is first limited, because an erratic stream may have led far beyond the limits, from where
        the return would take long.
        """
        cdef int i, n = self.n
        self.estimate.c_forget()
        for i in range(n):
            self.ref[n + i] = clipped(self.ref[n + i], self.max_velocity[i])
            self.ref[2 * n + i] = clipped(self.ref[2 * n + i], self.max_acceleration[i])
        self.end.c_settle(self.ref, self.estimate.newest)
        self.ended = True
