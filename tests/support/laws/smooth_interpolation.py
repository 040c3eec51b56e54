"""What `rtloop.generators.brake`, `.online_trajectory` and `.quintic` compute, in numpy and with Ruckig."""

from __future__ import annotations

import numpy as np
import ruckig
from laws.target_estimate import Estimate

from cobot.types import Array

EARLY = 1e-6
"""Of a cycle: what ends this little after a cycle ends in it."""
WINDOW_S = 0.1
"""Of targets, from which `OnlineTrajectory` estimates. Measured at 100 Hz with 0.3 mrad of noise: with three
targets the reference strays by 0.1 rad, with these by 5 mrad. `Quintic` passes the noise anyway: three do."""
EXPONENTS = np.array([[0, 1, 2, 3, 4, 5], [0, 0, 1, 2, 3, 4], [0, 0, 0, 1, 2, 3]], float)
FACTORS = np.array([[1, 1, 1, 1, 1, 1], [0, 1, 2, 3, 4, 5], [0, 0, 2, 6, 12, 20]], float)
"""Of the powers of s in a polynomial and in its first and second derivative."""
HERMITE = np.array(
    [
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.5, 0.0, 0.0, 0.0],
        [-10.0, -6.0, -1.5, 10.0, -4.0, 0.5],
        [15.0, 8.0, 1.5, -15.0, 7.0, -1.0],
        [-6.0, -3.0, -0.5, 6.0, -3.0, 0.5],
    ]
)
"""Coefficients of the quintic on s in [0, 1] from its value and two derivatives at 0, then at 1."""
HORIZON_S = 0.2
"""So far ahead a quintic meets the stream, if that goes on as it does: the longer, the less jerk it takes to
put right what a sender's noise has put wrong."""
JERKS = (0.03, 0.1, 0.3, 1.0)
PATIENCE_S = 0.25
"""Shares of the jerk limit that a correction may take: the first that is done in this time."""
GRACE_SHARE = 0.25
GRACE_S = 0.002
"""Of a period, and on top: so late a command may come without a trace in the motion."""
ROUNDING = 1e-9
"""Of velocity and acceleration at the end of a brake profile: this is rest."""


def grace_s(duration_s: float) -> float:
    """How long a stream with this period is taken to go on without a command."""
    return GRACE_SHARE * duration_s + GRACE_S


class Quintics:
    """Evaluates quintic polynomials on s in [0, 1] and their derivatives by time. Real-time safe."""

    def __init__(self) -> None:
        self._basis = np.zeros((3, 6))

    def evaluate(self, coefficients: Array, time_s: float, duration_s: float, out: Array) -> None:
        """Position, velocity and acceleration, shape (3, n), of coefficients (6, n)."""
        np.power(time_s / duration_s, EXPONENTS, out=self._basis)
        np.multiply(self._basis, FACTORS, out=self._basis)
        self._basis[1] /= duration_s
        self._basis[2] /= duration_s * duration_s
        np.dot(self._basis, coefficients, out=out)


class Brake:
    """Brings a reference to rest, each coordinate for itself, as fast as the limits permit, and without
    turning back. Real-time safe."""

    def __init__(self, period_s: float, max_acceleration: Array, max_jerk: Array) -> None:
        n = len(max_jerk)
        self._max_acceleration = max_acceleration
        self._generator = ruckig.Ruckig(n, period_s)
        self._output = ruckig.OutputParameter(n)
        self._problem = ruckig.InputParameter(n)
        self._problem.control_interface = ruckig.ControlInterface.Velocity
        self._problem.synchronization = ruckig.Synchronization.No
        self._problem.max_velocity = [1.0] * n  # not used by this interface
        self._problem.max_acceleration = max_acceleration.tolist()
        self._problem.max_jerk = max_jerk.tolist()
        self._problem.target_velocity = [0.0] * n

    def begin(self, reference: Array) -> None:
        """Brake from this state, shape (3, n).

        Of an acceleration beyond the limit only the limit is taken over: to take it back by the greatest
        jerk would take so long that the velocity ran away.
        """
        problem = self._problem
        problem.current_position, problem.current_velocity = reference[:2].tolist()
        problem.current_acceleration = (
            reference[2].clip(-self._max_acceleration, self._max_acceleration).tolist()
        )

    def advance(self, reference: Array) -> bool:
        """One period on. Returns whether the reference is at rest."""
        output = self._output
        try:
            self._generator.update(self._problem, output)
        except (ruckig.RuckigError, ValueError):  # all but at rest, or far beyond anything
            reference[1:] = 0.0
            return True
        reference[:] = output.new_position, output.new_velocity, output.new_acceleration
        output.pass_to_input(self._problem)
        if np.abs(reference[1:]).max() > ROUNDING:
            return False
        reference[1:] = 0.0
        return True


