"""What `rtloop.planned.path_clock` does, said with numpy and Ruckig."""

from __future__ import annotations

import numpy as np
import ruckig
from laws.path import Path

from cobot.types import JointLimits

LADDER = (1.0, 0.7, 0.5, 0.35, 0.25, 0.17, 0.12, 0.08, 0.05, 0.03)
"""Fractions of the steepest profile that are tried, one a cycle."""
SAMPLES = np.linspace(0.0, 1.0, 11)
"""Places in each phase of a profile where the joints' acceleration and jerk are looked at."""
SIDE_S = 1e-9
SHARE = 0.99
"""Of the limits; the rest is for what lies between two samples."""
MAX_ACCELERATION = 50.0
MAX_JERK = 2000.0
"""Of the rate, 1/s and 1/s²: where the arm hardly moves, any rate would be admissible."""
SOONER = 0.8
"""A profile under way gives way to one that needs no more than this share of the time that is left."""
MIN_RATE = -1e-9
"""Below zero the arm would go back."""
MAX_PROFILE_S = 2.0
"""Of a profile: a gentler one is not taken, for somebody waits for the stop."""
GENTLER_AIM, MIN_AIM = 0.5, 0.02
"""Where no profile leads from rest to the target rate, one leads to a share of it, down to a least rate."""


