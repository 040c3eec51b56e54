# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Online trajectory generation for single axes: time-optimal motion under limits of jerk and acceleration,
and of velocity if the target is a position. Pure C: no allocation, no exceptions, bounded work.

This module is long because its small functions are called often, and the compiler inlines them only within
one translation unit.

How the position interface works. All quantities are divided by the jerk limit: the jerk is 1, an acceleration
is the time to reach it. A motion up raises the acceleration to a peak, lowers it below zero, and raises it to
zero again:

    jerk +1 from a0 to `rise`, hold if at the limit, jerk −1 to −`sink`, hold if at the limit, +1 to 0.

With the end state given, these motions form one family with one parameter. The family begins with the
shortest change of velocity, with the displacement D0. Along the family the duration T never decreases. A
motion up has the greatest displacement of all motions of its duration, its mirror image the least (the
maximum principle, for a linear system). The displacements that can be reached in a given duration are
therefore an interval that begins at D0 and changes continuously. So a displacement above D0 is reached first
by a motion up: the first one of the family with this displacement. A displacement below D0 is the mirrored
problem.

Two facts make that first one easy to find. Let w be the velocity where the falling acceleration is zero (a
virtual one while `rise` is negative). By the maximum principle

    dD/dT = H = w + rise · sink / 2,

and H first decreases and then increases while `rise` is negative, and increases from `rise` = 0 on. So D has
at most one maximum before it grows for good, known in closed form; every root is bracketed alone, and
Newton's method finds it. Once w is at the velocity limit, the family continues with a cruise.

As long as nothing is held, the velocities imply rise² − sink² = kappa, a constant, so that everything is
rational in the duration of the fall, sigma = rise + sink. Sigma is the family's parameter, also with holds,
up to the motion that just reaches both limits.

Several axes move along a straight line if possible. Otherwise they are synchronised in time: the faster ones
cruise at a lower velocity.

