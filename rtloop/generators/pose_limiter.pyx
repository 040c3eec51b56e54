"""The limits of the TCP: norms of linear and angular velocity, acceleration and jerk."""

from libc.math cimport fabs, fmax, fmin, log, sqrt
from libc.string cimport memcpy, memset

import numpy as np

from cobot.arrays cimport doubles
from cobot.robot.quaternion cimport cross3, quat_between, quat_exp, quat_normalised, quat_product
from rtloop.generators.interpolation cimport clipped, plain
from rtloop.generators.moving_frame cimport Motion, to_rest_in_frame
from rtloop.generators.otg cimport OTG_OK, Problem, Profile, otg_step, otg_velocity, profile_at
from rtloop.generators.target_range cimport PoseRange

# Relative excess that passes unchanged, because differences of positions contain rounding errors.
cdef double TOLERANCE = 1e-3
cdef double MIN_SHARE = 0.25  # Minimum share of a limit for an axis across the motion.
# Minimum share of a limit for each axis of the base frame, before the shares are scaled to norm 1.
cdef double MIN_SPREAD = 0.35
# When the direction is chosen, the remaining distance divided by this time is its velocity, s.
cdef double LEAD_S = 0.2
cdef double SHARE = 0.9  # Share of the limits that the TCP uses while it catches up.
cdef double ALONG = 0.9  # Share of these limits that the pursued request may use.
# The axes turn when the request deviates from its expected position by this share of the distance that
# remained.
cdef double TURN = 0.25
cdef double TURNING = 2.0  # An axis across the motion can reach this multiple of the request's acceleration.
cdef double REST = 1e-9
cdef double BOUND = 1e-7  # m or rad: a stop no further than this beyond a bound is at the bound.
cdef double NO_WAY = 1e-12
cdef int HALVINGS = 8
cdef double FULL = 1e3  # The need of an axis that has no room to stop.
# Share of the largest need. Each axis decelerates at least as if it had this need.
cdef double MIN_NEED = 0.1
cdef double[9] BASE = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
cdef double MIN_ACROSS = 1e-3  # m/s or rad/s: the direction of a smaller velocity is only rounding.


