"""Path time: the progress of the arm along its motion, and its rate.

The joints are at q = P(s) for the path time s, and s advances at a rate r = ds/dt in [0, 1]. Stop, pause,
resume and speed override change only r, so the arm stays on the path. With derivatives of P by s,

    dq/dt = P' r      d²q/dt² = P'' r² + P' r'      d³q/dt³ = P''' r³ + 3 P'' r r' + P' r''

so a change of the rate must itself be smooth, and slow enough for the motion along the path.
"""

from libc.math cimport fabs, fmax, fmin, sqrt

from cobot.arrays cimport MAX_DOF
from rtloop.generators.otg cimport MAX_PHASES, OTG_OK, Problem, otg_velocity, profile_at
from rtloop.generators.rates cimport take_rates
from rtloop.planned.path cimport MAX_BREAKPOINTS, Path

cdef enum:
    RUNGS = 10
    CRESTS = 3
    ENDS = 2
    # Number of places in each phase of a profile at which acceleration and jerk of the joints are
    # checked.
    SAMPLES = 11

# The order of the checks: first the ends of the phase, then places between them.
cdef int[SAMPLES] ORDER = [0, 10, 5, 2, 8, 1, 9, 3, 7, 4, 6]

# Shares of the steepest profile, one of which is tried per cycle.
cdef double[RUNGS] LADDER = [1.0, 0.7, 0.5, 0.35, 0.25, 0.17, 0.12, 0.08, 0.05, 0.03]
cdef double SIDE_S = 1e-9
# A profile may use this share of the limits. The rest is a margin for values between two samples.
cdef double SHARE = 0.99
cdef double URGENT_SHARE = 0.998
# A new profile replaces the current one if it needs at most this share of the remaining time.
cdef double SOONER = 0.8
# At a rate below zero the arm would move backwards.
cdef double MIN_RATE = -1e-9
# Limits of the rate itself, 1/s and 1/s². Without them, any change would be possible where the arm hardly
# moves.
cdef double MAX_ACCELERATION = 50.0
cdef double MAX_JERK = 2000.0
# The limits at contact, where each millimetre counts. The joint limits always apply.
cdef double URGENT_ACCELERATION = 1000.0
cdef double URGENT_JERK = 500_000.0
# At contact, the first cycle finds the steepest profile. Each attempt is gentler than the previous one, until
# one stays within the limits. Then the interval between it and the last failed one is halved several times.
cdef int URGENT_TRIES = 8
cdef double GENTLER = 0.8
cdef int HALVINGS = 6
cdef int SHORTER_TRIES = 24
cdef double[CRESTS] CREST = [1.0, 0.85, 0.7]
# For the next cycles: the step between the shares that are tried, and how much shorter another stop must be
# in path time.
cdef double FINER = 0.003
cdef double SHORTER_S = 1e-5
# Maximum duration of a profile. A longer one is not used, because an operator is waiting for the stop.
cdef double MAX_PROFILE_S = 2.0
# If no profile leads from rest to the target rate, this share of it is tried, then this share of the result,
# and so on.
cdef double GENTLER_AIM = 0.5
cdef double MIN_AIM = 0.02