A state beyond the limits is first brought within them, by the same rules as in Ruckig, the reference of the
tests. Vocabulary: Berscheid and Kröger, Jerk-limited Real-time Trajectory Generation with Arbitrary Target
States, RSS 2021.
"""

from libc.math cimport INFINITY, cbrt, fabs, fmax, fmin, isfinite, sqrt


cdef enum:
    MAX_ITERATIONS = 80  # Newton's method needs about six, bisection alone would need 60.

# Relative deviation between an axis that follows its plan and a new plan from its current state.
cdef double ROUNDING = 1e-13
# Maximum relative error of a profile's end due to rounding. A larger error is a failure.
cdef double END_TOLERANCE = 1e-9
cdef double COLLINEAR = 1e-9  # Relative: a component across a line up to this size is rounding.


# --- Profile ---


cdef struct State:
    double position, velocity, acceleration


cdef inline void _advance(State* state, double time_s, double jerk) noexcept nogil:
    cdef double speed_up = time_s * jerk
    state.position += time_s * (
        state.velocity + time_s * (0.5 * state.acceleration + speed_up / 6.0)
    )
    state.velocity += time_s * (state.acceleration + 0.5 * speed_up)
    state.acceleration += speed_up


cdef inline void _append(Profile* profile, State* state, double duration_s, double jerk) noexcept nogil:
    """Append a phase from this state, and set the state to its end. A phase whose duration is negative
    because of rounding is omitted.
    """
    cdef int i = profile.count
    if not duration_s > 0.0:
        return
    profile.duration_s[i] = duration_s
    profile.jerk[i] = jerk
    profile.position[i] = state.position
    profile.velocity[i] = state.velocity
    profile.acceleration[i] = state.acceleration
    profile.duration += duration_s
    profile.count = i + 1
    _advance(state, duration_s, jerk)


cdef void profile_at(const Profile* profile, double time_s, double* out) noexcept nogil:
    """Calculate position, velocity and acceleration at a time. Before the start, they are those of the start;
    after the end, the motion continues with the final velocity.
    """
    cdef State state
    cdef double left = fmax(time_s, 0.0)
    cdef int i
    if time_s < profile.duration:
        for i in range(profile.count):
            if left < profile.duration_s[i] or i == profile.count - 1:
                state.position = profile.position[i]
                state.velocity = profile.velocity[i]
                state.acceleration = profile.acceleration[i]
                _advance(&state, left, profile.jerk[i])
                out[0], out[1], out[2] = state.position, state.velocity, state.acceleration
                return
            left -= profile.duration_s[i]
    out[0] = profile.end_position + profile.end_velocity * (time_s - profile.duration)
    out[1] = profile.end_velocity
    out[2] = 0.0


cdef inline void _stretch(const Profile* profile, int i, double time_s, double* out) noexcept nogil:
    """Extend the range by the position that phase i has at this time, if the time is within the phase."""
    cdef State state
    if 0.0 < time_s < profile.duration_s[i]:
        state.position = profile.position[i]
        state.velocity = profile.velocity[i]
        state.acceleration = profile.acceleration[i]
        _advance(&state, time_s, profile.jerk[i])
        out[0], out[1] = fmin(out[0], state.position), fmax(out[1], state.position)


cdef void profile_extrema(const Profile* profile, double* out) noexcept nogil:
    """Calculate the minimum and maximum position, including both ends."""
    cdef double v, a, jerk, root
    cdef int i
    out[0] = out[1] = profile.end_position
    for i in range(profile.count):
        out[0], out[1] = fmin(out[0], profile.position[i]), fmax(out[1], profile.position[i])
        v, a, jerk = profile.velocity[i], profile.acceleration[i], profile.jerk[i]
        root = a * a - 2.0 * jerk * v
        if root < 0.0:
            continue
        # The zeros of v + a t + jerk t² / 2, without cancellation.
        root = -a - sqrt(root) if a > 0.0 else -a + sqrt(root)
        if jerk != 0.0:
            _stretch(profile, i, root / jerk, out)
        if root != 0.0:
            _stretch(profile, i, 2.0 * v / root, out)


# --- The family of the motions up ---


cdef struct Family:
    double start_acceleration  # a0
    # Velocity at acceleration zero, if jerk +1 led from there to the start: v0 − a0²/2.
    double start_velocity
    double lead  # The displacement from there to the start.
    double end_velocity
    double max_acceleration, max_deceleration  # Both positive.
    double kappa
    # Whether the shortest change of velocity begins with the fall; if not, it ends with it.
    bint falls


cdef struct Shape:
    double rise, rise_hold, cruise, sink_hold, sink


cdef inline void _begin(
    Family* family, double velocity, double acceleration, double end_velocity,
    double max_acceleration, double max_deceleration,
) noexcept nogil:
    """Begin a family. If the target's velocity differs only by rounding from the velocity after the
    acceleration has been reduced to zero, the latter is used. The duration of a ramp for the difference would
    be the square root of the rounding.
    """
    cdef double half_square = 0.5 * acceleration * acceleration
    cdef double change = end_velocity - velocity
    cdef double direct = half_square if acceleration > 0.0 else -half_square
    if fabs(change - direct) <= ROUNDING * (fabs(end_velocity) + fabs(velocity) + half_square):
        change = direct
    family.start_acceleration = acceleration
    family.start_velocity = velocity - half_square
    family.lead = acceleration * (family.start_velocity + acceleration * acceleration / 6.0)
    family.end_velocity = end_velocity
    family.max_acceleration = max_acceleration
    family.max_deceleration = max_deceleration
    family.kappa = change + half_square
    family.falls = change < direct


cdef inline void _ramp(double change, double limit, double* peak, double* hold) noexcept nogil:
    """Calculate the fastest change of velocity between two zeros of the acceleration: its peak, and the
    duration for which the peak is held.
    """
    peak[0] = sqrt(fmax(change, 0.0))
    hold[0] = 0.0
    if peak[0] > limit:
        peak[0], hold[0] = limit, change / limit - limit


cdef inline void _shortest(const Family* family, Shape* shape) noexcept nogil:
    """Calculate the shortest change of velocity, with which the family begins."""
    cdef double a0 = family.start_acceleration
    shape.rise_hold = shape.cruise = shape.sink_hold = shape.sink = 0.0
    if family.falls:
        shape.rise = a0
        _ramp(a0 * a0 - family.kappa, family.max_deceleration, &shape.sink, &shape.sink_hold)
    else:
        _ramp(family.kappa, family.max_acceleration, &shape.rise, &shape.rise_hold)


cdef inline double _top(const Family* family, const Shape* shape) noexcept nogil:
    """Return w, the velocity at which the falling acceleration is zero."""
    return family.end_velocity + shape.sink * shape.sink + family.max_deceleration * shape.sink_hold


cdef inline double _displacement(const Family* family, const Shape* shape) noexcept nogil:
    """Return D without the cruise. Between two zeros of the acceleration, the motion is symmetric in time, so
    its mean velocity is that of its ends.
    """
    cdef double before = (
        family.start_velocity + shape.rise * shape.rise + family.max_acceleration * shape.rise_hold
    )
    return (
        0.5 * (family.start_velocity + before) * (2.0 * shape.rise + shape.rise_hold)
        + 0.5 * (family.end_velocity + _top(family, shape)) * (2.0 * shape.sink + shape.sink_hold)
        - family.lead
    )


cdef inline double _gain(const Family* family, const Shape* shape) noexcept nogil:
    """Return H = dD/dT."""
    return _top(family, shape) + 0.5 * shape.rise * shape.sink


cdef inline double _at_sigma(const Family* family, double sigma, Shape* shape) noexcept nogil:
    """Calculate the motion whose acceleration falls for the duration `sigma`, at most the sum of both limits.
    Returns dT/dsigma.
    """
    cdef double high = family.max_acceleration, low = family.max_deceleration
    cdef double above = sigma * (sigma - 2.0 * high) + family.kappa
    cdef double below = sigma * (sigma - 2.0 * low) - family.kappa
    shape.rise_hold = shape.cruise = shape.sink_hold = 0.0
    if above > 0.0:
        shape.rise, shape.rise_hold, shape.sink = high, above / high, sigma - high
        return 2.0 * sigma / high
    if below > 0.0:
        shape.sink, shape.sink_hold, shape.rise = low, below / low, sigma - low
        return 2.0 * sigma / low
    shape.rise = 0.5 * (sigma + family.kappa / sigma)
    shape.sink = 0.5 * (sigma - family.kappa / sigma)
    return 2.0


cdef void _solve(
    const Family* family, double displacement, double low, double high, Shape* shape
) noexcept nogil:
    """Find the motion with this displacement, in a bracket with one root, by Newton's method from above."""
    cdef double sigma = high, following, off, slope
    cdef int _i
    for _i in range(MAX_ITERATIONS):
        slope = _at_sigma(family, sigma, shape) * _gain(family, shape)
        off = _displacement(family, shape) - displacement
        if off > 0.0:
            high = sigma
        else:
            low = sigma
        following = sigma - off / slope
        if not low <= following <= high:
            following = 0.5 * (low + high)
        if fabs(following - sigma) <= 4e-16 * sigma:
            return
        sigma = following


