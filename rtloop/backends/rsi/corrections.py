"""The corrections of one RSI session: their exact sums, their limits, and compensation for answers that the
controller has missed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cobot.types import Array, JointLimits
from rtloop.backends.rsi.telegrams import MICRO, RobState, TelegramLayout
from rtloop.results import ACCEPTED, Accepted, Rejected

Counts = NDArray[np.int64]

FOLLOW_S = 0.2
"""Maximum time that an arm takes to reach a corrected position, s."""
MADE_UP_S, RESOLUTION = 0.015, 1000
"""Time constant for adding a missing correction to later answers, s, and the remainder that is added at once,
in millionths.
"""
RESTED_S = 0.3
"""Time at rest after which the sum of relative corrections is compared with the controller's, s."""
SLACK_RAD = 2e-4
"""Resolution of positions that a controller reports with two decimals, rad."""
SAME_RAD = 1e-3
"""Two positions that differ by at most this are the same, rad or m."""
MARGIN, REACTION_PERIODS = 1.3, 4
"""Safety factor for the stopping distance before the maximum correction, and number of periods until the stop
begins.
"""
CONFIRMED = 2.0
"""Distance, in multiples of `follow_rad`, after which it is certain whether the controller's corrections are
absolute or relative.
"""
EARLY = 1.0 / 3.0
"""Allowed deviation before this is certain, as a fraction of `follow_rad`."""


class Corrections:
    """The corrections relative to a reference position, in whole millionths of a degree or mm.

    Attributes:
        reference: position of the joints without corrections, shape (dof,), rad or m; None before the first
            session.
        sent: sum of the corrections that were sent and are not known to be lost, shape (dof,), integers.
    """

    def __init__(
        self,
        layout: TelegramLayout,
        limits: JointLimits,
        period_s: float,
        max_correction: Array,
        *,
        relative: bool,
    ) -> None:
        """
        Args:
            max_correction: maximum corrections, degrees or mm, shape (dof,).
        """
        self._layout, self._limits = layout, limits
        self._scale = layout.scale * MICRO
        self._relative, self._period_s = relative, period_s
        self._most = np.floor(max_correction * MICRO).astype(np.int64)
        self._made_up = 1.0 - math.exp(-period_s / MADE_UP_S)
        self._max_step = np.maximum(1.0, limits.max_velocity * period_s * self._scale)
        dof = limits.dof
        self.reference: Array | None = None
        self.sent = self._goal = self._step = np.zeros(dof, np.int64)
        self._resting = 0

    def begin(self, reference: Array, correction: Array) -> None:
        """Begin a session. `correction` is the correction that is already in effect, rad or m."""
        self.reference = np.array(reference, dtype=float)
        self._goal = self.sent = np.rint(np.asarray(correction) * self._scale).astype(np.int64)
        self._step = np.zeros_like(self.sent)
        self._resting = 0

    @property
    def position(self) -> Array:
        """Return the position that the corrections command, shape (dof,), rad or m."""
        assert self.reference is not None
        found: Array = self.reference + self.sent / self._scale
        return found

    def agree(self, set_position: Sequence[float], correction: Sequence[float]) -> bool:
        """Whether the controller's set position and correction, rad or m, are from the same session as these
        corrections.
        """
        if self.reference is None:
            return False
        off = np.subtract(correction, self.sent / self._scale)
        moved = np.subtract(set_position, correction) - self.reference
        return bool(max(np.abs(off).max(), np.abs(moved).max()) < SAME_RAD)

    def take_back(self) -> None:
        """Handle an answer that the controller has not used, by including its correction in the next
        answers.
        """
        self.sent = self.sent - self._step
        self._step = np.zeros_like(self.sent)

    def answer(self, target: Array | None, periods: int = 1) -> Counts:
        """Return the values for the next answer, in millionths of a degree or mm.

        Without losses, the sum equals the target. After a loss, the missing part is added gradually, because
        the controller does not smooth corrections.

        Args:
            target: target position, rad or m; None to stay at the current position.
            periods: number of periods since the last answer.
        """
        before, most = self._goal, np.maximum(self._most, np.abs(self.sent))
        if target is None or self.reference is None:
            before = goal = self.sent
        else:
            goal = np.rint((target - self.reference) * self._scale).astype(np.int64)
        goal = np.clip(goal, -most, most)
        step = (goal - before) // max(periods, 1)
        rest = goal - self.sent - step
        part = np.where(np.abs(rest) > RESOLUTION, np.trunc(self._made_up * rest), rest)
        step = step + part.astype(np.int64)
        excess = float((np.abs(step) / self._max_step).max())
        if excess > 1.0:
            step = np.trunc(step / excess).astype(np.int64)
        self._resting = self._resting + 1 if not step.any() else 0
        self._goal, self._step, self.sent = goal, step, self.sent + step
        return step if self._relative else self.sent

    def check_limit(self, velocity: Array) -> Accepted | Rejected:
        """Check that an arm with this velocity, rad/s or m/s, can still stop within the maximum
        correction.
        """
        limits = self._limits
        slowing = velocity * np.abs(velocity) / (2.0 * limits.max_acceleration)
        slowing += velocity * limits.max_acceleration / (2.0 * limits.max_jerk)
        ahead = MARGIN * slowing + REACTION_PERIODS * self._period_s * velocity
        reached = (self.sent + ahead * self._scale) / np.maximum(self._most, 1)
        outwards = reached * np.sign(velocity) if velocity.any() else np.abs(reached)
        joint = int(outwards.argmax())
        if outwards[joint] <= 1.0:
            return ACCEPTED
        axis = self._layout.axes[joint]
        unit = "mm" if self._layout.scale[joint] == 1e3 else "degrees"
        return Rejected(
            f"{axis} is {self.sent[joint] / MICRO:.3f} {unit} away from the position at which RSI was "
            f"started and moves on, allowed: {self._most[joint] / MICRO:g} {unit} "
            "(robot.backend.max_correction, and the limits of AXISCORR in the RSI context): move back, "
            "or raise both"
        )

    def settle(self, state: RobState) -> None:
        """Adopt the controller's own sum of the relative corrections if it differs from the sum in this
        object while the arm is at rest.
        """
        if not self._relative or self._resting * self._period_s < RESTED_S or self.reference is None:
            return
        if not state.setpoint:
            return
        theirs = np.array(state.setpoint) - self.reference
        if (np.abs(theirs - self.sent / self._scale) > SLACK_RAD).any():
            self.sent = np.rint(theirs * self._scale).astype(np.int64)
            self._resting = 0


