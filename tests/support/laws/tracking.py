"""What `rtloop.generators.tracking` does, said with numpy and Ruckig."""

from __future__ import annotations

import numpy as np
import ruckig

from cobot.types import Array, JointLimits

TARGET_VELOCITY = 0.99
"""Of the limit: Ruckig refuses to arrive at the limit itself."""
ALONG = 0.9
"""Of the limits, for the motion of what is pursued: the rest is for the pursuit."""
GENTLENESS = (0.03, 0.1, 0.3, 0.6)
PATIENCE_S = 0.2
"""Shares of the jerk limit for a pursuit that goes along with a request: the first that is done in this time.
The rest of the limit is for the request's own jerk."""
ROUNDING = 1e-9


class Tracker:
    """Plans with Ruckig, each joint for itself, anew in each cycle. Real-time safe.

    Attributes:
        ahead: where the arm shall be one period later, shape (3, dof): rad, rad/s, rad/s².
    """

    def __init__(self, dof: int, period_s: float) -> None:
        self._period_s = period_s
        self._generator = ruckig.Ruckig(dof, period_s)
        self._problem = ruckig.InputParameter(dof)
        self._problem.synchronization = ruckig.Synchronization.No
        self._output = ruckig.OutputParameter(dof)
        self._zero = [0.0] * dof
        self.ahead = np.zeros((3, dof))

    def brake(self, state: Array, limits: JointLimits) -> bool:
        """Towards rest from a state, shape (3, dof), as fast as the limits permit; whether it is reached."""
        self._start(state, limits, limits.max_velocity)
        self._problem.control_interface = ruckig.ControlInterface.Velocity
        self._problem.target_velocity = self._zero
        self._update()
        if np.abs(self.ahead[1:]).max() > ROUNDING:
            return False
        self.ahead[1:] = 0.0
        return True

    def approach(
        self,
        state: Array,
        target: Array,
        velocity: Array,
        limits: JointLimits,
        max_velocity: Array,
        bounds: tuple[Array, Array],
    ) -> None:
        """Towards a target, to arrive there with this velocity or a lower one.

        No faster than can be on the way: there is no going back for a run-up.

        Args:
            max_velocity: instead of that of the limits, rad/s.
            bounds: the lowest and the highest positions. Who can stop between them, towards a target
                between them, will not leave them.
        """
        way = target - state[0]
        most = np.sqrt(limits.max_acceleration * np.abs(way))
        most = np.minimum(most, TARGET_VELOCITY * max_velocity)
        arrival = np.clip(velocity, -most, most)
        arrival[way * arrival < 0.0] = 0.0
        self._start(state, limits, max_velocity)
        self._problem.control_interface = ruckig.ControlInterface.Position
        self._problem.target_position = target.tolist()
        self._problem.target_velocity = arrival.tolist()
        try:
            self._update()
            if arrival.any() and self._leaves(*bounds):  # a short run-up, for want of jerk
                self._problem.target_velocity = self._zero
                self._update()
        except ruckig.RuckigError:  # once in millions it finds no way to a target, but always one to rest
            self.brake(state, limits)

    def along(self, state: Array, request: Array, limits: JointLimits, share: float, catch_up: float) -> bool:
        """Towards a request that moves, shape (3, dof): in a frame that moves with it, the difference goes to
        zero.

        Args:
            catch_up: how much faster than the request it may be, rad/s.

        Returns:
            Whether there is a way; it need not keep the limits, as the request need not.
        """
        period_s, problem = self._period_s, self._problem
        most_velocity, most_acceleration = share * limits.max_velocity, limits.max_acceleration
        position = request[0]
        velocity = np.clip(request[1], -ALONG * most_velocity, ALONG * most_velocity)
        acceleration = np.clip(request[2], -ALONG * most_acceleration, ALONG * most_acceleration)
        before = position - period_s * (velocity - 0.5 * period_s * acceleration)
        off = state - [before, velocity - period_s * acceleration, acceleration]
        problem.control_interface = ruckig.ControlInterface.Position
        problem.current_position, problem.current_velocity, problem.current_acceleration = off.tolist()
        problem.target_position = problem.target_velocity = self._zero
        problem.max_velocity = np.minimum(most_velocity - velocity, catch_up).tolist()
        problem.min_velocity = np.maximum(-most_velocity - velocity, -catch_up).tolist()
        problem.max_acceleration = (most_acceleration - acceleration).tolist()
        problem.min_acceleration = (-most_acceleration - acceleration).tolist()
        if not self._find_gentle(off[0], limits.max_jerk, moving=bool(velocity.any())):
            return False
        self.ahead += [position, velocity, acceleration]
        return True

    def _find_gentle(self, off: Array, max_jerk: Array, *, moving: bool) -> bool:
        """The gentlest way that is short enough; what stands still is not overshot for that."""
        found = False
        for share in GENTLENESS:
            self._problem.max_jerk = (share * max_jerk).tolist()
            try:
                self._update()
            except (ruckig.RuckigError, ValueError):  # none within such limits
                continue
            found = True
            way = self._output.trajectory
            if way.duration <= PATIENCE_S and (moving or not _overshoots(off, way)):
                break
        return found

    def _leaves(self, lowest: Array, highest: Array) -> bool:
        """Whether the way leads beyond these positions."""
        least, greatest = _extrema(self._output.trajectory)
        return bool((least < lowest).any() or (greatest > highest).any())

    def _start(self, state: Array, limits: JointLimits, max_velocity: Array) -> None:
        problem = self._problem
        problem.current_position, problem.current_velocity, problem.current_acceleration = state.tolist()
        problem.max_velocity = max_velocity.tolist()
        problem.max_acceleration = limits.max_acceleration.tolist()
        problem.max_jerk = limits.max_jerk.tolist()
        problem.min_velocity = problem.min_acceleration = None

    def _update(self) -> None:
        output = self._output
        self._generator.update(self._problem, output)
        self.ahead[:] = output.new_position, output.new_velocity, output.new_acceleration


def _overshoots(off: Array, way: ruckig.Trajectory) -> bool:
    """Whether a way to zero goes beyond it, or farther off than its start."""
    highest, lowest = np.maximum(off, 0.0) + ROUNDING, np.minimum(off, 0.0) - ROUNDING
    least, greatest = _extrema(way)
    return bool((least < lowest).any() or (greatest > highest).any())


def _extrema(way: ruckig.Trajectory) -> tuple[Array, Array]:
    """Of the positions, each shape (dof,). Ruckig's own misses some in phases without jerk."""
    profiles = [profile for (profile,) in zip(*way.profiles, strict=True)]
    parts = [part for profile in profiles for part in (profile.brake, profile)]
    t, p, v, a, j = (
        np.array([(list(getattr(part, name)) + [0.0] * 7)[:7] for part in parts]).reshape(len(profiles), 14)
        for name in "tpvaj"
    )
    root = np.sqrt(a * a - 2.0 * j * v)
    with np.errstate(all="ignore"):
        times = np.stack([0.0 * t, t, -2.0 * v / (a + root), -2.0 * v / (a - root)])
    inside = (times >= 0.0) & (times <= t) & (t > 0.0)
    positions = p + times * (v + times * (a / 2.0 + times * j / 6.0))
    lowest, highest = np.where(inside, positions, np.inf), np.where(inside, positions, -np.inf)
    here = np.array([profile.pf for profile in profiles])
    return (
        np.minimum(lowest.min(axis=(0, 2)), here),
        np.maximum(highest.max(axis=(0, 2)), here),
    )