class Quintic:
    """Continuous to the acceleration, from where the reference is to where the stream will be.

    A single target is met at the end of the period. A stream is met `HORIZON_S` ahead: one without noise is
    on the way there through each of its targets. Between two commands nothing holds the reference within
    the limits of acceleration and jerk. When no command has come at the end of the period, it goes on for a
    grace period as the stream went, then it settles on the target as `OnlineTrajectory` does.
    """

    def __init__(
        self, n: int, period_s: float, max_velocity: Array, max_acceleration: Array, max_jerk: Array
    ) -> None:
        self.reference = np.zeros((3, n))
        self._period_s = period_s
        self._estimate = Estimate(max_velocity, max_acceleration, WINDOW_S)
        self._bounds = np.stack([max_velocity, max_acceleration])
        self._end = OnlineTrajectory(n, period_s, max_velocity, max_acceleration, max_jerk)
        self._ended = False
        self._quintics = Quintics()
        self._start = np.zeros(n)
        self._ends = np.zeros((6, n))
        self._scale = np.ones((6, 1))
        self._coefficients = np.zeros((6, n))
        self._time_s = self._duration_s = self._horizon_s = 0.0

    def begin(self, state: Array) -> None:
        self.rebase(state, state[0])
        self._estimate.forget()
        self._end.begin(self.reference)
        self._ended = True

    def rebase(self, state: Array, target: Array) -> None:
        self.reference[:] = state
        self._estimate.rebase(target)

    def aim(self, target: Array, velocity: Array | None, duration_s: float) -> None:
        duration_s = max(duration_s, self._period_s)
        estimate, ends = self._estimate, self._ends
        estimate.update(target, velocity, duration_s)
        # From the start on, so that what does not move does not move by a rounding either.
        np.copyto(self._start, self.reference[0])
        horizon_s = max(duration_s, HORIZON_S) if estimate.velocity.any() else duration_s
        estimate.extrapolate(horizon_s - duration_s, ends[3:])
        ends[3] -= self._start
        ends[0], ends[1], ends[2] = 0.0, self.reference[1], self.reference[2]
        self._scale[1::3] = horizon_s
        self._scale[2::3] = horizon_s * horizon_s
        ends *= self._scale
        np.dot(HERMITE, ends, out=self._coefficients)
        self._time_s, self._duration_s, self._horizon_s = 0.0, duration_s, horizon_s
        self._ended = False

    def advance(self) -> None:
        if not self._ended:
            self._time_s += self._period_s
            beyond_s = self._time_s - self._duration_s
            in_time = beyond_s <= grace_s(self._duration_s)
            if in_time and self._time_s <= self._horizon_s + EARLY * self._period_s:
                self._quintics.evaluate(self._coefficients, self._time_s, self._horizon_s, self.reference)
                self.reference[0] += self._start
                return
            if in_time:
                self._estimate.extrapolate(beyond_s, self.reference)
                return
            self._estimate.forget()
            # A wild stream may have led it far beyond the limits, from where it would take long to come back.
            np.clip(self.reference[1:], -self._bounds, self._bounds, out=self.reference[1:])
            self._end.settle(self.reference, self._estimate.target)
            self._ended = True
        self._end.advance()
        np.copyto(self.reference, self._end.reference)