cdef inline double _first_maximum(const Family* family, double low, double high) noexcept nogil:
    """Return the sigma at which H falls below zero while `rise` is negative; `low` if there is none."""
    cdef double limit = family.max_deceleration, kappa = family.kappa
    cdef double free_from = low, root, sigma, mean
    if limit * limit + kappa <= 0.0:
        free_from = high
    else:
        free_from = fmax(low, limit - sqrt(limit * limit + kappa))
    # The minimum acceleration is held up to free_from: H = start_velocity + rise² + rise · limit / 2.
    root = limit * limit / 16.0 - family.start_velocity
    if low < free_from and root > 0.0:
        sigma = 0.75 * limit - sqrt(root)
        if low < sigma <= free_from:
            return sigma
    # Then it is not held: H = mean + 3/8 sigma² + kappa² / (8 sigma²).
    mean = family.start_velocity + 0.5 * kappa
    root = mean * mean - 0.1875 * kappa * kappa
    if mean < 0.0 and root > 0.0:
        sigma = 0.5 * fabs(kappa) / sqrt(sqrt(root) - mean)
        if free_from < sigma < high:
            return sigma
    return low


cdef inline double _beyond(double way, double gain) noexcept nogil:
    """Return an upper bound of the increase of sigma when D increases by `way`. From `rise` = 0 on, H grows
    by at least sigma²/4, so D grows by at least 2 H sigma + sigma³/6.
    """
    if gain > 0.0:
        return fmin(cbrt(6.0 * way), 0.5 * way / gain)
    return fmax(cbrt(12.0 * way), sqrt(-24.0 * gain))


cdef inline void _hold_both(const Family* family, double way, Shape* shape) noexcept nogil:
    """Continue by `way` from a motion that reaches both limits. H then grows in proportion to the holds, so D
    is quadratic.
    """
    cdef double high = family.max_acceleration, low = family.max_deceleration
    cdef double gain = _gain(family, shape), longer
    way *= high / (high + low)
    longer = sqrt(gain * gain + 2.0 * low * way)
    longer = 2.0 * way / (gain + longer) if gain > 0.0 else (longer - gain) / low
    shape.sink_hold += longer
    shape.rise_hold += longer * low / high


cdef inline bint _find_below_zero(
    const Family* family, double displacement, double tolerance, double* low, Shape* shape
) noexcept nogil:
    """Find the motion if its `rise` is negative. Otherwise set `low` and `shape` to their values at `rise` =
    0.
    """
    cdef double split = fmin(sqrt(-family.kappa), family.max_deceleration), maximum
    if _gain(family, shape) > 0.0:
        maximum = _first_maximum(family, low[0], split)
        if maximum > low[0]:
            _at_sigma(family, maximum, shape)
            if _displacement(family, shape) >= displacement - tolerance:
                _solve(family, displacement, low[0], maximum, shape)
                return True
            low[0] = maximum
    _at_sigma(family, split, shape)
    if _displacement(family, shape) >= displacement:
        _solve(family, displacement, low[0], split, shape)
        return True
    low[0] = split
    return False


cdef bint _find(
    const Family* family, double displacement, double tolerance, double max_velocity, Shape* shape
) noexcept nogil:
    """Find the first motion of the family with this displacement. Returns whether there is one. Expects the
    family's first motion in `shape`, and a displacement that is not below that motion's.

    Where D first decreases, or is at its maximum, a displacement that is larger by the tolerance would take
    much longer. There, this difference is neglected, because it may be rounding.
    """
    cdef double both = family.max_acceleration + family.max_deceleration
    cdef double a0 = family.start_acceleration, low = shape.rise + shape.sink, high
    cdef double way = displacement - _displacement(family, shape)
    cdef Shape end
    if way <= 0.0 or (way <= tolerance and _gain(family, shape) < 0.0):
        return True
    if family.falls and a0 < 0.0:
        if shape.sink_hold == 0.0:
            low = -family.kappa / (shape.sink - a0)  # The same without cancellation.
        if _find_below_zero(family, displacement, tolerance, &low, shape):
            return True
        way = displacement - _displacement(family, shape)
    high = low + 1.000001 * _beyond(way, _gain(family, shape))
    _ramp(max_velocity - family.start_velocity, family.max_acceleration, &end.rise, &end.rise_hold)
    _ramp(max_velocity - family.end_velocity, family.max_deceleration, &end.sink, &end.sink_hold)
    way = displacement - _displacement(family, &end)
    if way >= 0.0:
        shape[0] = end
        shape.cruise = way / max_velocity if way > 0.0 else 0.0
        return shape.cruise >= 0.0
    if end.rise + end.sink >= both:
        _at_sigma(family, both, &end)
        way = displacement - _displacement(family, &end)
        if way > 0.0:
            _hold_both(family, way, &end)
            shape[0] = end
            return True
    _solve(family, displacement, low, fmin(high, end.rise + end.sink), shape)
    return True


