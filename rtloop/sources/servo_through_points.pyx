"""Mode 5: the arm moves through all points in order, at their stated times or, if the limits do not permit
this, as fast as possible.

A curve q(σ), continuous up to the second derivative, connects the points. σ is the points' stated time,
extended where a joint could not move that fast. σ advances at a rate r from 0 to 1 that is continuous up to
its derivative, as on a planned path (`rtloop.planned.path_clock`). So the whole motion is equally continuous,
and after a change of the rate the arm still follows the curve through every point. The curve's own share of
the acceleration and jerk, q'' r² and q''' r³, limits r on each piece. The share for changes of the rate, q'
r' and q' r'', limits these changes.

The curve is known up to the last point but one, because the direction at a point depends on the next one. The
reference can always stop at the end of the known curve, so when a stream ends, the arm stops at its last
point.
"""

from libc.math cimport INFINITY, cbrt, fabs, sqrt
from libc.string cimport memcpy, memmove, memset

from cobot.arrays cimport MAX_DOF, doubles
from cobot.polynomials cimport ORDER, quintic_at, quintic_between, quintic_peaks
from rtloop.generators.otg cimport OTG_OK, Problem, Profile, otg_position, profile_at
from rtloop.generators.rates cimport take_rates
from rtloop.inboxes.point_queue cimport PointQueue, ServoPoint
from rtloop.sources.servo_base cimport MAX_POINTS, ServoSource
from rtloop.sources.source cimport FINE, NOT_FINITE

import numpy as np

from rtloop.generators.target_range import TargetRange

# Share of acceleration and jerk for the curve, and for changes of its rate.
cdef double CURVE_SHARE = 0.5
cdef double RATE_SHARE = 0.5
cdef double VELOCITY_SHARE = 0.98
# Changes of the rate are always slow enough for this joint velocity, because a faster point may follow.
cdef double USUAL_RAD_S = 0.2
cdef double MIN_RATE = 1e-4
cdef double REST = 1e-9
# If the next point does not arrive within this multiple of the last point's time and a short grace period,
# the curve ends at the last point.
cdef double PATIENCE = 2.0
cdef double GRACE_S = 0.01
# Number of places at which a piece is checked, including its ends.
cdef int PLACES = 7
# Number of pieces ahead that are included in the target range.
cdef int AHEAD = 32


