"""Moves the arm towards targets or moving requests, one period at a time, within the limits.

States are of all joints, shape (3, dof): rad, rad/s, rad/s².
"""

from libc.math cimport fabs, fmax, fmin, sqrt

import numpy as np

from cobot.arrays cimport MAX_DOF, checked_dof, doubles
from rtloop.generators.moving_frame cimport Ladder, Motion, overshoots_zero, plan_gently, to_rest_in_frame
from rtloop.generators.otg cimport (
    OTG_OK, Problem, otg_position, otg_velocity, profile_at, profile_extrema,
)
from rtloop.generators.rates cimport Rates, take_rates

# Velocity at which a target is passed, as a share of the limit. At the limit itself there is no room for
# rounding.
cdef double TARGET_VELOCITY = 0.99
# Share of the limits that the pursued request may use. The rest is for the pursuit.
cdef double ALONG = 0.9
cdef double ROUNDING = 1e-9  # rad/s and rad/s²: up to these rates a joint is at rest.
cdef double BOUND_RAD = 1e-7  # A stop no further than this beyond a bound is at the bound, rad.
# Maximum number of attempts to stop at a bound. Each new target leaves less than half of the overshoot.
cdef int AIMS = 8
# The pursuit of a moving request uses the first of these shares of the jerk limit with which it is quick
# enough. The rest of the limit is for the request's own jerk.
cdef Ladder GENTLENESS
GENTLENESS.count = 4
GENTLENESS.share = [0.03, 0.1, 0.3, 0.6]
GENTLENESS.patience_s = 0.2


cdef inline double _clipped(double value, double bound) noexcept nogil:
    return fmin(fmax(value, -bound), bound)