class PathClock:
    """Advances the path time of one motion. Real-time safe."""

    def __init__(self, limits: JointLimits, period_s: float) -> None:
        self._max_acceleration = limits.max_acceleration
        self._max_jerk = limits.max_jerk
        braking_s = limits.max_velocity / limits.max_acceleration + limits.max_acceleration / limits.max_jerk
        self._patience_s = float(braking_s.max())
        self._period_s = period_s
        self._generator = ruckig.Ruckig(1)
        self._problem = ruckig.InputParameter(1)
        self._problem.control_interface = ruckig.ControlInterface.Velocity
        self._problem.max_velocity = [2.0]  # not used by this interface
        self._profile = ruckig.Trajectory(1)
        self._candidate = ruckig.Trajectory(1)
        self.reset()

    def reset(self) -> None:
        """Back to the beginning of a path, at full rate."""
        self.path_time_s = 0.0
        self.rate = 1.0
        self.rate_slope = 0.0
        self.target_rate = self._aim = 1.0
        self._profile_s = -1.0  # time into the profile; negative: there is none
        self._pending = False
        self._rung = self._failed_at_rest = 0
        self._waited_s = 0.0

    @property
    def at_rest(self) -> bool:
        """Whether path time stands still, and nothing is about to change that."""
        return self.rate == 0.0 and self._profile_s < 0.0 and not self._pending

    @property
    def slowing(self) -> bool:
        """Whether a profile towards the target rate is under way."""
        return self._profile_s >= 0.0

    @property
    def stuck(self) -> bool:
        """Whether the path has left no room to change the rate for as long as a joint at its limits would
        have taken to come to rest. Only a path beyond the limits should do that.
        """
        return self._pending and self._waited_s > self._patience_s

    def request(self, rate: float) -> None:
        """Go over to another rate, as soon and as fast as the joints permit."""
        if rate != self.target_rate:
            self.target_rate = self._aim = rate
            self._pending = True
            self._rung = self._failed_at_rest = 0
            self._waited_s = 0.0

    def advance(self, path: Path) -> None:
        """One period on."""
        if self._pending:
            self._try_rung(path)
        elif self._profile_s >= 0.0:
            self._try_sooner(path)
        if self._profile_s < 0.0:
            self.path_time_s += self.rate * self._period_s
        else:
            self._profile_s += self._period_s
            position, velocity, acceleration = self._profile.at_time(self._profile_s)
            self.path_time_s, self.rate, self.rate_slope = position[0], velocity[0], acceleration[0]
            if self._profile_s >= self._profile.duration:
                self.rate, self.rate_slope, self._profile_s = self._profile_target, 0.0, -1.0
        self.path_time_s = min(self.path_time_s, path.duration_s)

    def _try_rung(self, path: Path) -> None:
        """Take this cycle's candidate if it holds; if not, the next cycle tries a gentler one."""
        self._waited_s += self._period_s
        if self._planned(path) and self._admissible(path):
            self._profile, self._candidate = self._candidate, self._profile
            self._profile_target, self._profile_s = self._aim, 0.0
            self._pending, self._aim = self._aim != self.target_rate, self.target_rate
            self._failed_at_rest = 0
            return
        self._rung = (self._rung + 1) % len(LADDER)
        self._failed_at_rest += 1
        if self.rate != 0.0 or self._profile_s >= 0.0:
            self._failed_at_rest = 0
        if self._failed_at_rest == len(LADDER):
            lower = GENTLER_AIM * self._aim
            self._aim, self._failed_at_rest = lower if lower > MIN_AIM else self.target_rate, 0

    def _try_sooner(self, path: Path) -> None:
        """A gentle profile gives way to one that arrives sooner, as soon as the path leaves room for it."""
        sooner_s = SOONER * (self._profile.duration - self._profile_s)
        self._rung = (self._rung + 1) % len(LADDER)
        if self._planned(path) and self._candidate.duration < sooner_s and self._admissible(path):
            self._profile, self._candidate = self._candidate, self._profile
            self._profile_s = 0.0

    def _planned(self, path: Path) -> bool:
        """Whether there is a candidate on this rung."""
        speed = np.abs(path.sample(np.array([self.path_time_s]))[0, 0]) + 1e-9
        fraction = LADDER[self._rung]
        steepest = min(float((self._max_acceleration / speed).min()), MAX_ACCELERATION)
        jerk = min(float((self._max_jerk / speed).min()), MAX_JERK)
        problem = self._problem
        problem.current_position = [self.path_time_s]
        problem.current_velocity = [self.rate]
        problem.current_acceleration = [self.rate_slope]
        problem.target_velocity = [self._aim]
        # never below the current slope: Ruckig would put a brake phase in front
        problem.max_acceleration = [max(steepest * fraction, abs(self.rate_slope) * (1.0 + 1e-9))]
        problem.max_jerk = [jerk * fraction]
        return self._calculated()

    def _calculated(self) -> bool:
        """Whether there is a candidate. Of numbers that are all but zero Ruckig makes none."""
        try:
            result = self._generator.calculate(self._problem, self._candidate)
        except (ruckig.RuckigError, ValueError):  # ValueError: a result that its binding does not know
            return False
        return result is ruckig.Result.Working and self._candidate.duration <= MAX_PROFILE_S

    def _admissible(self, path: Path) -> bool:
        """Whether the joints' acceleration and jerk hold all along the candidate.

        Where the path by itself exceeds the share at this rate, it may, but not by more.
        """
        profile = self._candidate.profiles[0][0]
        lengths = np.array(profile.t)
        phases = np.flatnonzero(lengths > 0.0)
        if not phases.size:  # the rate is there already
            return True
        t = lengths[phases, None] * SAMPLES
        s, r, a, j = (
            np.array(values)[phases, None] for values in (profile.p, profile.v, profile.a, profile.j)
        )
        grid = (s + t * (r + t * (a / 2 + t * j / 6))).ravel()
        rates = np.array([r + t * (a + t * j / 2), a + t * j, np.broadcast_to(j, t.shape)]).reshape(3, -1)
        if rates[0].min() < MIN_RATE:
            return False
        # The path's jerk steps at its breakpoints: both sides of each are looked at too.
        breaks = path.breakpoints(grid[0], grid[-1])
        times = np.concatenate([grid, breaks - SIDE_S, breaks + SIDE_S])
        rate, slope, bend = (
            np.concatenate([row, np.tile(np.interp(breaks, grid, row), 2)])[:, None] for row in rates
        )
        first, second, third = path.sample(times)
        own_acceleration = second * rate**2
        own_jerk = third * rate**3
        acceleration = np.abs(own_acceleration + first * slope)
        jerk = np.abs(own_jerk + 3.0 * second * rate * slope + first * bend)
        most = np.maximum(SHARE * self._max_acceleration, np.abs(own_acceleration))
        most_jerk = np.maximum(SHARE * self._max_jerk, np.abs(own_jerk))
        return bool((acceleration <= most).all() and (jerk <= most_jerk).all())