cdef class PoseLimiter:
    """Follows a pose within the limits. Real-time safe. See pose_limiter.pyi.

    A request that stays within the limits passes unchanged, bit for bit. Any other request is pursued in a
    frame that moves with it. So the TCP catches up with a moving request, and does not overshoot a request at
    rest. The axes of the pursuit lie along and across the direction of motion. Each has its share of the
    limits, so that the norms are within the limits, and is planned separately. From rest to rest the motion
    is a straight line and a rotation about one axis. The axes keep their directions and shares while the
    request continues its motion. If they turned with the remaining distance, the TCP would circle a request
    that it passes closely.

    With a range of targets the TCP also keeps enough room to stop within it. A moving request is then pursued
    along the axes of the base frame, in which the range is given.

    An earlier version used the axes of the base frame, synchronised by Ruckig. If a request jumped while the
    TCP was moving, the velocities added up to 1.2 times the limit. In addition, Ruckig's result for an axis
    that had almost arrived determined the direction of the next cycle, so a different, equally exact
    generator led to different motions.
    """

    def __init__(self, double period_s, limits):
        self.pose, self.twist = np.array([0.0, 0, 0, 1, 0, 0, 0]), np.zeros(6)
        self.acceleration, self.speed = np.zeros(6), np.zeros(6)
        self.c_pose, self.c_twist = doubles(self.pose, 7), doubles(self.twist, 6)
        self.c_acceleration, self.c_speed = doubles(self.acceleration, 6), doubles(self.speed, 6)
        self.last[3] = 1.0
        self.period_s = period_s
        self.bounds = [
            [limits.max_linear_velocity, limits.max_angular_velocity],
            [limits.max_linear_acceleration, limits.max_angular_acceleration],
            [limits.max_linear_jerk, limits.max_angular_jerk],
        ]

    cdef void c_stay_within(self, PoseRange targets) noexcept:
        """Set the target range that the TCP may not leave."""
        self.targets = targets
        self.ranged = targets is not None

    cdef void c_begin(self, const double* pose, const double* twist) noexcept nogil:
        """Start at this pose, with this motion; NULL means rest."""
        memcpy(self.c_pose, pose, 7 * sizeof(double))
        memcpy(self.last, pose, 7 * sizeof(double))
        memset(self.c_twist, 0, 6 * sizeof(double))
        if twist != NULL:
            memcpy(self.c_twist, twist, 6 * sizeof(double))
        memcpy(self.own, self.c_twist, 6 * sizeof(double))
        memcpy(self.c_speed, self.c_twist, 6 * sizeof(double))
        memset(self.c_acceleration, 0, 6 * sizeof(double))
        self.differing = 0
        self.limited = False
        self.aligned[0] = self.aligned[1] = False

    cdef void c_step(self, const double* pose) noexcept nogil:
        """Advance by one period towards this pose."""
        cdef double step[6]
        cdef double velocity[6]
        cdef double rate[6]
        cdef double change[6]
        cdef double own[6]
        cdef double own_rate[6]
        cdef double gap
        cdef double period_s = self.period_s
        cdef int i
        _way(self.c_pose, pose, step)
        for i in range(6):
            velocity[i] = step[i] / period_s
            rate[i] = (velocity[i] - self.c_twist[i]) / period_s
            change[i] = (rate[i] - self.c_acceleration[i]) / period_s
            # velocity of the requests, if the last ones have passed unchanged
            own[i], own_rate[i] = velocity[i], rate[i]
        if self.differing:
            self.differing -= 1
            _way(self.last, pose, own)
            for i in range(6):
                own[i] /= period_s
                own_rate[i] = (own[i] - self.own[i]) / period_s
                # A TCP that reaches the request adopts its rates in the next cycles.
                gap = (velocity[i] - own[i]) / period_s
                change[i] = fmax(fabs(change[i]), fabs(rate[i] - own_rate[i]) / period_s)
                change[i] = fmax(change[i], fabs(rate[i] - own_rate[i] + gap) / period_s)
                change[i] = fmax(change[i], fabs(gap) / period_s)
        memcpy(self.last, pose, 7 * sizeof(double))
        memcpy(self.own, own, sizeof(own))
        self.limited = not (
            self._within(velocity, 0, 1.0 + TOLERANCE, REST)
            and self._within(rate, 1, 1.0 + TOLERANCE, REST)
            and self._within(change, 2, 1.0 + TOLERANCE, REST)
            and not (self.ranged and self._overruns(pose, velocity, rate))
        )
        if self.limited:
            self.differing = 3
            self._follow(step, own, own_rate)
            return
        self.aligned[0] = self.aligned[1] = False
        memcpy(self.c_pose, pose, 7 * sizeof(double))
        memcpy(self.c_twist, velocity, sizeof(velocity))
        memcpy(self.c_acceleration, rate, sizeof(rate))
        for i in range(6):
            self.c_speed[i] = velocity[i] + 0.5 * period_s * rate[i]

    cdef void _follow(self, const double* step, const double* own, const double* own_rate) noexcept nogil:
        """Move towards a request that is moving or has jumped, as well as the limits permit."""
        cdef double moving[6]
        cdef double moving_rate[6]
        cdef double rest[6]
        cdef int i
        memset(rest, 0, sizeof(rest))
        memcpy(moving, own, sizeof(moving))
        memcpy(moving_rate, own_rate, sizeof(moving_rate))
        for i in range(2):
            if _norm(own + 3 * i) > self.bounds[0][i] or _norm(own_rate + 3 * i) > self.bounds[1][i]:
                memset(&moving[3 * i], 0, 3 * sizeof(double))
                memset(&moving_rate[3 * i], 0, 3 * sizeof(double))
            self._align(i, step, own, moving, moving_rate)
        if self._pursue(step, moving, moving_rate) or self._pursue(step, rest, rest):
            return
        memset(self.c_acceleration, 0, 6 * sizeof(double))
        for i in range(6):
            rest[i] = self.period_s * self.c_speed[i]
        self._move(rest)

    cdef void _align(
        self, int part, const double* step, const double* own, const double* moving, const double* moving_rate
    ) noexcept nogil:
        """Choose the axes of a part (linear or angular) when its pursuit begins, and again when the request
        has deviated.

        They do not turn with the remaining distance, because the TCP would then circle a request that it
        passes closely.
        """
        cdef double direction[3]
        cdef double gap[3]
        cdef int first = 3 * part, i
        for i in range(3):
            self.strayed[part][i] += self.period_s * (own[first + i] - self.expected[part][i])
        if self.aligned[part] and _norm(self.strayed[part]) <= TURN * self.scale[part]:
            return
        for i in range(3):
            direction[i] = moving[first + i] + step[first + i] / LEAD_S
            gap[i] = self.c_speed[first + i] - moving[first + i]
            self.expected[part][i], self.strayed[part][i] = moving[first + i], 0.0
        self.scale[part] = fmax(_norm(step + first), LEAD_S * _norm(gap))
        self.aligned[part] = True
        self.square[part] = False
        _look_along(direction, gap, self.axes[part])
        self._share(part, gap, moving_rate + first)
        # The range of the targets is given along the axes of the base frame.
        if self.ranged and _norm(moving + first) > REST:
            self.square[part] = True
            memcpy(self.axes[part], BASE, sizeof(BASE))
            _spread(self.c_speed + first, moving_rate + first, self.shares[part])

    cdef bint _pursue(self, const double* step, const double* own, const double* own_rate) noexcept nogil:
        """Plan one period that reduces the distance to a moving request to zero. Returns whether there is a
        solution.
        """
        cdef double move[6]
        cdef double speed[6]
        cdef double rate[6]
        cdef int part
        for part in range(2):
            if not self._pursue_part(part, step, own, own_rate, move, speed, rate):
                return False
            if self.ranged:
                self._stay_within(part, move + 3 * part, speed + 3 * part, rate + 3 * part)
        memcpy(self.c_speed, speed, sizeof(speed))
        memcpy(self.c_acceleration, rate, sizeof(rate))
        self._move(move)
        return True

    cdef bint _pursue_part(
        self, int part, const double* step, const double* own, const double* own_rate,
        double* move, double* speed, double* rate,
    ) noexcept nogil:
        """Plan the linear or the angular part: separately for each axis, along and across the direction of
        motion.
        """
        cdef const double* axes = self.axes[part]
        cdef double ahead[9]
        cdef double velocities[3]
        cdef int first = 3 * part, i
        self._share_velocity(part, own + first, velocities)
        for i in range(3):
            if not self._pursue_axis(
                &axes[3 * i], self.shares[part][i], velocities[i], part,
                step + first, own + first, own_rate + first, &ahead[3 * i],
            ):
                return False
        self._from_axes(part, ahead, move + first, speed + first, rate + first)
        return True

    cdef void _share(self, int part, const double* gap, const double* moving_rate) noexcept nogil:
        """Divide the limits of acceleration and jerk among the axes for the whole pursuit. The shares have
        norm 1.

        Across the direction, the shares must suffice to stop the current motion, both in the base frame and
        in the frame of the request, and to turn with the request.
        """
        cdef double* shares = self.shares[part]
        cdef const double* axis
        cdef double velocity, rate, norm
        cdef int i
        shares[0] = 1.0
        for i in range(1, 3):
            axis = &self.axes[part][3 * i]
            velocity = fmax(fabs(_dot(axis, gap)), fabs(_dot(axis, self.c_speed + 3 * part)))
            rate = TURNING * fabs(_dot(axis, moving_rate))
            rate = fmax(rate, fabs(_dot(axis, self.c_acceleration + 3 * part)))
            shares[i] = fmax(velocity / self.bounds[0][part], rate / self.bounds[1][part])
            shares[i] = fmin(fmax(shares[i], MIN_SHARE), 1.0)
        norm = _norm(shares)
        for i in range(3):
            shares[i] /= norm

    cdef void _share_velocity(self, int part, const double* own, double* velocities) noexcept nogil:
        """Calculate the velocity limit of each axis.

        Each limit includes the request's own velocity. An axis across the direction may still gain speed
        until its acceleration is reduced; this speed is subtracted along the direction.
        """
        cdef const double* shares = self.shares[part]
        cdef const double* axis
        cdef double most_velocity = SHARE * self.bounds[0][part]
        cdef double most = most_velocity * most_velocity, rest = most, left = most
        cdef double moving[3]
        cdef double velocity, rate, peak
        cdef int i
        for i in range(3):
            moving[i] = fabs(_dot(&self.axes[part][3 * i], own)) / ALONG
            rest -= moving[i] * moving[i]
        rest = fmax(rest, MIN_SHARE * MIN_SHARE * most)
        for i in range(3):
            axis = &self.axes[part][3 * i]
            velocities[i] = sqrt(moving[i] * moving[i] + rest * shares[i] * shares[i])
            velocity, rate = _dot(axis, self.c_speed + 3 * part), _dot(axis, self.c_acceleration + 3 * part)
            peak = 0.5 * rate * fabs(rate) / (SHARE * shares[i] * self.bounds[2][part])
            peak = fmax(fabs(velocity), fabs(velocity + peak))
            left -= peak * peak if i > 0 else 0.0
        if self.square[part]:
            return
        velocities[0] = fmax(sqrt(fmax(left, 0.0)), fmax(moving[0], MIN_SHARE * most_velocity))

    cdef bint _pursue_axis(
        self, const double* axis, double share, double max_velocity, int part,
        const double* step, const double* own, const double* own_rate, double* ahead,
    ) noexcept nogil:
        """Plan one axis with its share of the limits: relative position, velocity and acceleration one period
        later. Returns whether there is a solution.
        """
        cdef double max_acceleration = SHARE * share * self.bounds[1][part]
        cdef Motion state, frame
        cdef Problem problem
        state.position = 0.0
        state.velocity = _dot(axis, self.c_speed + 3 * part)
        state.acceleration = _dot(axis, self.c_acceleration + 3 * part)
        frame.position = _dot(axis, step)
        # A step of the request is its mean velocity over a period, which is the velocity half a period ago.
        frame.velocity = _dot(axis, own) + 0.5 * self.period_s * _dot(axis, own_rate)
        frame.velocity = clipped(frame.velocity, ALONG * max_velocity)
        frame.acceleration = clipped(_dot(axis, own_rate), ALONG * max_acceleration)
        to_rest_in_frame(&problem, state, frame, self.period_s, max_velocity, max_acceleration)
        problem.max_jerk = SHARE * share * self.bounds[2][part]
        if otg_step(&problem, self.period_s, ahead) != OTG_OK:
            return False
        ahead[0] += frame.position
        ahead[1] += frame.velocity
        ahead[2] += frame.acceleration
        return True

    cdef bint _overruns(self, const double* pose, const double* velocity, const double* rate) noexcept nogil:
        """Whether a TCP that moved to this pose could stop only outside the target range."""
        cdef double low[6]
        cdef double high[6]
        cdef double ahead[9]
        cdef double needs[3]
        cdef int part, i
        self.targets.c_room(pose, low, high)
        for part in range(2):
            for i in range(3):
                ahead[i], ahead[6 + i] = 0.0, rate[3 * part + i]
                ahead[3 + i] = velocity[3 * part + i] + 0.5 * self.period_s * ahead[6 + i]
            if self._load(part, ahead, low + 3 * part, high + 3 * part, needs) > 1.0:
                return True
        return False

    cdef double _stop_way(self, int part, double share, double speed, double rate) noexcept nogil:
        """Return the distance in which an axis with this share of the limits comes to rest."""
        cdef double there[3]
        cdef Profile stop
        if not self._brake(part, share, speed, rate, 0.0, there, &stop):
            return 0.0
        return stop.end_position

    cdef bint _brake(
        self, int part, double share, double speed, double rate, double time_s, double* there, Profile* stop
    ) noexcept nogil:
        """Calculate the state of an axis that has decelerated for this time as fast as its share of the
        limits permits. Returns whether there is a solution.
        """
        cdef Problem problem
        problem.position = problem.target_position = problem.target_velocity = 0.0
        problem.velocity, problem.acceleration = speed, rate
        problem.min_velocity = problem.max_velocity = 0.0  # not used in this problem
        problem.max_acceleration = share * self.bounds[1][part]
        problem.min_acceleration = -problem.max_acceleration
        problem.max_jerk = share * self.bounds[2][part]
        if (speed == 0.0 and rate == 0.0) or otg_velocity(&problem, stop) != OTG_OK:
            return False
        profile_at(stop, time_s, there)
        return True

    cdef double _load(
        self, int part, const double* ahead, const double* low, const double* high, double* needs
    ) noexcept nogil:
        """Calculate the share of the limits that is needed to stop within the bounds after a step, (3, 3). Up
        to 1, a stop is possible. Also calculates the share that each axis of the base frame needs by itself.

        From the stopping distance with half of the limits follows the power with which the distance depends
        on the share.
        """
        cdef double way, half, room, total = 0.0
        cdef int i
        for i in range(3):
            needs[i] = 0.0
            way = self._stop_way(part, SHARE, ahead[3 + i], ahead[6 + i])
            if fabs(way) <= NO_WAY:
                continue
            room = (high[i] - ahead[i] if way > 0.0 else ahead[i] - low[i]) + BOUND
            needs[i] = FULL
            if room > fabs(way) / FULL:
                half = self._stop_way(part, 0.5 * SHARE, ahead[3 + i], ahead[6 + i]) / way
                needs[i] = (fabs(way) / room) ** (log(2.0) / log(fmin(fmax(half, sqrt(2.0)), 2.0)))
                needs[i] = fmin(needs[i], FULL)
            total += needs[i] * needs[i]
        return sqrt(total)

    cdef void _stay_within(self, int part, double* move, double* speed, double* rate) noexcept nogil:
        """Make as large a part of a step as lets the TCP still stop within the target range. The rest of the
        step decelerates, most where there is least room.
        """
        cdef double low[6]
        cdef double high[6]
        cdef double wanted[9]
        cdef double stop[9]
        cdef double mixed[9]
        cdef double needs[3]
        cdef double weights[3]
        cdef double share = 1.0, least = 0.0, most = 1.0
        cdef double most_speed = fmax(_norm(self.c_speed + 3 * part), REST)
        cdef int i, _half
        self.targets.c_room(self.c_pose, low, high)
        memcpy(wanted, move, 3 * sizeof(double))
        memcpy(wanted + 3, speed, 3 * sizeof(double))
        memcpy(wanted + 6, rate, 3 * sizeof(double))
        if self._load(part, wanted, low + 3 * part, high + 3 * part, needs) <= 1.0:
            return
        for i in range(3):  # An axis that is too late in any case must not take anything from the other axes.
            weights[i] = fmin(fmax(needs[i], MIN_NEED), 1.0)
            if needs[i] > 1.0:
                weights[i] = fmax(fmin(1.0, fabs(self.c_speed[3 * part + i]) / most_speed), MIN_NEED)
        self._find_brake(part, weights, stop)
        # The share `least` of the deceleration is not enough; `most` is enough, unless no share is.
        for _half in range(HALVINGS):
            for i in range(9):
                mixed[i] = wanted[i] + share * weights[i % 3] * (stop[i] - wanted[i])
            if self._load(part, mixed, low + 3 * part, high + 3 * part, needs) <= 1.0:
                most = share
            elif share == 1.0:
                weights[0] = weights[1] = weights[2] = 1.0
                break
            else:
                least = share
            share = 0.5 * (least + most)
        for i in range(3):
            move[i] = wanted[i] + most * weights[i] * (stop[i] - wanted[i])
            speed[i] = wanted[3 + i] + most * weights[i] * (stop[3 + i] - wanted[3 + i])
            rate[i] = wanted[6 + i] + most * weights[i] * (stop[6 + i] - wanted[6 + i])

    cdef void _find_brake(self, int part, const double* weights, double* ahead) noexcept nogil:
        """Calculate one period of decelerating to rest, (3, 3). Each axis of the base frame has its share of
        the limits.
        """
        cdef double there[3]
        cdef double norm = _norm(weights)
        cdef Profile stop
        cdef int i, row
        for i in range(3):
            if not self._brake(
                part, weights[i] / norm, self.c_speed[3 * part + i], self.c_acceleration[3 * part + i],
                self.period_s, there, &stop,
            ):
                there[0] = there[1] = there[2] = 0.0
            for row in range(3):
                ahead[3 * row + i] = there[row]

    cdef void _from_axes(
        self, int part, const double* ahead, double* move, double* speed, double* rate
    ) noexcept nogil:
        cdef const double* axes = self.axes[part]
        cdef int i
        for i in range(3):
            move[i] = axes[i] * ahead[0] + axes[3 + i] * ahead[3] + axes[6 + i] * ahead[6]
            speed[i] = axes[i] * ahead[1] + axes[3 + i] * ahead[4] + axes[6 + i] * ahead[7]
            rate[i] = axes[i] * ahead[2] + axes[3 + i] * ahead[5] + axes[6 + i] * ahead[8]

    cdef void _move(self, const double* move) noexcept nogil:
        cdef double turn[4]
        cdef double turned[4]
        cdef int i
        for i in range(6):
            self.c_twist[i] = move[i] / self.period_s
        for i in range(3):
            self.c_pose[i] += move[i]
        quat_exp(move + 3, turn)
        quat_product(turn, self.c_pose + 3, turned)
        quat_normalised(turned, self.c_pose + 3)

    cdef bint _within(self, const double* row, int order, double factor, double more) noexcept nogil:
        """Whether both parts of a derivative (linear and angular) are within the limits. False for NaN."""
        return (
            _norm(row) <= factor * self.bounds[order][0] + more
            and _norm(row + 3) <= factor * self.bounds[order][1] + more
        )

    def stay_within(self, PoseRange targets):
        self.c_stay_within(targets)

    def begin(self, pose, twist=0.0):
        here, motion = plain(pose, (7,)), plain(twist, (6,))
        self.c_begin(doubles(here, 7), doubles(motion, 6))

    def step(self, pose):
        there = plain(pose, (7,))
        self.c_step(doubles(there, 7))