cdef class PathClock:
    def __cinit__(self, limits, double period_s):
        cdef int joint
        cdef double braking_s
        self.dof = take_rates(limits, &self.rates)
        self.period_s = period_s
        for joint in range(self.dof):
            braking_s = self.rates.velocity[joint] / self.rates.acceleration[joint]
            braking_s += self.rates.acceleration[joint] / self.rates.jerk[joint]
            self.patience_s = fmax(self.patience_s, braking_s)
        self.share = 1.0
        self.c_reset()

    def reset(self):
        self.c_reset()

    def request(self, double rate):
        self.c_request(rate)

    def scale(self, double share):
        self.c_scale(share)

    def advance(self, Path path not None):
        if path.dof != self.dof:
            raise ValueError(f"a path of {path.dof} joints for an arm of {self.dof}")
        self.c_advance(path)

    def shift(self, double offset_s):
        self.c_shift(offset_s)

    def hold(self, bint held):
        self.c_hold(held)

    @property
    def committed_s(self):
        return self.c_committed_s()

    @property
    def at_rest(self):
        return self.c_at_rest()

    @property
    def slowing(self):
        return self.c_slowing()

    @property
    def stuck(self):
        return self.c_stuck()

    cdef void c_reset(self) noexcept nogil:
        """Return to the beginning of a path, at the highest rate that the device permits."""
        self.asked_rate = 1.0
        self.held = self.urgent = False
        self.path_time_s, self.rate, self.rate_slope = 0.0, self.share, 0.0
        self.target_rate = self.aim = self.share
        self.profile_s = -1.0
        self.pending = False
        self.rung = self.failed_at_rest = 0
        self.waited_s = 0.0

    cdef bint c_at_rest(self) noexcept nogil:
        """Whether path time is standing still and no change of the rate is pending."""
        return self.rate == 0.0 and self.profile_s < 0.0 and not self.pending

    cdef bint c_slowing(self) noexcept nogil:
        """Whether a profile towards the target rate is active."""
        return self.profile_s >= 0.0

    cdef bint c_stuck(self) noexcept nogil:
        """Whether the path has left no room to change the rate, for as long as a joint at its limits would
        need to stop. This should occur only on a path that exceeds the limits.
        """
        return self.pending and self.waited_s > self.patience_s

    cdef double c_committed_s(self) noexcept nogil:
        """Return the path time up to which the active profile relies on the path; without a profile, the
        current path time.
        """
        if self.profile_s < 0.0:
            return self.path_time_s
        return fmax(self.path_time_s, self.profile.end_position)

    cdef void c_shift(self, double offset_s) noexcept nogil:
        """Move to the same place on a path that begins later by the offset."""
        cdef int phase
        self.path_time_s -= offset_s
        for phase in range(self.profile.count):
            self.profile.position[phase] -= offset_s
        self.profile.end_position -= offset_s

    cdef void c_request(self, double rate) noexcept nogil:
        """Change to another rate, as soon as possible and as fast as the joints permit."""
        self.asked_rate = rate
        rate *= 0.0 if self.held else self.share
        if rate != self.target_rate:
            self.target_rate = self.aim = rate
            self.pending = True
            self.rung = self.failed_at_rest = 0
            self.waited_s = 0.0

    cdef void c_scale(self, double share) noexcept nogil:
        """Scale all requested rates by this share."""
        self.share = share
        self.c_request(self.asked_rate)

    cdef void c_hold(self, bint held) noexcept nogil:
        """Stop on the path, whatever rate is requested, or continue at the requested rate."""
        self.held = held
        self.c_request(self.asked_rate)

    cdef void c_end_urgently(self) noexcept nogil:
        """Stop on the path as fast as the joints permit, even if they move slowly."""
        self.urgent = True
        self._begin_search()
        self.c_request(0.0)

    cdef void c_begin(self) noexcept nogil:
        """Set the requested rate at once. This is possible at the beginning of a path, where the arm is at
        rest.
        """
        self.rate = self.target_rate
        self.rate_slope, self.profile_s = 0.0, -1.0
        self.pending = False

    cdef void c_advance(self, Path path) noexcept nogil:
        """Advance by one period."""
        cdef double there[3]
        if self.pending:
            self._try_rung(path)
        elif self.profile_s >= 0.0:
            self._try_sooner(path)
        if self.profile_s < 0.0:
            self.path_time_s += self.rate * self.period_s
        else:
            self.profile_s += self.period_s
            profile_at(&self.profile, self.profile_s, there)
            self.path_time_s, self.rate, self.rate_slope = there[0], there[1], there[2]
            if self.profile_s >= self.profile.duration:
                self.rate, self.rate_slope, self.profile_s = self.profile_target, 0.0, -1.0
        self.path_time_s = fmin(self.path_time_s, path.duration_s)

    cdef void _try_rung(self, Path path) noexcept nogil:
        """Use this cycle's candidate if it stays within the limits. If not, the next cycle tries a gentler
        one.
        """
        cdef bint found
        self.waited_s += self.period_s
        if self.urgent and self.rung == 0:
            found = self._find_steepest(path)
        else:
            found = self._try(path, LADDER[self.rung])
        if found:
            self._take_candidate()
            if self.urgent:
                self._try_shorter(path)
            return
        self.rung = (self.rung + 1) % RUNGS
        self.failed_at_rest = self.failed_at_rest + 1 if self.rate == 0.0 and self.profile_s < 0.0 else 0
        if self.failed_at_rest == RUNGS:
            self._lower_aim()

    cdef bint _find_steepest(self, Path path) noexcept nogil:
        """Find the steepest profile that stays within the limits, as the candidate. Returns whether there is
        one.

        Each percent below the steepest takes the arm half a percent further into the contact.
        """
        cdef double share = 1.0, too_steep = 1.0, middle
        cdef int _attempt
        for _attempt in range(URGENT_TRIES):
            if self._try(path, share):
                break
            too_steep, share = share, share * GENTLER
        else:
            return False
        if share == too_steep:
            return True
        for _attempt in range(HALVINGS):
            middle = 0.5 * (share + too_steep)
            if self._try(path, middle):
                share = middle
            else:
                too_steep = middle
        return self._plan(path, share)

    cdef bint _try(self, Path path, double share) noexcept nogil:
        """Whether there is a candidate with this share of the steepest profile that stays within the limits.
        """
        return self._plan(path, share) and self._admissible(path)

    cdef void _lower_aim(self) noexcept nogil:
        """Temporarily aim at a lower rate, if all candidates have failed at rest.

        Where the path itself needs the full acceleration of a joint, no profile leads to full rate, and the
        arm would stay there for ever. A low rate leaves some room, and moves the arm to a place with more
        room.
        """
        cdef double lower = GENTLER_AIM * self.aim
        self.aim, self.failed_at_rest = lower if lower > MIN_AIM else self.target_rate, 0

    cdef void _take_candidate(self) noexcept nogil:
        self.profile = self.candidate
        self.profile_target, self.profile_s = self.aim, 0.0
        self.pending, self.aim, self.failed_at_rest = self.aim != self.target_rate, self.target_rate, 0

    cdef void _try_sooner(self, Path path) noexcept nogil:
        """Replace a gentle profile with one that arrives sooner, as soon as the path leaves room for it."""
        cdef double sooner_s = SOONER * (self.profile.duration - self.profile_s)
        if self.urgent:
            self._try_shorter(path)
            return
        self.rung = (self.rung + 1) % RUNGS
        if not self._plan(path, LADDER[self.rung]):
            return
        if self.candidate.duration < sooner_s and self._admissible(path):
            self.profile, self.profile_s = self.candidate, 0.0

    cdef void _try_shorter(self, Path path) noexcept nogil:
        """Replace a stop at contact with any profile that ends earlier.

        The shares of the steepest profile that stay within the limits form several intervals, of which the
        first cycle has found one. So all shares are tried, some in each cycle, and then again with flatter
        crests, which take longer but stay within the limits more often. The order matters: a share that is
        tried late gains less, because the arm has already slowed down with a gentler one.
        """
        cdef int _attempt
        for _attempt in range(SHORTER_TRIES):
            self.tried -= FINER
            if self.tried > 0.0 and not self._plan(path, self.tried, CREST[self.crest]):
                continue
            if self.tried <= 0.0 or self.candidate.end_position > self.profile.end_position - SHORTER_S:
                # Gentler profiles are even longer.
                self.tried, self.crest = 1.0 + FINER, (self.crest + 1) % CRESTS
            elif self._admissible(path):
                self.profile, self.profile_s = self.candidate, 0.0
                self._begin_search()
                return

    cdef void _begin_search(self) noexcept nogil:
        self.tried, self.crest = 1.0 + FINER, 0

    cdef bint _plan(self, Path path, double share, double crest=1.0) noexcept nogil:
        """Whether there is a candidate with this share of the steepest profile, and at most this share of the
        slope that it would reach.
        """
        cdef int joint
        cdef double steepest = URGENT_ACCELERATION if self.urgent else MAX_ACCELERATION
        cdef double jerk = URGENT_JERK if self.urgent else MAX_JERK, speed
        cdef double derivatives[3 * MAX_DOF]
        cdef Problem problem
        path.c_sample(self.path_time_s, derivatives)
        for joint in range(self.dof):
            speed = fabs(derivatives[joint]) + 1e-9
            steepest = fmin(steepest, self.rates.acceleration[joint] / speed)
            jerk = fmin(jerk, self.rates.jerk[joint] / speed)
        problem.position, problem.velocity = self.path_time_s, self.rate
        problem.acceleration = self.rate_slope
        problem.target_position, problem.target_velocity = 0.0, self.aim
        problem.min_velocity, problem.max_velocity = -2.0, 2.0  # Not used by this interface.
        # At least the current slope, because otherwise the profile would first reduce the slope.
        steepest *= share
        if crest < 1.0:
            steepest = fmin(steepest, crest * sqrt(
                jerk * share * fabs(self.rate - self.aim) + 0.5 * self.rate_slope * self.rate_slope
            ))
        problem.max_acceleration = fmax(steepest, fabs(self.rate_slope) * (1.0 + 1e-9))
        problem.min_acceleration = -problem.max_acceleration
        problem.max_jerk = jerk * share
        return otg_velocity(&problem, &self.candidate) == OTG_OK and self.candidate.duration <= MAX_PROFILE_S

    cdef bint _admissible(self, Path path) noexcept nogil:
        """Whether the joints' acceleration and jerk stay within their limits along the whole candidate.

        Most failing candidates fail at the end of a phase or at a breakpoint, so these are checked first.
        """
        cdef Place places[MAX_PHASES * SAMPLES]
        cdef int count = _places(&self.candidate, places)
        return (
            self._hold_samples(path, places, count, 0, ENDS)
            and self._hold_breakpoints(path, places, count)
            and self._hold_samples(path, places, count, ENDS, SAMPLES)
        )

    cdef bint _hold_samples(
        self, Path path, const Place* places, int count, int begin, int end
    ) noexcept nogil:
        """Whether the candidate is within the limits at these samples of each phase, counted in their
        order.
        """
        cdef Place at
        cdef int sample, phase
        for sample in range(begin, end):
            for phase in range(count // SAMPLES):
                at = places[phase * SAMPLES + ORDER[sample]]
                if at.rate < MIN_RATE or not self._holds(path, at.path_time_s, at.rate, at.slope, at.bend):
                    return False
        return True

    cdef bint _hold_breakpoints(self, Path path, const Place* places, int count) noexcept nogil:
        """Whether the candidate is within the limits on both sides of each breakpoint, where the path's jerk
        steps.
        """
        cdef Place at
        cdef double breaks[MAX_BREAKPOINTS]
        cdef int i
        if count == 0:
            return True
        for i in range(path.c_breakpoints(places[0].path_time_s, places[count - 1].path_time_s, breaks)):
            at = _interpolated(places, count, breaks[i])
            if not self._holds(path, breaks[i] - SIDE_S, at.rate, at.slope, at.bend):
                return False
            if not self._holds(path, breaks[i] + SIDE_S, at.rate, at.slope, at.bend):
                return False
        return True

    cdef bint _holds(
        self, Path path, double path_time_s, double rate, double slope, double bend
    ) noexcept nogil:
        """Whether all joints stay within their limits at this place.

        If the path itself exceeds the permitted share at this rate, the candidate may do so too, but not by
        more.
        """
        cdef int joint
        cdef double own_acceleration, own_jerk, acceleration, jerk, first, second
        cdef double permitted = URGENT_SHARE if self.urgent else SHARE
        cdef double derivatives[3 * MAX_DOF]
        path.c_sample(path_time_s, derivatives)
        for joint in range(self.dof):
            first, second = derivatives[joint], derivatives[self.dof + joint]
            own_acceleration = second * (rate * rate)
            own_jerk = derivatives[2 * self.dof + joint] * (rate * rate * rate)
            acceleration = fabs(own_acceleration + first * slope)
            jerk = fabs(own_jerk + 3.0 * second * rate * slope + first * bend)
            if not acceleration <= fmax(permitted * self.rates.acceleration[joint], fabs(own_acceleration)):
                return False
            if not jerk <= fmax(permitted * self.rates.jerk[joint], fabs(own_jerk)):
                return False
        return True


cdef int _places(const Profile* profile, Place* places) noexcept nogil:
    """Collect the places of a candidate that are checked. Returns their number."""
    cdef int phase, sample, count = 0
    cdef double t, velocity, acceleration, jerk
    for phase in range(profile.count):
        if not profile.duration_s[phase] > 0.0:
            continue
        velocity, acceleration = profile.velocity[phase], profile.acceleration[phase]
        jerk = profile.jerk[phase]
        for sample in range(SAMPLES):
            t = profile.duration_s[phase] * sample / (SAMPLES - 1)
            places[count].path_time_s = profile.position[phase] + t * (
                velocity + t * (acceleration / 2.0 + t * jerk / 6.0)
            )
            places[count].rate = velocity + t * (acceleration + t * jerk / 2.0)
            places[count].slope = acceleration + t * jerk
            places[count].bend = jerk
            count += 1
    return count


cdef Place _interpolated(const Place* places, int count, double path_time_s) noexcept nogil:
    """Interpolate linearly between the places before and after a path time."""
    cdef int low = 0, high = count - 1, middle
    cdef double share
    cdef Place at, after
    while high - low > 1:
        middle = (low + high) // 2
        if places[middle].path_time_s <= path_time_s:
            low = middle
        else:
            high = middle
    at, after = places[low], places[high]
    share = path_time_s - at.path_time_s
    if after.path_time_s > at.path_time_s:
        share /= after.path_time_s - at.path_time_s
    at.rate += share * (after.rate - at.rate)
    at.slope += share * (after.slope - at.slope)
    at.bend += share * (after.bend - at.bend)
    return at
