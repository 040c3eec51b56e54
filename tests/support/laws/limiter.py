"""What `rtloop.safety.limiter` does, said with numpy. `Watch` says it of many inputs at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cobot.ipc.layout import Intervention
from cobot.types import Array, JointLimits
from rtloop.generators.tracking import Tracker

TOLERANCE = 0.01
POSITION_TOLERANCE_RAD = 1e-5
MEETING = 0.5
WAY_SHARE = 1.05
WAY_RAD = 5e-5
CALM = 0.6
KINDS = np.array(
    [
        Intervention.POSITION,
        Intervention.VELOCITY,
        Intervention.ACCELERATION,
        Intervention.JERK,
        Intervention.VELOCITY,
        Intervention.ACCELERATION,
    ]
)
"""Of the rows that are checked: the position, its first to third difference, and the rates that the
command states."""
NOTHING = -1


@dataclass
class Watch:
    """What is beyond the limits, or will be.

    Arguments have the joints last, and any shape before that: the past positions (..., 3, dof), the newest
    last, and commands (..., 3, dof).
    """

    limits: JointLimits
    period_s: float
    share: float = 1.0

    @property
    def lowest(self) -> Array:
        return self.limits.min_position - POSITION_TOLERANCE_RAD

    @property
    def highest(self) -> Array:
        return self.limits.max_position + POSITION_TOLERANCE_RAD

    @property
    def max_velocity(self) -> Array:
        return self.share * self.limits.max_velocity

    @property
    def largest_step(self) -> Array:
        """Of the acceleration, from cycle to cycle."""
        return self.limits.max_jerk * self.period_s

    def excess(self, past: Array, command: Array) -> Array:
        """The kind of the first row that is beyond its limits at some joint, shape (...)."""
        positions = np.concatenate([past, command[..., :1, :]], axis=-2)
        rows = [positions[..., -1, :]]
        rows += [np.diff(positions, n, axis=-2)[..., -1, :] / self.period_s**n for n in (1, 2, 3)]
        rows += [command[..., 1, :], command[..., 2, :]]
        values = np.stack(rows, axis=-2)
        limits = self.limits
        rates = [self.max_velocity, limits.max_acceleration, limits.max_jerk]
        most = (1.0 + TOLERANCE) * np.array([*rates, *rates[:2]])
        high, low = np.vstack([self.highest, most]), np.vstack([self.lowest, -most])
        beyond = ~((values >= low) & (values <= high)).all(axis=-1)  # what is no number too
        found: Array = np.where(beyond.any(axis=-1), KINDS[beyond.argmax(axis=-1)], NOTHING)
        finite = np.isfinite(command).all(axis=(-2, -1))
        return np.where(finite, found, Intervention.NOT_FINITE)

    def state(self, positions: Array) -> Array:
        """Of three positions (..., 3, dof): position, velocity half a period ago, and acceleration."""
        newest = positions[..., 2, :]
        velocity = np.diff(positions, axis=-2)[..., 1, :] / self.period_s
        acceleration = np.diff(positions, 2, axis=-2)[..., 0, :] / self.period_s**2
        return np.stack([newest, velocity, acceleration], axis=-2)

    def foreseen(self, past: Array, command: Array) -> Array:
        """What the command would lead to, if not now, shape (...)."""
        state = self.state(np.concatenate([past[..., 1:, :], command[..., :1, :]], axis=-2))
        low, high = self.calm()
        calm = ((state >= low) & (state <= high)).all(axis=(-2, -1))
        position, velocity, acceleration = np.moveaxis(state, -2, 0)
        velocity = velocity + 0.5 * self.period_s * acceleration
        peak = np.abs(velocity + acceleration * np.abs(acceleration) / (2.0 * self.limits.max_jerk))
        fast = (peak > (1.0 + 0.5 * TOLERANCE) * self.max_velocity).any(axis=-1)
        way = self.way(np.abs(velocity), np.abs(acceleration) + self.largest_step)
        up = (position + way > self.highest) & ((velocity > 0.0) | (acceleration > 0.0))
        down = (position - way < self.lowest) & ((velocity < 0.0) | (acceleration < 0.0))
        found = np.where((up | down).any(axis=-1), Intervention.POSITION, NOTHING)
        found = np.where(fast, Intervention.VELOCITY, found)
        return np.where(calm, NOTHING, found)

    def calm(self) -> tuple[Array, Array]:
        """The lowest and highest states, shape (3, dof), from which there is nothing to foresee."""
        speed = CALM * self.max_velocity
        acceleration = np.minimum(self.limits.max_acceleration, np.sqrt(self.limits.max_jerk * speed))
        way = self.way(speed, acceleration + self.largest_step)
        return (
            np.array([self.lowest + way, -speed, -acceleration]),
            np.array([self.highest - way, speed, acceleration]),
        )

    def way(self, speed: Array, acceleration: Array) -> Array:
        """How far a joint gets until it rests: never too short."""
        jerk, most = self.limits.max_jerk, self.limits.max_acceleration
        peak = speed + 1.5 * self.period_s * acceleration + acceleration * acceleration / (2.0 * jerk)
        way: Array = peak * (acceleration / jerk + peak / (2.0 * most) + most / (2.0 * jerk))
        return WAY_SHARE * way + WAY_RAD


class Safety:
    """Guards one arm's commands; `command` is the one let through last, shape (3, dof).

    Pursuits are left to a tracker, for which there is a law too.
    """

    def __init__(
        self, limits: JointLimits, period_s: float, share: float, catch_up: float, tracker: Tracker
    ) -> None:
        self._watch = Watch(limits, period_s, share)
        self._catch_up = catch_up
        self._tracker = tracker
        self.command = self._pursued = np.zeros((3, limits.dof))
        self.interventions = np.zeros(len(Intervention), np.uint64)
        self._caught: set[int] = set()  # in this pursuit
        self.pursuing = False

    def begin(self, past: Array) -> None:
        """Not pursuing, after these positions, shape (3, dof)."""
        self.past = past.copy()
        self.pursuing = False

    def apply(self, request: Array, *, streamed: bool = False) -> bool:
        """Let a command through, or the nearest that is safe. False when the request is not finite."""
        kind = int(self._watch.excess(self.past, request))
        ahead = NOTHING
        if streamed and kind == NOTHING:
            ahead = int(self._watch.foreseen(self.past, request))
        if kind == ahead == NOTHING and (not self.pursuing or self._meets(request)):
            self.pursuing = False
            self._let_through(request)
            return True
        return self._catch(request, kind, ahead, streamed=streamed)

    def brake(self) -> bool:
        """Come to rest from wherever the arm is; whether it is at rest."""
        at_rest = self._tracker.brake(self._state(), self._watch.limits)
        self._let_through_pursuit()
        return at_rest

    def _catch(self, request: Array, kind: int, ahead: int, *, streamed: bool) -> bool:
        if not self.pursuing:
            self._caught.clear()
        for each in {kind, ahead} - {NOTHING} - self._caught:
            self._caught.add(each)
            self.interventions[each] += 1
        if kind == Intervention.NOT_FINITE:
            self.brake()
            return False
        watch, (position, wanted, _) = self._watch, request
        target = position.clip(watch.lowest, watch.highest)
        velocity = np.zeros_like(target)
        if streamed:
            clipped = target != position
            if ahead != Intervention.POSITION and not clipped.any() and self._pursue_along(request):
                return True
            reach = target + np.copysign(watch.way(np.abs(wanted), np.zeros_like(wanted)), wanted)
            too_fast = (reach > watch.highest) | (reach < watch.lowest)
            velocity = np.where(clipped | too_fast, 0.0, wanted)
        most = np.minimum(watch.max_velocity, np.abs(wanted) + self._catch_up)
        bounds = watch.lowest, watch.highest
        self._tracker.approach(self._state(), target, velocity, watch.limits, most, bounds)
        self._let_through_pursuit()
        return True

    def _pursue_along(self, request: Array) -> bool:
        """Pursue a request that moves, if that keeps the limits; if not, nothing has been let through."""
        watch, tracker = self._watch, self._tracker
        if not tracker.along(self._state(), request, watch.limits, watch.share, self._catch_up):
            return False
        if watch.excess(self.past, tracker.ahead) != NOTHING:
            return False
        if watch.foreseen(self.past, tracker.ahead) != NOTHING:
            return False
        self._let_through_pursuit()
        return True

    def _meets(self, request: Array) -> bool:
        """Whether the pursuit has come so close that going over to the request keeps the jerk limits."""
        acceleration = self._watch.state(np.vstack([self.past[1:], request[:1]]))[2]
        step = np.maximum(np.abs(acceleration - self._pursued[2]), np.abs(acceleration - request[2]))
        return bool((step <= MEETING * self._watch.largest_step).all())

    def _state(self) -> Array:
        """What the arm really does, whatever was stated, shape (3, dof)."""
        if self.pursuing:
            return self._pursued
        state = self._watch.state(self.past)
        state[1] += 0.5 * self._watch.period_s * state[2]
        return state

    def _let_through(self, command: Array) -> None:
        self.command = command.copy()
        self.past = np.vstack([self.past[1:], command[:1]])

    def _let_through_pursuit(self) -> None:
        self._let_through(self._tracker.ahead)
        self._pursued = self.command
        self.pursuing = True
