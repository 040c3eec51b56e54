"""The safety layer: the last check before a command is written. It is the same code in every mode and for
every backend.

A command within the limits passes unchanged, bit for bit. A command that is not finite is rejected and
latches an e-stop. A command beyond the limits of position, velocity, acceleration or jerk is caught: from
then on, the output is a jerk-limited pursuit of the request within all limits, until the request can be
reached again in one step. Because a streamed motion can change at any time, its limits are tighter, the
pursuit follows the request's velocity, and joints slow down early enough to stop before their limits.

Commands have the shape (3, dof): position, velocity and acceleration of all joints, rad, rad/s, rad/s².

The same pursuit handles all kinds of excess. It begins in `_catch`.
"""

from libc.math cimport INFINITY, copysign, fabs, fmax, fmin, isfinite, sqrt
from libc.string cimport memcpy, memset

import numpy as np

from cobot.arrays cimport MAX_DOF, bytes_of, checked_dof, doubles
from rtloop.generators.moving_frame cimport Motion
from rtloop.generators.rates cimport take_rates
from rtloop.generators.target_range cimport TargetRange
from rtloop.generators.tracking cimport Tracker

from cobot.ipc.layout import Intervention

POSITION_TOLERANCE_RAD = 1e-5
# Slightly less than the tolerance, so that a pursuit that ends there is within the tolerance in spite of
# rounding.
cdef double POSITION_TOLERANCE = POSITION_TOLERANCE_RAD * (1.0 - 1e-9)
# Tolerance for an arm that is already beyond its limits: twice the error that planners may have. With a
# larger one, each motion that begins there would take the arm further.
cdef double ROUNDING_RAD = 2e-9
# Relative tolerance of the rates. Planned motions are exactly at the limits, and the differences of four
# positions contain the rounding of numbers of about 1 rad, divided by the period cubed.
cdef double TOLERANCE = 0.01
# The step from a pursuit to the request may use this share of the change in acceleration that the jerk limit
# permits per cycle. The rest is for the request's next step.
cdef double MEETING = 0.5
# The stopping distance is increased by this factor, because the known acceleration is rounded and one cycle
# old.
cdef double WAY_SHARE = 1.05
cdef double WAY_RAD = 5e-5
# Below this share of the velocity limits, no future excess is possible. With an acceleration of at most √(j
# v), the velocity grows by at most v/2 until the acceleration is reduced to zero, and stays below the limit.
cdef double CALM = 0.6

cdef enum:
    NOTHING = -1  # Not an intervention.
    OVERRUN = -2  # The arm could stop only beyond the stream's targets. This is not an intervention.

cdef int NOT_FINITE = Intervention.NOT_FINITE, POSITION = Intervention.POSITION
cdef int VELOCITY = Intervention.VELOCITY, ACCELERATION = Intervention.ACCELERATION, JERK = Intervention.JERK
# Kinds of intervention that are not counted during a pursuit that only keeps the arm in the target range of a
# stream.
cdef unsigned int RATES = (
    <unsigned int>1 << VELOCITY | <unsigned int>1 << ACCELERATION | <unsigned int>1 << JERK
)

cdef enum:
    # Number of cycles in which differences of positions are still affected by the end of a pursuit.
    DIFFERENCES = 3
    ROWS = 6
# The checks, in this order: the position, its first to third difference, and the rates stated by the command.
cdef int[ROWS] KINDS = [POSITION, VELOCITY, ACCELERATION, JERK, VELOCITY, ACCELERATION]


cdef inline Motion _motion(double oldest, double last, double newest, double rate) noexcept nogil:
    """Calculate the motion from three consecutive positions. The velocity is the one half a period ago, and
    the acceleration the one a period ago.
    """
    cdef Motion motion
    motion.position = newest
    motion.velocity = rate * (newest - last)
    motion.acceleration = rate * rate * ((newest - last) - (last - oldest))
    return motion


