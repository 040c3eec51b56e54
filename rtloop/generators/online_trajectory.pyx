"""The fastest reference to a moving target that stays within the limits. It is planned again for each target.
"""

from libc.math cimport fabs, fmin
from libc.string cimport memmove

from cobot.arrays cimport doubles
from rtloop.generators.interpolation cimport EARLY, Interpolator, clipped, copy_row, grace_s, plain
from rtloop.generators.moving_frame cimport Ladder, Motion, moved, plan_gently, to_rest_in_frame
from rtloop.generators.otg cimport profile_at
from rtloop.generators.target_estimate cimport Estimate

# The target's motion is estimated from the targets of this time. At 100 Hz with 0.3 mrad of noise, the
# reference deviates by 5 mrad; with only three targets it would deviate by 0.1 rad. `Quintic` follows the
# noise in any case, so it uses three.
WINDOW_S = 0.1
# A correction uses the first of these shares of the jerk limit with which it is quick enough.
cdef Ladder GENTLE
GENTLE.count = 4
GENTLE.share = [0.03, 0.1, 0.3, 1.0]
GENTLE.patience_s = 0.25
# Maximum duration of a profile. A longer one would lead so far away that its result would be only rounding
# error.
cdef double MAX_PROFILE_S = 7600.0


cdef class OnlineTrajectory(Interpolator):
    """The fastest profile to the moving target, within the limits of velocity, acceleration and jerk.

    Until the next command, the target is assumed to move with the estimated velocity and a constant
    acceleration. In a frame that moves with it, the problem is a motion from a state to rest, see
    `moving_frame`. If no command has arrived by the end of the period and a grace period, the reference
    decelerates and settles on the target.
    """

    def __init__(self, int n, double period_s, max_velocity, max_acceleration, max_jerk):
        cdef int i
        copy_row(self.max_velocity, max_velocity, n)
        copy_row(self.max_acceleration, max_acceleration, n)
        copy_row(self.max_jerk, max_jerk, n)
        self.estimate = Estimate(max_velocity, max_acceleration, WINDOW_S)
        self.brake = Brake(period_s, max_acceleration, max_jerk)
        for i in range(n):
            # The speed that a relative acceleration of the frame can still add before it is reduced again,
            # per unit of that acceleration.
            self.swing_s[i] = 1.5 * self.max_acceleration[i] / self.max_jerk[i]
        self._start_brake()

    cdef void c_begin(self, const double* state) noexcept nogil:
        self.c_rebase(state, state)
        self.estimate.c_forget()
        self._start_brake()

    cdef void c_rebase(self, const double* state, const double* target) noexcept nogil:
        memmove(self.ref, state, 3 * self.n * sizeof(double))
        self.estimate.c_rebase(target)

    cdef void c_forget(self) noexcept nogil:
        """Begin a new stream. The next target does not continue the previous ones."""
        self.estimate.c_forget()

    cdef void c_settle(self, const double* state, const double* target) noexcept nogil:
        """Plan from this state, (3, n), to rest at the target."""
        cdef int i
        self.c_rebase(state, target)
        for i in range(self.n):
            self.frame[i].position = target[i]
        self._end()

    cdef void c_aim(self, const double* target, const double* velocity, double duration_s) noexcept nogil:
        cdef const double* estimated = self.estimate.c_velocity
        cdef const double* changing = self.estimate.c_acceleration
        cdef double room, bound
        cdef int i
        duration_s = max(duration_s, self.period_s)
        self.estimate.c_update(target, velocity, duration_s)
        for i in range(self.n):
            # An acceleration with a margin on both sides, because it must end before the limits are reached.
            room = self.max_velocity[i] - fabs(estimated[i])
            bound = fmin(0.8 * self.max_acceleration[i], room / (2.0 * (self.swing_s[i] + duration_s)))
            self.frame[i].position, self.frame[i].velocity = target[i], estimated[i]
            self.frame[i].acceleration = clipped(changing[i], bound)
        self.settling = False
        self._plan(duration_s)

    cdef void c_advance(self) noexcept nogil:
        cdef double late_s = self.time_s - self.due_s + EARLY * self.period_s
        cdef double off[3]
        cdef Motion place
        cdef int i, n = self.n
        if not self.braking and not self.settling and late_s > grace_s(self.due_s):
            self._end()
        if self.braking:
            if self.brake.c_advance(self.ref):
                self.estimate.c_forget()
            return
        self.time_s += self.period_s
        if self.settling and self.time_s >= self.duration_s:
            # Set exactly, without the rounding at the profile's end.
            for i in range(n):
                self.ref[i], self.ref[n + i], self.ref[2 * n + i] = self.frame[i].position, 0.0, 0.0
            self.estimate.c_forget()
            return
        for i in range(n):
            profile_at(&self.profiles[i], self.time_s, off)
            place = moved(self.frame[i], self.time_s - self.due_s)
            self.ref[i] = off[0] + place.position
            self.ref[n + i] = off[1] + place.velocity
            self.ref[2 * n + i] = off[2] + place.acceleration

    cdef void _end(self) noexcept nogil:
        """Plan to rest at the last target."""
        cdef int i
        for i in range(self.n):
            self.frame[i].velocity = self.frame[i].acceleration = 0.0
        self.settling = True
        self._plan(0.0)

    cdef void _plan(self, double due_s) noexcept nogil:
        """Plan a profile from the reference to rest in the moving frame, within the joints' limits.

        Each joint has its own profile. With time synchronisation, joints without a deviation would also move.
        """
        cdef Motion state
        cdef double room
        cdef int i, n = self.n
        self.time_s, self.due_s, self.braking = 0.0, due_s, False
        for i in range(n):
            state.position, state.velocity = self.ref[i], self.ref[n + i]
            state.acceleration = self.ref[2 * n + i]
            room = self.max_velocity[i] - fabs(self.frame[i].acceleration) * (self.swing_s[i] + due_s)
            to_rest_in_frame(
                &self.problems[i], state, self.frame[i], due_s, room, self.max_acceleration[i]
            )
        if plan_gently(self.problems, self.profiles, self.max_jerk, n, &GENTLE, True):
            self.duration_s = self._longest_s()
            if self.duration_s <= MAX_PROFILE_S:
                return
        self._start_brake()

    cdef double _longest_s(self) noexcept nogil:
        cdef double longest_s = 0.0
        cdef int i
        for i in range(self.n):
            longest_s = max(longest_s, self.profiles[i].duration)
        return longest_s

    cdef void _start_brake(self) noexcept nogil:
        self.brake.c_begin(self.ref)
        self.braking = True

    def forget(self):
        self.c_forget()

    def settle(self, state, target):
        here, there = plain(state, (3, self.n)), plain(target, (self.n,))
        self.c_settle(doubles(here, 3 * self.n), doubles(there, self.n))