# --- A state beyond the limits ---


cdef struct Limits:  # In units of the jerk limit.
    double min_velocity, max_velocity, min_acceleration, max_acceleration


cdef inline Limits _limits(const Problem* problem) noexcept nogil:
    cdef Limits limits
    limits.min_velocity = problem.min_velocity / problem.max_jerk
    limits.max_velocity = problem.max_velocity / problem.max_jerk
    limits.min_acceleration = problem.min_acceleration / problem.max_jerk
    limits.max_acceleration = problem.max_acceleration / problem.max_jerk
    return limits


cdef inline Limits _mirrored(const Limits* limits) noexcept nogil:
    cdef Limits mirrored
    mirrored.min_velocity, mirrored.max_velocity = -limits.max_velocity, -limits.min_velocity
    mirrored.min_acceleration, mirrored.max_acceleration = -limits.max_acceleration, -limits.min_acceleration
    return mirrored


cdef inline bint _too_fast(double v, double a, const Limits* limits) noexcept nogil:
    """Whether the velocity is above its limit or will be, unless it would end below the lower limit."""
    cdef double half_square = 0.5 * a * a
    return (v > limits.max_velocity and v - half_square > limits.min_velocity) or (
        a > 0.0 and v + half_square > limits.max_velocity
    )


cdef inline void _brake_velocity(
    double v, double a, const Limits* limits, double* fall, double* hold
) noexcept nogil:
    """Calculate the phases with jerk −1, then the minimum acceleration, until the velocity is at its upper
    limit or would end below the lower one.
    """
    cdef double least = limits.min_acceleration, until
    until = a + sqrt(fmax(a * a + 2.0 * (v - limits.max_velocity), 0.0))
    until = fmin(until, a + sqrt(fmax(0.5 * a * a + v - limits.min_velocity, 0.0)))
    fall[0], hold[0] = fmin(a - least, until), 0.0
    if a - least < until:
        v += 0.5 * (a * a - least * least)
        until = fmin((limits.max_velocity - v) / least, (limits.min_velocity - v) / least + 0.5 * least)
        hold[0] = fmax(until, 0.0)


cdef inline void _brake_acceleration(
    double v, double a, const Limits* limits, double* fall, double* hold
) noexcept nogil:
    """Calculate the phases with jerk −1 to the maximum acceleration, which is held while the velocity is
    below its lower limit.
    """
    cdef double most = limits.max_acceleration
    if v + 0.5 * a * a > limits.max_velocity:
        _brake_velocity(v, a, limits, fall, hold)
        return
    fall[0], hold[0] = a - most, 0.0
    v += 0.5 * (a * a - most * most)
    if v < limits.min_velocity:
        hold[0] = fmax(
            fmin((limits.min_velocity - v) / most, (limits.max_velocity - v) / most - 0.5 * most), 0.0
        )


cdef inline int _brake(double v, double a, const Limits* limits, double* fall, double* hold) noexcept nogil:
    """Calculate the durations of the two phases that bring a state within the limits: jerk −1, then 0.
    Returns 1, −1 if mirrored, or 0 if the state is already within the limits.
    """
    cdef Limits mirrored = _mirrored(limits)
    if a > limits.max_acceleration:
        _brake_acceleration(v, a, limits, fall, hold)
        return 1
    if a < limits.min_acceleration:
        _brake_acceleration(-v, -a, &mirrored, fall, hold)
        return -1
    if _too_fast(v, a, limits):
        _brake_velocity(v, a, limits, fall, hold)
        return 1
    if _too_fast(-v, -a, &mirrored):
        _brake_velocity(-v, -a, &mirrored, fall, hold)
        return -1
    return 0


# --- Interfaces ---


cdef inline void _start(const Problem* problem, Profile* profile, State* state) noexcept nogil:
    state.position, state.velocity = problem.position, problem.velocity
    state.acceleration = problem.acceleration
    profile.count = 0
    profile.duration = 0.0


cdef inline bint _valid(const Problem* problem) noexcept nogil:
    """Whether all numbers of a velocity problem are valid, and its limits have the right signs."""
    return (
        isfinite(problem.position + problem.velocity + problem.acceleration + problem.target_velocity)
        and isfinite(problem.max_acceleration - problem.min_acceleration + problem.max_jerk)
        and problem.max_jerk > 0.0
        and problem.max_acceleration > 0.0
        and problem.min_acceleration < 0.0
    )