cdef class Tracker:
    def __cinit__(self, dof, period_s):
        self.dof = checked_dof(dof)
        self.period_s = period_s
        self.ahead = np.zeros((3, dof))
        self.c_ahead = doubles(self.ahead, 3 * dof)

    def brake(self, state, limits):
        cdef Rates rates
        take_rates(limits, &rates)
        own = self._copy(state)
        return self.c_brake(doubles(own, own.size), &rates)

    def approach(self, state, target, velocity, limits, max_velocity, bounds):
        cdef Rates rates
        take_rates(limits, &rates)
        own = self._copy([*state, target, velocity, max_velocity, *bounds])
        cdef double* row = doubles(own, own.size)
        cdef int n = self.dof
        self.c_approach(row, row + 3 * n, row + 4 * n, &rates, row + 5 * n, row + 6 * n, row + 7 * n)

    def along(self, state, request, limits, share, catch_up, bounds=None):
        cdef Rates rates
        cdef int n = self.dof
        take_rates(limits, &rates)
        own = self._copy([*state, *request, *(bounds or ())])
        cdef double* row = doubles(own, own.size)
        cdef double* low = NULL if bounds is None else row + 6 * n
        return self.c_along(row, row + 3 * n, &rates, share, catch_up, low, NULL if low == NULL else low + n)

    def _copy(self, rows):
        """Copy rows of all joints to a separate array, for compiled code."""
        return np.array(rows, dtype=np.float64, order="C").reshape(-1, self.dof)

    cdef bint c_brake(self, const double* state, const Rates* rates) noexcept nogil:
        """Decelerate as fast as the limits permit. Returns whether the arm is at rest."""
        cdef int joint, dof = self.dof
        cdef double* ahead = self.c_ahead
        cdef bint at_rest = True
        for joint in range(dof):
            self._pose(joint, state, rates)
            if otg_velocity(&self.problem[joint], &self.profile[joint]) == OTG_OK:
                self._step(joint)
            else:  # numbers close to zero, for which there may be no profile
                ahead[joint] = state[joint]
                ahead[dof + joint] = ahead[2 * dof + joint] = 0.0
            at_rest = at_rest and fabs(ahead[dof + joint]) <= ROUNDING
            at_rest = at_rest and fabs(ahead[2 * dof + joint]) <= ROUNDING
        if at_rest:
            for joint in range(dof, 3 * dof):
                ahead[joint] = 0.0
        return at_rest

    cdef void c_approach(
        self, const double* state, const double* target, const double* velocity, const Rates* rates,
        const double* max_velocity, const double* lowest, const double* highest,
    ) noexcept nogil:
        """Move towards a target, to arrive there with this velocity or a lower one.

        The arrival velocity is reduced to one that can be reached on the way, so that no joint moves back for
        a run-up.
        """
        cdef int joint
        cdef double way, most, arrival
        cdef bint passes = False
        for joint in range(self.dof):
            self._pose(joint, state, rates)
            way = target[joint] - state[joint]
            most = fmin(sqrt(rates.acceleration[joint] * fabs(way)), TARGET_VELOCITY * max_velocity[joint])
            arrival = _clipped(velocity[joint], most)
            if way * arrival < 0.0:
                arrival = 0.0
            passes = passes or arrival != 0.0
            self.problem[joint].target_position = target[joint]
            self.problem[joint].target_velocity = arrival
            self.problem[joint].max_velocity = max_velocity[joint]
            self.problem[joint].min_velocity = -max_velocity[joint]
        if not self._reach():
            self.c_brake(state, rates)
            return
        # The motion would need a short run-up, because the jerk is too small.
        if passes and self._leaves(lowest, highest):
            for joint in range(self.dof):
                self.problem[joint].target_velocity = 0.0
            if not self._reach():
                self.c_brake(state, rates)
                return
        for joint in range(self.dof):
            self._step(joint)

    cdef bint c_along(
        self, const double* state, const double* request, const Rates* rates, double share, double catch_up,
        const double* low, const double* high,
    ) noexcept nogil:
        """Move towards a moving request: reduce the difference to zero in a frame that moves with the
        request.

        `low` and `high` are the positions between which each joint must be able to stop afterwards, or NULL.
        """
        cdef int joint, dof = self.dof
        cdef double* ahead = self.c_ahead
        cdef double max_velocity, max_acceleration, bound
        cdef Motion here, frame
        cdef Motion frames[MAX_DOF]
        cdef Problem* problem
        cdef bint moving = False
        for joint in range(dof):
            max_velocity, max_acceleration = share * rates.velocity[joint], rates.acceleration[joint]
            frame.position = request[joint]
            frame.velocity = _clipped(request[dof + joint], ALONG * max_velocity)
            frame.acceleration = _clipped(request[2 * dof + joint], ALONG * max_acceleration)
            here.position, here.velocity = state[joint], state[dof + joint]
            here.acceleration = state[2 * dof + joint]
            problem = &self.problem[joint]
            to_rest_in_frame(problem, here, frame, self.period_s, max_velocity, max_acceleration)
            problem.max_velocity = fmin(problem.max_velocity, catch_up)
            problem.min_velocity = fmax(problem.min_velocity, -catch_up)
            moving = moving or frame.velocity != 0.0
            frames[joint] = frame
        # A target at rest is not overshot.
        if not plan_gently(self.problem, self.profile, rates.jerk, dof, &GENTLENESS, moving):
            return False
        for joint in range(dof):
            self._step(joint)
            ahead[joint] += frames[joint].position
            ahead[dof + joint] += frames[joint].velocity
            ahead[2 * dof + joint] += frames[joint].acceleration
            if low == NULL:
                continue
            if self._overshoots_bound(joint, frames[joint], low[joint], high[joint]):
                self._stop_at_bound(joint, state, rates, share, frames[joint].position)
            elif self.c_overruns(joint, ahead, rates, low[joint], high[joint]):
                bound = high[joint] if state[dof + joint] > 0.0 else low[joint]
                self._stop_at_bound(joint, state, rates, share, bound)
        return True

    cdef bint _overshoots_bound(self, int joint, Motion frame, double low, double high) noexcept nogil:
        """Whether a joint that stops gently at a bound would overshoot it. The joint would then decelerate
        too hard because of an overshoot that is part of the plan, and swing back.
        """
        return (
            not low < frame.position < high
            and frame.velocity == 0.0
            and overshoots_zero(self.problem[joint].position, &self.profile[joint])
        )

    cdef bint c_overruns(
        self, int joint, const double* state, const Rates* rates, double low, double high
    ) noexcept nogil:
        """Whether a joint in this state, (3, dof), moves up and can stop only above `high`, or moves down and
        can stop only below `low`.
        """
        cdef double velocity = state[self.dof + joint], acceleration = state[2 * self.dof + joint]
        cdef double extrema[2]
        cdef Profile stop
        if velocity == 0.0 and acceleration == 0.0:
            return False
        self._pose(joint, state, rates)
        if otg_velocity(&self.problem[joint], &stop) != OTG_OK:
            return False
        profile_extrema(&stop, extrema)
        return (extrema[1] > high + BOUND_RAD and extrema[1] > state[joint]) or (
            extrema[0] < low - BOUND_RAD and extrema[0] < state[joint]
        )

    cdef void _stop_at_bound(
        self, int joint, const double* state, const Rates* rates, double share, double bound
    ) noexcept nogil:
        """Plan a joint's motion to rest at a bound, with the full limits. If there is none, the joint
        decelerates.

        If the joint is late and would stop beyond the bound, its target is moved back by the overshoot, so
        that it decelerates harder.
        """
        cdef Problem* problem = &self.problem[joint]
        cdef double beyond = 0.0
        cdef int _
        self._pose(joint, state, rates)
        problem.target_position = bound
        problem.max_velocity = share * rates.velocity[joint]
        problem.min_velocity = -problem.max_velocity
        for _ in range(AIMS):
            problem.target_position -= beyond
            if otg_position(problem, &self.profile[joint]) != OTG_OK:
                self._pose(joint, state, rates)
                if otg_velocity(problem, &self.profile[joint]) != OTG_OK:
                    return
                break
            beyond = self._beyond(joint, bound)
            if fabs(beyond) <= BOUND_RAD:
                break
        self._step(joint)

    cdef double _beyond(self, int joint, double bound) noexcept nogil:
        """Return the overshoot of a joint's motion beyond both a bound and the joint's position; negative
        downwards.
        """
        cdef double position = self.problem[joint].position
        cdef double extrema[2]
        profile_extrema(&self.profile[joint], extrema)
        return fmax(extrema[1] - fmax(bound, position), 0.0) + fmin(extrema[0] - fmin(bound, position), 0.0)

    cdef void _pose(self, int joint, const double* state, const Rates* rates) noexcept nogil:
        """Set up the problem of a joint's motion from its state to rest. The caller sets the target position
        and the velocity limits.
        """
        cdef Problem* problem = &self.problem[joint]
        problem.position, problem.velocity = state[joint], state[self.dof + joint]
        problem.acceleration = state[2 * self.dof + joint]
        problem.target_position = problem.target_velocity = 0.0
        problem.max_velocity, problem.min_velocity = rates.velocity[joint], -rates.velocity[joint]
        problem.max_acceleration = rates.acceleration[joint]
        problem.min_acceleration = -rates.acceleration[joint]
        problem.max_jerk = rates.jerk[joint]

    cdef bint _reach(self) noexcept nogil:
        """Plan all joints. Returns whether all have a motion."""
        cdef int joint
        for joint in range(self.dof):
            if otg_position(&self.problem[joint], &self.profile[joint]) != OTG_OK:
                return False
        return True

    cdef bint _leaves(self, const double* lowest, const double* highest) noexcept nogil:
        """Whether the motion leaves these positions."""
        cdef int joint
        cdef double extrema[2]
        for joint in range(self.dof):
            profile_extrema(&self.profile[joint], extrema)
            if extrema[0] < lowest[joint] or extrema[1] > highest[joint]:
                return True
        return False

    cdef void _step(self, int joint) noexcept nogil:
        """Set a joint's state to that of its profile one period later."""
        cdef double there[3]
        profile_at(&self.profile[joint], self.period_s, there)
        self.c_ahead[joint] = there[0]
        self.c_ahead[self.dof + joint] = there[1]
        self.c_ahead[2 * self.dof + joint] = there[2]
