"""The last thing before a command is written: the same code in every mode and for every backend.

A command within the limits passes bit for bit. What is not finite is refused and latches an e-stop;
what goes beyond position, velocity, acceleration or jerk is caught: from then on the output is a
jerk-limited pursuit of the request that stays within all limits, until the request can be reached
in one step again. What is streamed may change its mind at any time: there the limits are tighter, the
pursuit goes along with the request's velocity, and a joint that could no longer stop before its limit
slows down before it gets there.
"""

from __future__ import annotations

import numpy as np

from cobot.ipc.layout import Intervention
from cobot.types import Array, JointLimits
from rtloop.generators.tracking import Tracker

TOLERANCE = 0.01
"""Relative, on the rates: planners drive exactly at the limits, and the differences of four positions
carry the rounding of numbers of the order of 1 rad, divided by the period cubed."""
POSITION_TOLERANCE_RAD = 1e-5

KINDS = (
    Intervention.POSITION,
    Intervention.VELOCITY,
    Intervention.ACCELERATION,
    Intervention.JERK,
    Intervention.VELOCITY,
    Intervention.ACCELERATION,
)
"""Of the rows that are checked: the position, its first to third difference, and the rates that the
command states."""
ROWS = len(KINDS)
PAST = 3
MEETING = 0.5
"""Of what the jerk limits let the acceleration change by, for the step from a pursuit to the request: with
all of it there would be none left for the request's next step."""
WAY_SHARE = 1.05
WAY_RAD = 5e-5
"""Of the way to rest, and on top: what is known of the acceleration is rounded, and a cycle old."""
CALM = 0.6
"""Of the velocity limits. With an acceleration of no more than √(j v) the velocity can grow by v/2 until that
is taken back, which leaves it below the limit."""