cdef class ThroughPoints(ServoSource):
    """The known part of the curve, and the progress of the arm along it. Real-time safe."""

    def __init__(self, limits, double period_s):
        super().__init__(limits, limits.max_velocity, period_s)
        take_rates(limits, &self.rates)
        self.usual[0] = USUAL_RAD_S / limits.max_acceleration.min()
        self.usual[1] = USUAL_RAD_S / limits.max_jerk.min()
        self.coefficient_rows = np.zeros((PIECES, ORDER, self.dof))
        self.coefficients = doubles(self.coefficient_rows, PIECES * ORDER * self.dof)
        self.first = self.count = 0
        memset(self.knot, 0, sizeof(self.knot))
        memset(self.pending, 0, sizeof(self.pending))
        self.pending_span = self.pending_time_s = self.pending_age_s = 0.0
        self.hungry = self.enters = False
        self.distance = self.rate = self.slope = 0.0
        self.targets = TargetRange(self.dof, period_s, period_s)

    cdef long long c_buffered(self) noexcept nogil:
        return self.count - self.first + (self.pending_span > 0.0)

    cdef void c_begin(self, const double* command) noexcept nogil:
        """Begin at this command. If the arm is still moving, the safety layer brings it to rest."""
        memset(self.ref, 0, 3 * self.dof * sizeof(double))
        memcpy(self.ref, command, self.dof * sizeof(double))
        memset(self.knot, 0, sizeof(self.knot))
        memcpy(self.knot, command, self.dof * sizeof(double))
        memcpy(self.last, command, self.dof * sizeof(double))
        self.first = self.count = 0
        self.pending_span = 0.0
        self.hungry = self.enters = False
        self.distance = self.rate = self.slope = 0.0
        self.targets.c_begin(command)
        memset(self.passes, 0, sizeof(self.passes))

    cdef int c_fetch(self, PointQueue queue) noexcept nogil:
        cdef ServoPoint point
        cdef int _count
        self.pending_age_s += self.period_s
        for _count in range(MAX_POINTS):
            if self.count - self.first >= PIECES - 1:
                return FINE
            if not queue.c_next(&point):
                break
            if not self.c_read(&point):
                return NOT_FINITE
            self.taken += 1
            self.c_extend()
        if self.pending_span > 0.0 and self.pending_age_s > PATIENCE * self.pending_time_s + GRACE_S:
            self.c_close(NULL, 0.0)
        return FINE

    cdef void c_advance(self, const double* external_effort, const double* wrench) noexcept nogil:
        cdef double values[3 * MAX_DOF]
        cdef double span, ahead
        cdef int joint, dof = self.dof
        self.targets.c_advance()
        if self.first == self.count:
            self.c_rest()
            return
        self.c_move_on(self.ends[self.count - 1])
        while self.first < self.count - 1 and self.distance > self.ends[self.first]:
            self.first += 1
            self.enters = True
        self.c_bound()
        span = self.spans[self.first]
        ahead = min(max(span - self.ends[self.first] + self.distance, 0.0), span)
        quintic_at(self.coefficients + self.first * ORDER * dof, dof, ahead, span, values)
        for joint in range(dof):
            self.ref[joint] = values[joint]
            self.ref[dof + joint] = values[dof + joint] * self.rate
            self.ref[2 * dof + joint] = (
                values[2 * dof + joint] * (self.rate * self.rate) + values[dof + joint] * self.slope
            )
        if self.rate == 0.0 and self.distance == self.ends[self.count - 1]:
            self.first = self.count

    cdef void c_bound(self) noexcept nogil:
        """Set the target range. The points ahead are known, and the next one is the target."""
        cdef int piece, joint
        cdef const double* following = NULL
        if self.enters:
            self.enters = False
            if self.first + 1 < self.count:
                following = self.places[self.first + 1]
            elif self.pending_span > 0.0:
                following = self.pending
            for joint in range(self.dof):  # a joint passes a point if the curve does
                if self.places[self.first][joint] == self.targets.newest[joint]:
                    self.passes[joint] = False
                elif following != NULL:
                    self.passes[joint] = following[joint] != self.places[self.first][joint]
            self.targets.c_update(self.places[self.first])
            self.targets.c_expect(self.spans[self.first])
        for piece in range(self.first, min(self.count, self.first + AHEAD)):
            self.targets.c_include(self.places[piece])
        if self.pending_span > 0.0:
            self.targets.c_include(self.pending)
        for joint in range(self.dof):
            if self.passes[joint] and self.first < self.count:
                self.targets.c_low[joint], self.targets.c_high[joint] = -INFINITY, INFINITY

    cdef void c_rest(self) noexcept nogil:
        """Rest at the end of the curve."""
        memset(self.ref + self.dof, 0, 2 * self.dof * sizeof(double))
        if self.hungry and self.pending_span == 0.0:
            self.hungry = False
            self.underruns += 1

    cdef void c_move_on(self, double end) noexcept nogil:
        """Advance by one period along the curve, so that the arm can stop at its end."""
        cdef Problem problem
        cdef Profile profile
        cdef double there[3]
        cdef double speeds[2]
        cdef int piece, kind
        cdef bint arrives
        memcpy(speeds, self.usual, sizeof(speeds))
        for piece in range(self.first, self.count):
            for kind in range(2):
                speeds[kind] = max(speeds[kind], self.speeds[piece][kind])
        problem.position, problem.velocity, problem.acceleration = self.distance, self.rate, self.slope
        problem.target_position, problem.target_velocity = end, 0.0
        problem.max_acceleration = max(RATE_SHARE / speeds[0], fabs(self.slope))
        problem.min_acceleration = -problem.max_acceleration
        problem.max_jerk = RATE_SHARE / speeds[1]
        problem.max_velocity = self.c_max_rate(RATE_SHARE / speeds[0], problem.max_jerk)
        problem.min_velocity = -problem.max_velocity
        arrives = otg_position(&problem, &profile) != OTG_OK or profile.duration < self.period_s
        if not arrives:
            profile_at(&profile, self.period_s, there)
            self.distance, self.rate, self.slope = there[0], max(there[1], 0.0), there[2]
            arrives = end - self.distance < REST and self.rate < REST
        if arrives:
            self.distance, self.rate, self.slope = end, 0.0, 0.0

    cdef double c_max_rate(self, double slope, double bend) noexcept nogil:
        """The maximum rate on all pieces that the arm could reach before it could slow down."""
        cdef double rate = self.rate + 0.5 * self.slope * fabs(self.slope) / bend
        cdef double way = rate * (self.period_s + rate / slope + slope / bend)
        cdef double most = self.highest_rates[self.first]
        cdef int piece
        if self.waits:
            return MIN_RATE
        for piece in range(self.first, self.count):
            most = min(most, self.highest_rates[piece])
            if not self.ends[piece] < self.distance + way:
                break
        return max(most, MIN_RATE)

    cdef void c_extend(self) noexcept nogil:
        """Add a point, `target`. The curve is then known up to the previous point."""
        cdef const double* here = &self.pending[0] if self.pending_span > 0.0 else &self.knot[0]
        cdef double span = self.time_s
        cdef int joint
        memcpy(self.last, self.target, self.dof * sizeof(double))
        self.hungry = True
        for joint in range(self.dof):
            span = max(
                span, fabs(self.target[joint] - here[joint]) / (VELOCITY_SHARE * self.rates.velocity[joint])
            )
        if self.pending_span > 0.0:
            self.c_close(self.target, span)
        memcpy(self.pending, self.target, self.dof * sizeof(double))
        self.pending_span, self.pending_time_s, self.pending_age_s = span, self.time_s, 0.0

    cdef void c_close(self, const double* following, double following_span) noexcept nogil:
        """Extend the curve to the pending point. The following point determines the direction there."""
        cdef double start[3 * MAX_DOF]
        cdef double span = self.pending_span, begin
        cdef int joint, number, dof = self.dof
        if self.first == self.count:  # No joint moves, so any direction is valid.
            self.first = self.count = 0
            self.distance = 0.0
            self.enters = True
            for joint in range(dof):
                self.knot[dof + joint] = (self.pending[joint] - self.knot[joint]) / span
                self.knot[2 * dof + joint] = 0.0
        elif self.count == PIECES:
            self.c_make_room()
        memcpy(start, self.knot, sizeof(start))
        self.c_find_knot(following, following_span)
        number = self.count
        quintic_between(start, self.knot, dof, span, self.coefficients + number * ORDER * dof)
        self.c_measure(number, span)
        begin = self.ends[number - 1] if number else 0.0
        self.spans[number] = span
        memcpy(self.places[number], self.pending, dof * sizeof(double))
        self.ends[number] = begin + span
        self.count = number + 1
        self.pending_span = 0.0

    cdef void c_find_knot(self, const double* following, double following_span) noexcept nogil:
        """Move the knot to the pending point. Without a following point, it is the last one."""
        cdef double span = self.pending_span, both = span + following_span
        cdef double before, after
        cdef int joint, dof = self.dof
        for joint in range(dof):
            before = (self.pending[joint] - self.knot[joint]) / span
            self.knot[joint] = self.pending[joint]
            if following == NULL:
                self.knot[dof + joint] = before
                self.knot[2 * dof + joint] = 0.0
            else:
                after = (following[joint] - self.pending[joint]) / following_span
                self.knot[dof + joint] = (before * following_span + after * span) / both
                self.knot[2 * dof + joint] = 2.0 * (after - before) / both

    cdef void c_measure(self, int number, double span) noexcept nogil:
        """Calculate the maximum rate along a piece, and the speeds that limit changes of the rate."""
        cdef double peaks[3 * MAX_DOF]
        cdef double first = 0.0, second = 0.0, third = 0.0
        cdef double* speeds = self.speeds[number]
        cdef int joint, order, dof = self.dof
        for order in range(3):
            quintic_peaks(
                self.coefficients + number * ORDER * dof, dof, order + 1, span, PLACES, peaks + order * dof
            )
        speeds[0] = speeds[1] = 0.0
        for joint in range(dof):
            first = max(first, peaks[joint] / self.rates.velocity[joint])
            second = max(second, peaks[dof + joint] / self.rates.acceleration[joint])
            third = max(third, peaks[2 * dof + joint] / self.rates.jerk[joint])
            speeds[0] = max(speeds[0], peaks[joint] / self.rates.acceleration[joint])
            speeds[1] = max(speeds[1], peaks[joint] / self.rates.jerk[joint])
        self.highest_rates[number] = min(1.0, VELOCITY_SHARE / max(first, 1e-9))
        self.highest_rates[number] = min(self.highest_rates[number], sqrt(CURVE_SHARE / max(second, 1e-9)))
        self.highest_rates[number] = min(self.highest_rates[number], cbrt(CURVE_SHARE / max(third, 1e-9)))

    cdef void c_make_room(self) noexcept nogil:
        """Remove the pieces that the arm has passed. σ then starts at its current piece."""
        cdef int first = self.first, kept = self.count - self.first, piece
        cdef Py_ssize_t row = ORDER * self.dof
        cdef double origin = self.ends[first] - self.spans[first]
        memmove(self.ends, self.ends + first, kept * sizeof(double))
        memmove(self.spans, self.spans + first, kept * sizeof(double))
        memmove(self.places, self.places + first, kept * sizeof(self.places[0]))
        memmove(self.highest_rates, self.highest_rates + first, kept * sizeof(double))
        memmove(self.speeds, self.speeds + first, kept * sizeof(self.speeds[0]))
        memmove(self.coefficients, self.coefficients + first * row, kept * row * sizeof(double))
        for piece in range(kept):
            self.ends[piece] -= origin
        self.distance -= origin
        self.first, self.count = 0, kept