class OnlineTrajectory:
    """The fastest profile to the moving target, within the limits of velocity, acceleration and jerk.

    Up to the next command the target is taken to move as estimated, at a constant acceleration. In a frame
    that moves with it the problem is one from a state to rest, which Ruckig solves at once, and which
    lasts; a profile to a fixed place with a velocity there would run back to take a run-up whenever
    it is late. When no command has come at the end of the period and of a grace period, the reference
    brakes and settles on the target.
    """

    def __init__(
        self, n: int, period_s: float, max_velocity: Array, max_acceleration: Array, max_jerk: Array
    ) -> None:
        self.reference = np.zeros((3, n))
        self._period_s = period_s
        self._max_velocity, self._max_acceleration = max_velocity, max_acceleration
        self._estimate = Estimate(max_velocity, max_acceleration, WINDOW_S)
        self._brake = Brake(period_s, max_acceleration, max_jerk)
        self._generator = ruckig.Ruckig(n)
        self._problem = ruckig.InputParameter(n)
        # Time synchronisation would keep a joint busy that has nothing to catch up with.
        self._problem.synchronization = ruckig.Synchronization.No
        self._max_jerk = max_jerk
        self._problem.target_position = [0.0] * n
        self._profile, self._candidate = ruckig.Trajectory(n), ruckig.Trajectory(n)
        # Speed that a relative acceleration of the frame can add before it is taken back, per unit of it.
        self._swing_s = 1.5 * max_acceleration / max_jerk
        self._frame = np.zeros((3, n))  # of the target when it is due
        self._offset = np.zeros((3, n))
        self._motion = np.eye(3)
        self._braking = self._settling = True
        self._time_s = self._due_s = 0.0

    def begin(self, state: Array) -> None:
        self.rebase(state, state[0])
        self._estimate.forget()
        self._start_brake()

    def rebase(self, state: Array, target: Array) -> None:
        self.reference[:] = state
        self._estimate.rebase(target)

    def forget(self) -> None:
        """What comes next is no part of the stream so far."""
        self._estimate.forget()

    def settle(self, state: Array, target: Array) -> None:
        """From this state, shape (3, n), to rest at the target."""
        self.rebase(state, target)
        self._frame[0] = target
        self._end()

    def aim(self, target: Array, velocity: Array | None, duration_s: float) -> None:
        duration_s = max(duration_s, self._period_s)
        estimate, frame = self._estimate, self._frame
        estimate.update(target, velocity, duration_s)
        # As much acceleration as leaves room to both sides: it must end before the limits do.
        room = self._max_velocity - np.abs(estimate.velocity)
        bound = np.minimum(0.8 * self._max_acceleration, room / (2.0 * (self._swing_s + duration_s)))
        frame[0], frame[1] = target, estimate.velocity
        np.clip(estimate.acceleration, -bound, bound, out=frame[2])
        self._settling = False
        self._plan(duration_s)

    def advance(self) -> None:
        late_s = self._time_s - self._due_s + EARLY * self._period_s
        if not self._braking and not self._settling and late_s > grace_s(self._due_s):
            self._end()
        if self._braking:
            if self._brake.advance(self.reference):
                self._estimate.forget()
            return
        self._time_s += self._period_s
        self._place(self._time_s)
        self.reference[:] = self._profile.at_time(self._time_s)
        self.reference += self._offset
        if self._settling and self._time_s >= self._profile.duration:
            np.copyto(
                self.reference, self._frame
            )  # bit for bit, and without the rounding of the profile's end
            self._estimate.forget()

    def _end(self) -> None:
        self._frame[1:] = 0.0
        self._settling = True
        self._plan(0.0)

    def _place(self, time_s: float) -> None:
        """The frame in `_offset`, at a time in the profile."""
        ahead_s = time_s - self._due_s
        self._motion[0, 1] = self._motion[1, 2] = ahead_s
        self._motion[0, 2] = 0.5 * ahead_s * ahead_s
        np.dot(self._motion, self._frame, out=self._offset)

    def _plan(self, due_s: float) -> None:
        """A profile from the reference to rest in the frame, within the limits of joints at rest."""
        problem = self._problem
        self._time_s, self._due_s, self._braking = 0.0, due_s, False
        self._place(0.0)
        _, velocity, acceleration = self._frame
        state = self.reference - self._offset
        problem.current_position, problem.current_velocity, problem.current_acceleration = state.tolist()
        room = self._max_velocity - np.abs(acceleration) * (self._swing_s + due_s)
        problem.max_velocity, problem.min_velocity = (room - velocity).tolist(), (-room - velocity).tolist()
        problem.max_acceleration = (self._max_acceleration - acceleration).tolist()
        problem.min_acceleration = (-self._max_acceleration - acceleration).tolist()
        for share in JERKS:
            problem.max_jerk = (share * self._max_jerk).tolist()
            if self._calculated() and (share == 1.0 or self._candidate.duration <= PATIENCE_S):
                self._profile, self._candidate = self._candidate, self._profile
                return
        self._start_brake()

    def _calculated(self) -> bool:
        """Whether there is a candidate. Of numbers that are all but zero Ruckig makes none."""
        try:
            result = self._generator.calculate(self._problem, self._candidate)
        except (ruckig.RuckigError, ValueError):  # ValueError: a result that its binding does not know
            return False
        return result is ruckig.Result.Working

    def _start_brake(self) -> None:
        self._brake.begin(self.reference)
        self._braking = True