cdef inline void _move(
    Profile* profile, State* state, double jerk, double max_velocity, const Shape* shape
) noexcept nogil:
    """Append the phases of an upward motion, or of its mirror image if the jerk is negative. Known
    accelerations, and the velocity of the cruise, are set exactly, because rounding would accumulate over a
    long phase.
    """
    _append(profile, state, shape.rise - state.acceleration / jerk, jerk)
    state.acceleration = shape.rise * jerk
    _append(profile, state, shape.rise_hold, 0.0)
    if shape.cruise > 0.0:
        _append(profile, state, shape.rise, -jerk)
        state.velocity, state.acceleration = max_velocity, 0.0
        _append(profile, state, shape.cruise, 0.0)
        _append(profile, state, shape.sink, -jerk)
    else:
        _append(profile, state, shape.rise + shape.sink, -jerk)
    state.acceleration = -shape.sink * jerk
    _append(profile, state, shape.sink_hold, 0.0)
    _append(profile, state, shape.sink, jerk)


cdef inline bint _valid_position(const Problem* problem) noexcept nogil:
    return (
        _valid(problem)
        and isfinite(problem.target_position)
        and isfinite(problem.max_velocity - problem.min_velocity)
        and problem.min_velocity <= problem.target_velocity <= problem.max_velocity
    )


cdef inline bint _close(double is_, double wanted, double scale) noexcept nogil:
    """Whether two values are equal, relative to the sum of all contributions. False for NaN and infinity."""
    return fabs(is_ - wanted) <= END_TOLERANCE * (fabs(is_) + fabs(wanted) + scale) < INFINITY


cdef int otg_velocity(const Problem* problem, Profile* profile) noexcept nogil:
    """Plan the shortest motion from a state to the target's velocity, with zero acceleration at the end. An
    acceleration beyond the limits is first brought to the limit.
    """
    cdef double jerk = problem.max_jerk, high = problem.max_acceleration, low = problem.min_acceleration
    cdef double target = problem.target_velocity, scale = fabs(problem.velocity) + high - low
    cdef Family family
    cdef Shape shape
    cdef State state
    _start(problem, profile, &state)
    if not _valid(problem):
        return OTG_INVALID
    if state.acceleration > high:
        _append(profile, &state, (state.acceleration - high) / jerk, -jerk)
        state.acceleration = high
    elif state.acceleration < low:
        _append(profile, &state, (low - state.acceleration) / jerk, jerk)
        state.acceleration = low
    _begin(
        &family, state.velocity / jerk, state.acceleration / jerk, target / jerk, high / jerk, -low / jerk
    )
    _shortest(&family, &shape)
    _move(profile, &state, jerk, 0.0, &shape)
    profile.end_position, profile.end_velocity = state.position, target
    if _close(state.velocity, target, scale) and isfinite(state.position):
        return OTG_OK
    return OTG_NO_SOLUTION


cdef inline bint _plan(
    const State* state, const Problem* problem, const Limits* limits, Shape* shape, double* jerk
) noexcept nogil:
    """Plan the motion from a state within the limits to the target, and determine its first jerk. Returns
    whether there is one.
    """
    cdef double unit = problem.max_jerk
    cdef double displacement = (problem.target_position - state.position) / unit
    cdef double tolerance, v = state.velocity / unit, a = state.acceleration / unit
    cdef double target = problem.target_velocity / unit, way
    cdef Family family
    jerk[0] = unit
    _begin(&family, v, a, target, limits.max_acceleration, -limits.min_acceleration)
    _shortest(&family, shape)
    tolerance = shape.rise_hold + shape.sink_hold + fabs(shape.rise) + shape.sink
    tolerance *= fabs(state.velocity) + fabs(problem.target_velocity)
    tolerance = ROUNDING * (1.0 + fabs(state.position) + fabs(problem.target_position) + tolerance) / unit
    way = displacement - _displacement(&family, shape)
    if way > 0.0:
        return _find(&family, displacement, tolerance, limits.max_velocity, shape)
    if way < 0.0:
        jerk[0] = -unit
        _begin(&family, -v, -a, -target, -limits.min_acceleration, limits.max_acceleration)
        _shortest(&family, shape)
        return _find(&family, -displacement, tolerance, -limits.min_velocity, shape)
    return True


cdef inline void _enter(
    const Problem* problem, const Limits* limits, Profile* profile, State* state
) noexcept nogil:
    """Bring the state within the limits."""
    cdef double unit = problem.max_jerk, fall = 0.0, hold = 0.0
    cdef int side = _brake(state.velocity / unit, state.acceleration / unit, limits, &fall, &hold)
    if side:
        _append(profile, state, fall, -side * unit)
        state.acceleration = fmax(state.acceleration, problem.min_acceleration)
        state.acceleration = fmin(state.acceleration, problem.max_acceleration)
        _append(profile, state, hold, 0.0)


cdef inline int _finish(const Problem* problem, Profile* profile, const State* state) noexcept nogil:
    """Return the result code, which states whether the last phase has reached the target."""
    cdef double scale = fabs(problem.velocity) + problem.max_velocity - problem.min_velocity
    profile.end_position, profile.end_velocity = problem.target_position, problem.target_velocity
    if _close(state.velocity, problem.target_velocity, scale) and _close(
        state.position, problem.target_position, fabs(problem.position) + profile.duration * scale
    ):
        return OTG_OK
    return OTG_NO_SOLUTION