class FollowWatch:
    """Checks that the arm follows the corrections. The arm must be on the part of the path that was commanded
    during the last `FOLLOW_S`.

    Attributes:
        is_summed: whether the controller wrongly adds up absolute corrections.
    """

    def __init__(self, layout: TelegramLayout, period_s: float, tolerance: float) -> None:
        self._layout, self._tolerance = layout, tolerance
        self._rows = np.zeros((max(2, round(FOLLOW_S / period_s)), len(layout.axes)))
        self._next = 0
        self.forget()

    def forget(self) -> None:
        """Start the check again."""
        self._filled = False
        self._confirmed = self.is_summed = False
        self._sum = np.zeros(len(self._layout.axes))

    def add(self, position: Array, values: Counts, *, relative: bool) -> None:
        """Add the command of a cycle: the position, and the values of the answer."""
        if not self._filled:
            self._rows[:] = position
            self._filled = True
        self._rows[self._next] = position
        self._next = (self._next + 1) % len(self._rows)
        if not relative and not self._confirmed:
            self._sum += values / (MICRO * self._layout.scale)

    def check(self, measured: Array, reference: Array) -> Accepted | Rejected:
        """Check that the measured position matches one of the last commanded positions within the
        tolerance.
        """
        if not self._filled:
            return ACCEPTED
        low, high = self._rows.min(axis=0), self._rows.max(axis=0)
        off = np.maximum(low - measured, measured - high)
        joint = int(off.argmax())
        allowed = self._tolerance if self._confirmed else EARLY * self._tolerance
        if off[joint] <= allowed:
            moved = np.abs(measured - reference).max() > CONFIRMED * self._tolerance
            self._confirmed = self._confirmed or bool(moved)
            return ACCEPTED
        axis, beyond = self._layout.axes[joint], measured[joint] - reference[joint]
        self.is_summed = not self._confirmed and bool(self._sum[joint] * beyond > 0.0)
        reason = f"{axis} is {off[joint]:.4f} rad (or m) off the path of its corrections"
        if self.is_summed:
            return Rejected(
                f"{reason}: the controller adds them up. Its program has RSI_ON(#RELATIVE), and "
                "robot.backend.correction is absolute: change one of them"
            )
        return Rejected(
            f"{reason}, allowed: {allowed:g} (robot.backend.follow_rad): something holds the arm, a "
            "limit of the RSI context is reached, or axes, tags or the mode of RSI_ON differ from "
            "robot.backend"
        )
