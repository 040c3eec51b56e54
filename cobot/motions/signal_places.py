"""The places of actions on a trajectory: from distances, times and fractions to path times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cobot.errors import InputError
from cobot.motions.signals import Action, PathSignals, Placed, PlacedAction, require_conditions
from cobot.trajectory import Trajectory
from cobot.types import MAX_ACTIONS, Array

if TYPE_CHECKING:
    from cobot.robot.chain import Chain

SAMPLE_S = 0.002
"""Period at which the path of the TCP is measured, s: chords are then exact to a millionth."""
MAX_SAMPLES = 100_000
MIN_LENGTH_M = 1e-4
"""A TCP that moves less than this only turns: fractions of its path are fractions of its time, m."""
REST_S = 0.01
"""Duration of the motion of an arm that is at its goal already, but has actions or conditions, s."""


class TcpWay:
    """The way of the TCP along a trajectory.

    Attributes:
        duration_s: of the trajectory.
    """

    def __init__(self, trajectory: Trajectory, chain: Chain) -> None:
        """chain: of the arm, with the tool's TCP."""
        self.duration_s = trajectory.duration_s
        count = min(max(math.ceil(self.duration_s / SAMPLE_S), 1), MAX_SAMPLES) + 1
        self._times_s = np.linspace(0.0, self.duration_s, count)
        places = chain.poses(trajectory.sample(self._times_s))[:, :3]
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        self._lengths_m: Array = np.concatenate([[0.0], np.cumsum(steps)])

    def length_m(self, path_time_s: float) -> float:
        """Length of the path up to a path time, m."""
        return float(np.interp(path_time_s, self._times_s, self._lengths_m))

    def path_time_s(self, length_m: float) -> float:
        """First path time at which the path has this length, s."""
        return float(np.interp(length_m, *self._increasing()))

    def _increasing(self) -> tuple[Array, Array]:
        """Lengths and times without those at which the TCP stands still."""
        grows = np.concatenate([[True], np.diff(self._lengths_m) > 0.0])
        return self._lengths_m[grows], self._times_s[grows]


def place_signals(segments: Sequence[PathSignals], ends_s: Sequence[float], way: TcpWay) -> Placed:
    """The actions and conditions of motions that a trajectory goes through.

    Args:
        segments: those of each motion.
        ends_s: the path time at which each motion ends.

    Raises:
        InputError: an action is beyond the end of its motion, there are too many, or a condition is given for
            a motion that cannot have it.
    """
    actions: list[PlacedAction] = []
    begin_s = 0.0
    conditions: dict[str, Any] = {}
    prefixes = [f"motions[{index}]." if len(segments) > 1 else "" for index in range(len(segments))]
    require_conditions(segments, prefixes)
    for signals, prefix, end_s in zip(segments, prefixes, ends_s, strict=True):
        for action in signals.actions:
            path_time_s = min(_path_time_s(action, prefix, begin_s, end_s, way), way.duration_s)
            actions.append(PlacedAction(len(actions) + 1, path_time_s, action))
        conditions |= _conditions(signals, (begin_s, end_s))
        begin_s = end_s
    if len(actions) > MAX_ACTIONS:
        raise InputError(f"actions: the motion has {len(actions)}, at most {MAX_ACTIONS} are possible")
    return Placed(tuple(sorted(actions, key=lambda each: each.path_time_s)), **conditions)


def _conditions(signals: PathSignals, times_s: tuple[float, float]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    if signals.start_when is not None:
        found["start_when"] = signals.start_when
    if signals.pause_while is not None:
        found |= {"pause_while": signals.pause_while, "pause_s": times_s}
    if signals.until is not None:
        found |= {"until": signals.until, "until_s": times_s[0]}
    return found


def _path_time_s(action: Action, prefix: str, begin_s: float, end_s: float, way: TcpWay) -> float:
    """The path time of a place on the part of the way between two path times."""
    place = action.place
    begin_m, end_m = way.length_m(begin_s), way.length_m(end_s)
    by_time = place.unit == "time_s" or (place.unit == "fraction" and end_m - begin_m < MIN_LENGTH_M)
    begin, end = (begin_s, end_s) if by_time else (begin_m, end_m)
    if place.unit == "fraction":
        ahead = place.value * (end - begin)
    elif place.value <= end - begin:
        ahead = place.value
    else:
        unit = "s" if by_time else "m"
        raise InputError(
            f"{prefix}{action.field}.at.{place.unit}: is {place.value:g} {unit}, the path is "
            f"{end - begin:.4g} {unit} long; give at most that, or a fraction"
        )
    there = end - ahead if place.from_end else begin + ahead
    if by_time:
        return there
    if there >= end_m:  # the TCP may turn on the spot, or stand still, at the end
        return end_s
    return min(max(way.path_time_s(there), begin_s), end_s)


def resting(joints: Array) -> Trajectory:
    """The motion of an arm that is at its goal already, for its actions and conditions."""
    coefficients = np.zeros((1, len(joints), 6))
    coefficients[0, :, 0] = joints
    return Trajectory(np.array([0.0, REST_S]), coefficients)