cdef class Safety:
    def __cinit__(self, limits, period_s):
        dof = checked_dof(limits.dof)
        self.dof = dof
        self.period_s = period_s
        self.command = np.zeros((3, dof))
        self.position, self.velocity, self.acceleration = self.command
        self.c_command = doubles(self.command, 3 * dof)
        self._request = np.zeros((3, dof))
        self.c_request = doubles(self._request, 3 * dof)
        kinds = len(Intervention)
        self.interventions = np.zeros(kinds, np.uint64)
        self.intervened_ns = np.zeros(kinds, np.int64)
        self.c_interventions = <unsigned long long*>bytes_of(self.interventions, 8 * kinds)
        self.c_intervened_ns = <long long*>bytes_of(self.intervened_ns, 8 * kinds)
        self.tracker = Tracker(dof, period_s)
        self._limits = limits
        take_rates(limits, &self.own)
        self.use(limits)

    @property
    def motion(self):
        """Return the actual motion of the commands, whatever motion they state, shape (3, dof)."""
        rows = np.zeros((3, self.dof))
        self.c_motion(doubles(rows, 3 * self.dof))
        return rows

    def use(self, limits, double share=1.0, double catch_up=INFINITY):
        take_rates(limits, &self.used)
        self.share, self.catch_up = share, catch_up
        self._find_calm()

    def slow_down(self, double share):
        self.c_slow_down(share)

    def stay_within(self, TargetRange targets):
        self.targets = targets
        self.settled = 0
        self.quiet = False
        self.ranged = targets is not None

    def reset(self, position):
        limits = self._limits
        memset(self.c_command, 0, 3 * self.dof * sizeof(double))
        self.beyond = False
        for joint in range(self.dof):
            self.low[joint] = limits.min_position[joint] - POSITION_TOLERANCE
            self.high[joint] = limits.max_position[joint] + POSITION_TOLERANCE
            self.lowest[joint] = min(self.low[joint], position[joint] - ROUNDING_RAD)
            self.highest[joint] = max(self.high[joint], position[joint] + ROUNDING_RAD)
            if self.lowest[joint] < self.low[joint] or self.highest[joint] > self.high[joint]:
                self.beyond = True
            self.c_command[joint] = position[joint]
            for i in range(3):
                self.past[i][joint] = position[joint]
        self._find_calm()
        self.pursuing = False
        self.caught = 0

    def apply(self, request, *, bint streamed=False):
        self._request[:] = request
        return self.c_apply(self.c_request, streamed)

    def brake(self):
        return self.c_brake()

    def count(self, int kind):
        if not 0 <= kind < len(self.interventions):
            raise IndexError(f"there is no intervention {kind}")
        self.c_count(kind)

    cdef void c_slow_down(self, double share) noexcept nogil:
        if share != self.share:
            self.share = share
            self._find_calm()

    cdef void c_count(self, int kind) noexcept nogil:
        self.c_interventions[kind] += 1
        self.c_intervened_ns[kind] = self.now_ns
        self.counted += 1

    cdef bint c_apply(self, const double* request, bint streamed) noexcept nogil:
        """Pass on a command or the nearest safe one. The result is in `c_command`.

        Args:
            streamed: whether the following commands are unknown.

        Returns:
            False if the request is not finite. Then the caller must latch an e-stop.
        """
        cdef int excess, ahead
        memcpy(self.c_command, request, 3 * self.dof * sizeof(double))
        excess = self._excess()
        ahead = self._foresee() if streamed and excess == ROWS else NOTHING
        if ahead == NOTHING and excess == ROWS and streamed and self.ranged and self._overruns():
            ahead = OVERRUN
        if excess == ROWS and ahead == NOTHING and (not self.pursuing or self._meets()):
            self.pursuing = False
            self.settled -= self.settled > 0
            self._remember()
            return True
        return self._catch(request, excess, ahead, streamed)

    cdef bint c_brake(self) noexcept nogil:
        """Decelerate from the current state, each joint separately, as fast as the limits permit.

        Returns:
            Whether the arm is at rest.
        """
        cdef double state[3 * MAX_DOF]
        self.c_motion(state)
        cdef bint at_rest = self.tracker.c_brake(state, &self.own)
        self._let_through_pursuit()
        return at_rest

    cdef int _excess(self) noexcept nogil:
        """Return the first row in which the command of a joint is beyond its limits; ROWS if there is none.

        NaN is beyond every limit.
        """
        cdef int joint, row, first = ROWS
        cdef double rate = 1.0 / self.period_s, most = 1.0 + TOLERANCE
        cdef double max_velocity, max_acceleration, before, jerk
        cdef Motion motion
        for joint in range(self.dof):
            max_velocity = most * (self.share * self.used.velocity[joint])
            max_acceleration = most * self.used.acceleration[joint]
            motion = _motion(self.past[1][joint], self.past[2][joint], self.c_command[joint], rate)
            before = _motion(self.past[0][joint], self.past[1][joint], self.past[2][joint], rate).acceleration
            jerk = rate * (motion.acceleration - before)
            if not self.lowest[joint] <= motion.position <= self.highest[joint]:
                row = 0
            elif not fabs(motion.velocity) <= max_velocity:
                row = 1
            elif not fabs(motion.acceleration) <= max_acceleration:
                row = 2
            elif not fabs(jerk) <= most * self.used.jerk[joint]:
                row = 3
            elif not fabs(self.c_command[self.dof + joint]) <= max_velocity:
                row = 4
            elif not fabs(self.c_command[2 * self.dof + joint]) <= max_acceleration:
                row = 5
            else:
                continue
            first = min(first, row)
        return first

    cdef int _foresee(self) noexcept nogil:
        """Return the kind of future excess to which the command would lead: a joint could stop only beyond
        its limit, or its acceleration could not be reduced before its velocity limit.
        """
        cdef int joint, found = NOTHING
        cdef double rate = 1.0 / self.period_s, most = (1.0 + 0.5 * TOLERANCE) * self.share
        cdef double velocity, peak, way
        cdef Motion motion
        if self._is_calm():
            return NOTHING
        for joint in range(self.dof):
            motion = _motion(self.past[1][joint], self.past[2][joint], self.c_command[joint], rate)
            velocity = motion.velocity + 0.5 * self.period_s * motion.acceleration
            peak = velocity + motion.acceleration * fabs(motion.acceleration) / (2.0 * self.used.jerk[joint])
            if fabs(peak) > most * self.used.velocity[joint]:
                return VELOCITY
            # The second difference is the acceleration one cycle ago.
            way = self._way(joint, fabs(velocity), fabs(motion.acceleration) + self._step_of(joint))
            if motion.position + way > self.highest[joint] and (velocity > 0.0 or motion.acceleration > 0.0):
                found = POSITION
            if motion.position - way < self.lowest[joint] and (velocity < 0.0 or motion.acceleration < 0.0):
                found = POSITION
        return found

    cdef bint _overruns(self) noexcept nogil:
        """Whether the motion that the command states leads a joint beyond the target range."""
        cdef int joint
        for joint in range(self.dof):
            if self.tracker.c_overruns(
                joint, self.c_command, &self.used, self.targets.c_low[joint], self.targets.c_high[joint]
            ):
                return True
        return False

    cdef bint _is_calm(self) noexcept nogil:
        """Whether the command is in the calm region, in which no future excess is possible, whatever the next
        command.
        """
        cdef int joint
        cdef double rate = 1.0 / self.period_s
        cdef Motion motion
        for joint in range(self.dof):
            motion = _motion(self.past[1][joint], self.past[2][joint], self.c_command[joint], rate)
            if not (
                self.calm_low[joint] <= motion.position <= self.calm_high[joint]
                and fabs(motion.velocity) <= self.calm_speed[joint]
                and fabs(motion.acceleration) <= self.calm_acceleration[joint]
            ):
                return False
        return True

    cdef bint _meets(self) noexcept nogil:
        """Whether the pursuit is so close that a step to the request is within the jerk limits."""
        cdef int joint
        cdef double rate = 1.0 / self.period_s, acceleration, most
        for joint in range(self.dof):
            acceleration = _motion(
                self.past[1][joint], self.past[2][joint], self.c_command[joint], rate
            ).acceleration
            most = MEETING * self._step_of(joint)
            if not (
                fabs(acceleration - self.pursued[2 * self.dof + joint]) <= most
                and fabs(acceleration - self.c_command[2 * self.dof + joint]) <= most
            ):
                return False
        return True

    cdef bint _catch(self, const double* request, int excess, int ahead, bint streamed) noexcept nogil:
        """Begin to pursue a request that may not pass. Returns whether it is finite; if not, the arm
        decelerates.
        """
        cdef int i
        cdef bint finite = True
        if not self.pursuing:
            self.quiet = ahead == OVERRUN or self.settled > 0
            self.caught = RATES if self.quiet else 0
        if self.quiet:
            self.settled = DIFFERENCES
        for i in range(3 * self.dof):
            finite = finite and isfinite(request[i])
        if not finite:
            self._catch_kind(NOT_FINITE)
            self.c_brake()
            return False
        if excess < ROWS:
            self._catch_kind(KINDS[excess])
        elif ahead >= 0:
            self._catch_kind(ahead)
        if not streamed or ahead == POSITION or not self._pursue_along(request):
            self._approach(request, streamed)
        return True

    cdef void _catch_kind(self, int kind) noexcept nogil:
        """Count each kind once per pursuit."""
        if not self.caught & (<unsigned int>1 << kind):
            self.caught |= <unsigned int>1 << kind
            self.c_count(kind)

    cdef void _approach(self, const double* request, bint streamed) noexcept nogil:
        """Pursue the position of a request. If it is streamed and there is room to stop, arrive with its
        velocity; otherwise stop there.
        """
        cdef int joint
        cdef double state[3 * MAX_DOF]
        cdef double target[MAX_DOF]
        cdef double velocity[MAX_DOF]
        cdef double max_velocity[MAX_DOF]
        cdef double low[MAX_DOF]
        cdef double high[MAX_DOF]
        cdef double wanted, reach
        for joint in range(self.dof):
            low[joint], high[joint] = self.lowest[joint], self.highest[joint]
            if streamed and self.ranged:
                low[joint] = fmin(fmax(low[joint], self.targets.c_low[joint]), high[joint])
                high[joint] = fmax(fmin(high[joint], self.targets.c_high[joint]), low[joint])
            wanted = request[self.dof + joint]
            target[joint] = fmin(fmax(request[joint], low[joint]), high[joint])
            velocity[joint] = 0.0
            if streamed and target[joint] == request[joint]:
                reach = target[joint] + copysign(self._way(joint, fabs(wanted), 0.0), wanted)
                if low[joint] <= reach <= high[joint]:
                    velocity[joint] = wanted
            max_velocity[joint] = fmin(self.share * self.used.velocity[joint], fabs(wanted) + self.catch_up)
        self.c_motion(state)
        self.tracker.c_approach(state, target, velocity, &self.used, max_velocity, low, high)
        self._let_through_pursuit()

    cdef bint _pursue_along(self, const double* request) noexcept nogil:
        """Pursue a moving request, if that is possible within the limits. Otherwise return False and pass on
        no command.
        """
        cdef int joint
        cdef double state[3 * MAX_DOF]
        cdef double wanted[3 * MAX_DOF]
        memcpy(wanted, request, 3 * self.dof * sizeof(double))
        for joint in range(self.dof):
            if not self.lowest[joint] <= request[joint] <= self.highest[joint]:
                return False
            if self.ranged:
                self._keep_in_range(joint, wanted)
        self.c_motion(state)
        if not self.tracker.c_along(
            state, wanted, &self.used, self.share, self.catch_up,
            self.targets.c_low if self.ranged else NULL, self.targets.c_high if self.ranged else NULL,
        ):
            return False
        memcpy(self.c_command, self.tracker.c_ahead, 3 * self.dof * sizeof(double))
        if self._excess() != ROWS or self._foresee() != NOTHING:
            return False
        self._let_through_pursuit()
        return True

    cdef void _keep_in_range(self, int joint, double* wanted) noexcept nogil:
        """Limit a request beyond the target range to its bound, at rest. With the velocity of a returning
        request, the arm would swing away from the bound again.
        """
        cdef double bound = fmin(fmax(wanted[joint], self.targets.c_low[joint]), self.targets.c_high[joint])
        if bound != wanted[joint]:
            wanted[joint] = bound
            wanted[self.dof + joint] = wanted[2 * self.dof + joint] = 0.0

    cdef void _let_through_pursuit(self) noexcept nogil:
        memcpy(self.c_command, self.tracker.c_ahead, 3 * self.dof * sizeof(double))
        memcpy(self.pursued, self.tracker.c_ahead, 3 * self.dof * sizeof(double))
        self.pursuing = True
        self._remember()

    cdef void _remember(self) noexcept nogil:
        memcpy(self.past[0], self.past[1], self.dof * sizeof(double))
        memcpy(self.past[1], self.past[2], self.dof * sizeof(double))
        memcpy(self.past[2], self.c_command, self.dof * sizeof(double))
        if self.beyond:
            self._come_back()

    cdef void _come_back(self) noexcept nogil:
        """Restore the limits of joints that were beyond them and are now within them."""
        cdef int joint
        self.beyond = False
        for joint in range(self.dof):
            if self.low[joint] <= self.c_command[joint] <= self.high[joint]:
                self.lowest[joint], self.highest[joint] = self.low[joint], self.high[joint]
            else:
                self.beyond = True
        self._find_calm()

    cdef void _find_calm(self) noexcept nogil:
        """Calculate the calm region: positions, velocities and accelerations from which no future excess is
        possible.
        """
        cdef int joint
        cdef double speed, acceleration, way
        for joint in range(self.dof):
            speed = CALM * self.share * self.used.velocity[joint]
            acceleration = fmin(self.used.acceleration[joint], sqrt(self.used.jerk[joint] * speed))
            way = self._way(joint, speed, acceleration + self._step_of(joint))
            self.calm_low[joint], self.calm_high[joint] = self.lowest[joint] + way, self.highest[joint] - way
            self.calm_speed[joint], self.calm_acceleration[joint] = speed, acceleration

    cdef void c_motion(self, double* state) noexcept nogil:
        """Calculate the actual motion of the commands, 3 × dof, whatever motion they state.

        It follows from the last three positions, whose difference is the velocity half a period ago. During a
        pursuit it is known exactly.
        """
        cdef int joint
        cdef double rate = 1.0 / self.period_s
        cdef Motion motion
        if self.pursuing:
            memcpy(state, self.pursued, 3 * self.dof * sizeof(double))
            return
        for joint in range(self.dof):
            motion = _motion(self.past[0][joint], self.past[1][joint], self.past[2][joint], rate)
            state[joint] = motion.position
            state[self.dof + joint] = motion.velocity + 0.5 * self.period_s * motion.acceleration
            state[2 * self.dof + joint] = motion.acceleration

    cdef double _step_of(self, int joint) noexcept nogil:
        """Return the maximum change of a joint's acceleration per cycle."""
        return self.used.jerk[joint] * self.period_s

    cdef double _way(self, int joint, double speed, double acceleration) noexcept nogil:
        """Return a simple upper bound of a joint's stopping distance.

        The acceleration is first reduced to zero, which may increase the speed; then the joint decelerates.
        With the maximum speed v and the limits a and j, the bound v²/2a + va/2j holds for all distances.
        """
        cdef double jerk = self.used.jerk[joint], most = self.used.acceleration[joint]
        cdef double peak = speed + 1.5 * self.period_s * acceleration
        peak += acceleration * acceleration / (2.0 * jerk)
        return WAY_SHARE * peak * (acceleration / jerk + peak / (2.0 * most) + most / (2.0 * jerk)) + WAY_RAD