cdef int otg_position(const Problem* problem, Profile* profile) noexcept nogil:
    """Plan the shortest motion from a state to the target's position and velocity, with zero acceleration at
    the end. A state beyond the limits is first brought within them, as fast as possible.
    """
    cdef double jerk = 0.0
    cdef Limits limits
    cdef Shape shape
    cdef State state
    _start(problem, profile, &state)
    if not _valid_position(problem):
        return OTG_INVALID
    limits = _limits(problem)
    _enter(problem, &limits, profile, &state)
    if not _plan(&state, problem, &limits, &shape, &jerk):
        return OTG_NO_SOLUTION
    _move(profile, &state, jerk, problem.max_velocity if jerk > 0.0 else problem.min_velocity, &shape)
    return _finish(problem, profile, &state)


# --- A given duration ---


cdef struct Ramp:  # The fastest change of velocity to or from a cruise.
    double side  # 1 for one up, −1 for one down.
    double peak, hold


cdef struct Cruise:  # A motion of two ramps with a cruise in between.
    Ramp first, last
    double velocity, duration
    # `slope`: derivative of the displacement by the velocity, at a constant total duration.
    double displacement, slope


cdef inline Ramp _ramp_to(double change, const Limits* limits) noexcept nogil:
    cdef Ramp ramp
    ramp.side = 1.0 if change >= 0.0 else -1.0
    _ramp(
        fabs(change),
        limits.max_acceleration if change >= 0.0 else -limits.min_acceleration,
        &ramp.peak,
        &ramp.hold,
    )
    return ramp


cdef inline void _cruise_at(
    const State* state, double target, const Limits* limits, double duration_s, Cruise* out
) noexcept nogil:
    """Calculate the motion of this duration with the velocity in `out`. If its cruise has a negative
    duration, there is no such motion. The state is in units of the jerk limit.
    """
    cdef double v = state.velocity, a = state.acceleration, cruise = out.velocity
    cdef double side = 1.0 if cruise >= v + 0.5 * a * fabs(a) else -1.0
    cdef double lead = side * a  # Duration of the part of the first ramp that lies before the start.
    cdef double change = cruise - (v - side * 0.5 * a * a), first, last
    out.first = _ramp_to(side * fmax(side * change, 0.0), limits)
    out.first.side = side
    out.last = _ramp_to(target - cruise, limits)
    first, last = 2.0 * out.first.peak + out.first.hold, 2.0 * out.last.peak + out.last.hold
    out.duration = duration_s - first + lead - last
    # The displacement of a cruise for the whole time, minus the missing parts of the ramps. On average, a
    # ramp lacks half of its change of velocity.
    out.displacement = (
        cruise * duration_s - 0.5 * change * first + change * lead - a * a * a / 6.0
        + 0.5 * (target - cruise) * last
    )
    out.slope = duration_s + lead - 1.5 * (out.first.peak + out.last.peak) - out.first.hold - out.last.hold


cdef bint _cruise(
    const State* state, double target, double displacement, const Limits* limits, double duration_s,
    Cruise* out,
) noexcept nogil:
    """Find the velocity of the cruise with which a motion of this duration has this displacement.

    The displacement grows with the velocity of the cruise. The further this velocity is outside the range
    between the velocity to which the start leads on its own and the target's velocity, the shorter the
    cruise. A negative duration means that it is too far outside.
    """
    cdef double itself = state.velocity + 0.5 * state.acceleration * fabs(state.acceleration)
    cdef double low = fmin(itself, target), high = fmax(itself, target), following
    cdef double outside = 0.0
    cdef int _i
    out.velocity = low
    _cruise_at(state, target, limits, duration_s, out)
    if out.duration >= 0.0 and out.displacement >= displacement:
        outside, high, low = -1.0, low, fmin(low, limits.min_velocity)
    else:
        out.velocity = high
        _cruise_at(state, target, limits, duration_s, out)
        if out.duration >= 0.0 and out.displacement <= displacement:
            outside, low, high = 1.0, high, fmax(high, limits.max_velocity)
    for _i in range(MAX_ITERATIONS):
        following = out.velocity - (out.displacement - displacement) / out.slope
        if out.duration < 0.0 and outside != 0.0:
            if outside > 0.0:
                high = out.velocity
            else:
                low = out.velocity
            following = 0.5 * (low + high)
        elif out.displacement > displacement:
            high = out.velocity
        else:
            low = out.velocity
        if not low <= following <= high:
            following = 0.5 * (low + high)
        if fabs(following - out.velocity) <= 4e-16 * fabs(out.velocity):
            break
        out.velocity = following
        _cruise_at(state, target, limits, duration_s, out)
    return out.duration >= -1e-15 * duration_s


cdef inline void _append_ramp(Profile* profile, State* state, double jerk, const Ramp* ramp) noexcept nogil:
    """Append the ramp to zero acceleration."""
    jerk *= ramp.side
    _append(profile, state, ramp.peak - state.acceleration / jerk, jerk)
    state.acceleration = ramp.peak * jerk
    _append(profile, state, ramp.hold, 0.0)
    _append(profile, state, ramp.peak, -jerk)
    state.acceleration = 0.0