cdef inline double _norm(const double* v) noexcept nogil:
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


cdef inline void _way(const double* start, const double* end, double* out) noexcept nogil:
    """Calculate the difference between two poses: translation, m, and rotation vector, rad, in the base
    frame.
    """
    cdef int i
    for i in range(3):
        out[i] = end[i] - start[i]
    quat_between(start + 3, end + 3, out + 3)


cdef inline double _dot(const double* a, const double* b) noexcept nogil:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


cdef inline void _look_along(const double* direction, const double* velocity, double* axes) noexcept nogil:
    """Calculate three axes, one per row: the first along the direction, the second perpendicular to it,
    towards the velocity.
    """
    cdef double norm = _norm(direction), along
    cdef int i, least = 0
    memset(axes, 0, 9 * sizeof(double))
    if not norm > REST:
        axes[0] = axes[4] = axes[8] = 1.0
        return
    for i in range(3):
        axes[i] = direction[i] / norm
    along = _dot(axes, velocity)
    for i in range(3):
        axes[3 + i] = velocity[i] - along * axes[i]
    norm = _norm(axes + 3)
    if not norm > MIN_ACROSS:
        for i in range(1, 3):
            if fabs(axes[i]) < fabs(axes[least]):
                least = i
        for i in range(3):
            axes[3 + i] = (1.0 if i == least else 0.0) - axes[least] * axes[i]
        norm = _norm(axes + 3)
    for i in range(3):
        axes[3 + i] /= norm
    cross3(axes, axes + 3, axes + 6)


cdef inline void _spread(const double* speed, const double* rate, double* shares) noexcept nogil:
    """Distribute the limits to the axes of the base frame in proportion to the motion, with norm 1."""
    cdef double most_speed = _norm(speed), most_rate = _norm(rate), norm
    cdef int i
    for i in range(3):
        shares[i] = MIN_SPREAD
        if most_speed > REST:
            shares[i] = fmax(shares[i], fabs(speed[i]) / most_speed)
        if most_rate > REST:
            shares[i] = fmax(shares[i], fabs(rate[i]) / most_rate)
    norm = _norm(shares)
    for i in range(3):
        shares[i] /= norm