class Safety:
    """Guards one arm's commands. Real-time safe.

    On seven joints a numpy call costs more than its arithmetic, so the check is one matrix product: past
    positions, command and limits lie in one block, and the product gives all distances to all limits.

    Attributes:
        command: the command let through last, shape (3, dof): rad, rad/s, rad/s².
        position, velocity, acceleration: its rows.
        interventions: how often each kind of excess was caught, shape (len(Intervention),).
        intervened_ns: when the last one of each kind was, in the same order.
        counted: their sum.
        now_ns: the cycle's time; the caller sets it.
        pursuing: whether the output is not the request but follows it.
    """

    def __init__(self, limits: JointLimits, period_s: float) -> None:
        dof = limits.dof
        self._limits = limits
        self._period_s = period_s
        self._block = np.zeros((PAST + 3 + 2 * ROWS, dof))
        self._highest, self._lowest = self._block[PAST + 3], self._block[PAST + 3 + ROWS]
        self._past = self._block[:PAST]  # the positions let through before, the newest last
        self.command = self._block[PAST : PAST + 3]
        self.position, self.velocity, self.acceleration = self.command
        rate = 1.0 / period_s
        # of the last three positions, in the order of `_block`: the oldest first
        self._differences = np.array(
            [[0.0, 0.0, 1.0], [0.0, -rate, rate], [rate**2, -2.0 * rate**2, rate**2]]
        )
        values = np.zeros((ROWS, PAST + 3))
        values[:3, 1:4] = self._differences
        values[3, :4] = rate**3 * np.array([-1.0, 3.0, -3.0, 1.0])
        values[4:, 4:] = np.eye(2)
        one, none = np.eye(ROWS), np.zeros((ROWS, ROWS))
        self._distances = np.block([[-values, one, none], [values, none, -one]])
        self._distance = np.zeros((2 * ROWS, dof))
        self.interventions = np.zeros(len(Intervention), np.uint64)
        self.intervened_ns = np.zeros(len(Intervention), np.int64)
        self.counted = 0
        self.now_ns = 0
        self._tracker = Tracker(dof, period_s)
        self._pursued = np.zeros((3, dof))  # where the pursuit is
        self._calm = np.zeros((2, 3, dof))
        self._caught: set[Intervention] = set()  # in this pursuit
        self.pursuing = False
        self.use(limits)

    def use(self, limits: JointLimits, share: float = 1.0, catch_up: float = np.inf) -> None:
        """Catch what exceeds these rates, from now on; the joint positions' limits stay.

        Args:
            share: of the velocities.
            catch_up: how much faster than a moving request a pursuit of it may be, rad/s.
        """
        self._used = limits
        self._share = share
        self._catch_up = catch_up
        self._largest_step = limits.max_jerk * self._period_s  # of the acceleration, from cycle to cycle
        velocity, acceleration = limits.max_velocity * share, limits.max_acceleration
        rates = (1.0 + TOLERANCE) * np.array(
            [velocity, acceleration, limits.max_jerk, velocity, acceleration]
        )
        first = PAST + 3
        self._block[first + 1 : first + ROWS] = rates
        self._block[first + ROWS + 1 :] = -rates
        self._find_calm()

    def slow_down(self, share: float) -> None:
        """Permit only a share of the velocities; who is faster is slowed down within the other limits."""
        if share != self._share:
            self.use(self._used, share, self._catch_up)

    def reset(self, position: Array) -> None:
        """Start over at rest at a position, without a jump: the arm has to be there.

        A position beyond the limits, where it was pushed, is held, and left only towards them.
        """
        reach = self._limits.including(position)
        self._lowest[:] = reach.min_position - POSITION_TOLERANCE_RAD
        self._highest[:] = reach.max_position + POSITION_TOLERANCE_RAD
        self._find_calm()
        self.command[:] = 0.0
        self.position[:] = position
        self._past[:] = position
        self.pursuing = False
        self._caught.clear()

    def apply(self, request: Array, *, streamed: bool = False) -> bool:
        """Let a command through, or the nearest that is safe; the result is in `command`.

        Args:
            request: shape (3, dof): rad, rad/s, rad/s².
            streamed: nobody knows what comes next.

        Returns:
            False when the request is not finite: the caller has to latch an e-stop.
        """
        np.copyto(self.command, request)
        np.dot(self._distances, self._block, out=self._distance)
        inside = bool(self._distance.min() >= 0.0)  # false for a NaN too
        ahead = self._foresee() if streamed and inside else None
        if inside and ahead is None and (not self.pursuing or self._meets()):
            self.pursuing = False
            self._past[:] = self._block[1 : PAST + 1]
            return True
        return self._catch(request, inside=inside, ahead=ahead, streamed=streamed)

    def brake(self) -> bool:
        """Come to rest from wherever the arm is, each joint for itself, as fast as the limits permit.

        Returns:
            Whether it is at rest.
        """
        at_rest = self._tracker.brake(self._state(), self._limits)
        self._let_through_pursuit()
        return at_rest

    def count(self, kind: Intervention) -> None:
        """One more intervention."""
        self.interventions[kind] += 1
        self.intervened_ns[kind] = self.now_ns
        self.counted += 1

    def _catch(self, request: Array, *, inside: bool, ahead: Intervention | None, streamed: bool) -> bool:
        if not self.pursuing:
            self._caught.clear()
        finite = inside or bool(np.isfinite(request).all())
        kind = ahead
        if not inside:
            distance = self._distance.reshape(2, ROWS, -1).min(axis=(0, 2))
            kind = KINDS[(distance < 0.0).argmax()] if finite else Intervention.NOT_FINITE
        if kind is not None and kind not in self._caught:
            self._caught.add(kind)
            self.count(kind)
        if not finite:
            self.brake()
            return False
        target = request[0].clip(self._lowest, self._highest)
        velocity = np.zeros(self._limits.dof)
        if streamed:
            clipped = target != request[0]
            if ahead is not Intervention.POSITION and not clipped.any() and self._pursue_along(request):
                return True
            velocity = np.where(clipped | self._too_fast_at(target, request[1]), 0.0, request[1])
        bounds = self._lowest, self._highest
        most = np.minimum(self._share * self._used.max_velocity, np.abs(request[1]) + self._catch_up)
        self._tracker.approach(self._state(), target, velocity, self._used, most, bounds)
        self._let_through_pursuit()
        return True

    def _pursue_along(self, request: Array) -> bool:
        """Pursue a request that moves, if that keeps the limits; if not, nothing has been let through."""
        if not self._tracker.along(self._state(), request, self._used, self._share, self._catch_up):
            return False
        np.copyto(self.command, self._tracker.ahead)
        np.dot(self._distances, self._block, out=self._distance)
        if not self._distance.min() >= 0.0 or self._foresee() is not None:
            return False
        self._let_through_pursuit()
        return True

    def _find_calm(self) -> None:
        """The positions, velocities and accelerations from which there is nothing to foresee."""
        speed = CALM * self._share * self._used.max_velocity
        acceleration = np.minimum(self._used.max_acceleration, np.sqrt(self._used.max_jerk * speed))
        way = self._way(speed, acceleration + self._largest_step)
        self._calm[:] = (
            [self._lowest + way, -speed, -acceleration],
            [self._highest - way, speed, acceleration],
        )

    def _foresee(self) -> Intervention | None:
        """What the command would lead to, if not now: a joint that could come to rest only beyond its limit,
        or one whose acceleration could not be taken back before its velocity limit.
        """
        state = self._differences @ self._block[1 : PAST + 1]
        if ((state >= self._calm[0]) & (state <= self._calm[1])).all():
            return None
        position, velocity, acceleration = state
        velocity += 0.5 * self._period_s * acceleration
        peak = np.abs(velocity + acceleration * np.abs(acceleration) / (2.0 * self._used.max_jerk))
        if (peak > (1.0 + 0.5 * TOLERANCE) * self._share * self._used.max_velocity).any():
            return Intervention.VELOCITY
        # The second difference is that of one cycle ago.
        way = self._way(np.abs(velocity), np.abs(acceleration) + self._largest_step)
        up = (position + way > self._highest) & ((velocity > 0.0) | (acceleration > 0.0))
        down = (position - way < self._lowest) & ((velocity < 0.0) | (acceleration < 0.0))
        return Intervention.POSITION if (up | down).any() else None

    def _too_fast_at(self, target: Array, velocity: Array) -> Array:
        """Which joints could not stop before their limits any more if they passed a target so fast."""
        way = self._way(np.abs(velocity), np.zeros(self._limits.dof))
        reach = target + np.copysign(way, velocity)
        found: Array = (reach > self._highest) | (reach < self._lowest)
        return found

    def _way(self, speed: Array, acceleration: Array) -> Array:
        """How far a joint gets until it rests: a bound that is simple and never too short.

        The acceleration is taken back to zero, which may add speed; then the joint brakes. For the largest
        speed v, the limits a and j, v²/2a + va/2j holds for short and for long ways.
        """
        jerk, most = self._used.max_jerk, self._used.max_acceleration
        peak = speed + 1.5 * self._period_s * acceleration + acceleration * acceleration / (2.0 * jerk)
        way: Array = peak * (acceleration / jerk + peak / (2.0 * most) + most / (2.0 * jerk))
        return WAY_SHARE * way + WAY_RAD

    def _meets(self) -> bool:
        """Whether the pursuit has come so close that going over to the request keeps the jerk limits."""
        acceleration = self._differences[2] @ self._block[1 : PAST + 1]
        step = np.maximum(np.abs(acceleration - self._pursued[2]), np.abs(acceleration - self.acceleration))
        return bool((step <= MEETING * self._largest_step).all())

    def _state(self) -> Array:
        """What the arm really does, whatever was stated, shape (3, dof).

        Of the last three positions, which give the velocity half a period ago; a pursuit knows it exactly.
        """
        if self.pursuing:
            return self._pursued
        state: Array = self._differences @ self._past
        state[1] += 0.5 * self._period_s * state[2]
        return state

    def _let_through_pursuit(self) -> None:
        np.copyto(self.command, self._tracker.ahead)
        np.copyto(self._pursued, self.command)
        self.pursuing = True
        self._past[:] = self._block[1 : PAST + 1]