cdef int otg_position_in(const Problem* problem, double duration_s, Profile* profile) noexcept nogil:
    """Like `otg_position`, but with a longer, given duration: the cruise has a lower velocity. Ruckig
    synchronises axes in time in the same way, if such a cruise exists.
    """
    cdef double unit = problem.max_jerk, target = problem.target_velocity / unit
    cdef Limits limits
    cdef State state, scaled
    cdef Cruise cruise
    _start(problem, profile, &state)
    if not _valid_position(problem) or not isfinite(duration_s):
        return OTG_INVALID
    limits = _limits(problem)
    _enter(problem, &limits, profile, &state)
    scaled.velocity, scaled.acceleration = state.velocity / unit, state.acceleration / unit
    if not _cruise(
        &scaled, target, (problem.target_position - state.position) / unit, &limits,
        duration_s - profile.duration, &cruise,
    ):
        return OTG_NO_SOLUTION
    _append_ramp(profile, &state, unit, &cruise.first)
    _append(profile, &state, cruise.duration, 0.0)
    _append_ramp(profile, &state, unit, &cruise.last)
    profile.duration = duration_s
    return _finish(problem, profile, &state)


cdef int otg_step(const Problem* problem, double period_s, double* out) noexcept nogil:
    """Calculate the state one period later on a plan to the target's position: position, velocity,
    acceleration.
    """
    cdef Profile profile
    cdef int result = otg_position(problem, &profile)
    if result == OTG_OK:
        profile_at(&profile, period_s, out)
    return result


# --- Axes together ---


cdef enum:
    OFFSET, VELOCITY, ACCELERATION, TARGET_VELOCITY, QUANTITIES  # The vectors of a problem of several axes.


cdef inline double _quantity(const Problem* problem, int quantity) noexcept nogil:
    if quantity == OFFSET:
        return problem.target_position - problem.position
    if quantity == VELOCITY:
        return problem.velocity
    if quantity == ACCELERATION:
        return problem.acceleration
    return problem.target_velocity


cdef inline double _rounding(const Problem* problem, int quantity) noexcept nogil:
    """Return the deviation of a quantity from the line that may be rounding. Rates that are differences of
    positions, divided by the period once or twice, have such deviations.
    """
    if quantity == OFFSET:
        return COLLINEAR * (1e-3 + fabs(problem.target_position - problem.position))
    if quantity == ACCELERATION:
        return COLLINEAR * (problem.max_acceleration - problem.min_acceleration)
    return COLLINEAR * (problem.max_velocity - problem.min_velocity)


cdef inline bint _line(const Problem* problems, int n, int* quantity, int* axis) noexcept nogil:
    """Whether all vectors of a problem lie on one line. Also determines the largest vector, relative to the
    rounding, and the axis of its largest coordinate. False if nothing has to move.
    """
    cdef double share, greatest = 1.0, ratio
    cdef int i, k
    for k in range(QUANTITIES):
        for i in range(n):
            share = fabs(_quantity(&problems[i], k)) / _rounding(&problems[i], k)
            if share > greatest:
                greatest, quantity[0], axis[0] = share, k, i
    if not 1.0 < greatest < INFINITY:
        return False
    for i in range(n):
        ratio = _quantity(&problems[i], quantity[0]) / _quantity(&problems[axis[0]], quantity[0])
        for k in range(QUANTITIES):
            share = _quantity(&problems[i], k) - ratio * _quantity(&problems[axis[0]], k)
            if not fabs(share) <= _rounding(&problems[i], k) + fabs(ratio) * _rounding(&problems[axis[0]], k):
                return False
    return True


cdef inline void _tighten(Problem* line, const Problem* axis, double ratio) noexcept nogil:
    """Tighten the line's limits by those of an axis that moves `ratio` times as far."""
    if ratio > 0.0:
        line.max_velocity = fmin(line.max_velocity, axis.max_velocity / ratio)
        line.min_velocity = fmax(line.min_velocity, axis.min_velocity / ratio)
        line.max_acceleration = fmin(line.max_acceleration, axis.max_acceleration / ratio)
        line.min_acceleration = fmax(line.min_acceleration, axis.min_acceleration / ratio)
    elif ratio < 0.0:
        line.max_velocity = fmin(line.max_velocity, axis.min_velocity / ratio)
        line.min_velocity = fmax(line.min_velocity, axis.max_velocity / ratio)
        line.max_acceleration = fmin(line.max_acceleration, axis.min_acceleration / ratio)
        line.min_acceleration = fmax(line.min_acceleration, axis.max_acceleration / ratio)
    if ratio != 0.0:
        line.max_jerk = fmin(line.max_jerk, axis.max_jerk / fabs(ratio))


cdef inline void _scale(
    const Profile* line, const Problem* axis, double ratio, Profile* profile
) noexcept nogil:
    """Calculate the motion of an axis that moves in proportion to another one."""
    cdef double start = line.position[0]
    cdef int i
    profile.count, profile.duration = line.count, line.duration
    for i in range(line.count):
        profile.duration_s[i] = line.duration_s[i]
        profile.jerk[i] = ratio * line.jerk[i]
        profile.position[i] = axis.position + ratio * (line.position[i] - start)
        profile.velocity[i] = ratio * line.velocity[i]
        profile.acceleration[i] = ratio * line.acceleration[i]
    profile.end_position, profile.end_velocity = axis.target_position, axis.target_velocity


cdef inline bint _beyond_limits(const Problem* problem) noexcept nogil:
    """Whether a motion must first bring the state within the limits."""
    cdef Limits limits = _limits(problem)
    cdef double fall, hold, v = problem.velocity / problem.max_jerk
    return _brake(v, problem.acceleration / problem.max_jerk, &limits, &fall, &hold) != 0


cdef inline bint _fits(const Problem* line, const Problem* problems, int n) noexcept nogil:
    """Whether a state within the limits of each axis is also within the limits of the line."""
    cdef int i
    if not _beyond_limits(line):
        return True
    for i in range(n):
        if _beyond_limits(&problems[i]):
            return True
    return False


cdef int otg_synchronise(const Problem* problems, int n, Profile* profiles) noexcept nogil:
    """Make all axes arrive together with the slowest one, each with a cruise at a lower velocity. An axis
    without such a cruise arrives earlier. If an axis has no motion, return its result; otherwise OTG_OK.
    """
    cdef Profile slower
    cdef double duration_s = 0.0
    cdef int i, result
    for i in range(n):
        result = otg_position(&problems[i], &profiles[i])
        if result != OTG_OK:
            return result
        duration_s = fmax(duration_s, profiles[i].duration)
    for i in range(n):
        if profiles[i].duration < duration_s:
            if otg_position_in(&problems[i], duration_s, &slower) == OTG_OK:
                profiles[i] = slower
    return OTG_OK


cdef int otg_vector(const Problem* problems, int n, Profile* profiles) noexcept nogil:
    """Plan a motion of all axes. If offset, velocities and acceleration lie on one line, the motion is
    straight and as fast as the limits of all axes permit. Otherwise the axes arrive together, see
    `otg_synchronise`.
    """
    cdef Problem line
    cdef Profile motion
    cdef double ratio
    cdef int i, quantity = 0, axis = 0
    for i in range(n):
        if not _valid_position(&problems[i]):
            return OTG_INVALID
    if _line(problems, n, &quantity, &axis):
        line = problems[axis]
        for i in range(n):
            ratio = _quantity(&problems[i], quantity) / _quantity(&line, quantity)
            _tighten(&line, &problems[i], ratio)
        if _fits(&line, problems, n) and otg_position(&line, &motion) == OTG_OK:
            for i in range(n):
                ratio = _quantity(&problems[i], quantity) / _quantity(&line, quantity)
                _scale(&motion, &problems[i], ratio, &profiles[i])
            return OTG_OK
    return otg_synchronise(problems, n, profiles)


# --- Python, for the tests ---


cdef class AxisProfile:
    """A planned motion of one axis: m or rad, and s."""

    cdef Profile profile

    @property
    def duration(self):
        return self.profile.duration

    @property
    def phases(self):
        """Return a row for each phase: duration, jerk, and position, velocity and acceleration at its
        start.
        """
        cdef const Profile* p = &self.profile
        return [
            (p.duration_s[i], p.jerk[i], p.position[i], p.velocity[i], p.acceleration[i])
            for i in range(p.count)
        ]

    @property
    def extrema(self):
        """Return the minimum and maximum position."""
        cdef double[2] out
        profile_extrema(&self.profile, out)
        return out[0], out[1]

    def at(self, double time_s):
        """Return position, velocity and acceleration at a time."""
        cdef double[3] out
        profile_at(&self.profile, time_s, out)
        return out[0], out[1], out[2]


cdef Problem _problem(row) except *:
    cdef Problem p
    (
        p.position, p.velocity, p.acceleration, p.target_position, p.target_velocity,
        p.min_velocity, p.max_velocity, p.min_acceleration, p.max_acceleration, p.max_jerk,
    ) = row
    return p


def position(row):
    """Return the result code and the motion to a target position, for a row in the order of `Problem`."""
    cdef Problem problem = _problem(row)
    cdef AxisProfile motion = AxisProfile()
    return otg_position(&problem, &motion.profile), motion


def velocity(row):
    """Return the result code and the motion to a target velocity, for a row in the order of `Problem`."""
    cdef Problem problem = _problem(row)
    cdef AxisProfile motion = AxisProfile()
    return otg_velocity(&problem, &motion.profile), motion


def step(row, double period_s):
    """Return the result code and the state one period later."""
    cdef Problem problem = _problem(row)
    cdef double[3] out
    out[0] = out[1] = out[2] = 0.0
    result = otg_step(&problem, period_s, out)
    return result, (out[0], out[1], out[2])


def vector(rows, in_phase=True):
    """Return the result code and the motions of at most 16 axes, for rows in the order of `Problem`. If
    `in_phase` is false, they are only synchronised in time.
    """
    cdef Problem[16] problems
    cdef Profile[16] profiles
    cdef AxisProfile motion
    cdef int i, n = len(rows)
    if not 0 < n <= 16:
        raise ValueError(f"{n} axes; allowed: 1 to 16")
    for i in range(n):
        problems[i] = _problem(rows[i])
    if in_phase:
        result = otg_vector(problems, n, profiles)
    else:
        result = otg_synchronise(problems, n, profiles)
    motions = []
    for i in range(n):
        motion = AxisProfile()
        motion.profile = profiles[i]
        motions.append(motion)
    return result, motions
