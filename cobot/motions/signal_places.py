"""Converts the positions of actions along a trajectory from distances, times and fractions to path times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cobot.errors import InputError
from cobot.motions.signals import (
    Action,
    PathPlace,
    PathSignals,
    Placed,
    PlacedAction,
    require_conditions,
)
from cobot.trajectory import Trajectory
from cobot.types import MAX_ACTIONS, Array

if TYPE_CHECKING:
    from cobot.robot.chain import Chain

SAMPLE_S = 0.002
"""Period at which the TCP path is sampled, s. It is so short that the chords are exact to a millionth."""
MAX_SAMPLES = 100_000
MIN_LENGTH_M = 1e-4
"""If the TCP moves by less than this, m, it only turns. Fractions of its path are then fractions of its
time.
"""
REST_S = 0.01
"""Duration, s, of a motion that has actions or conditions but whose goal is already reached."""


class TcpWay:
    """The path of the TCP along a trajectory.

    Attributes:
        duration_s: trajectory duration.
    """

    def __init__(self, trajectory: Trajectory, chain: Chain) -> None:
        """
        Args:
            chain: kinematics of the arm, with the tool's TCP.
        """
        self.duration_s = trajectory.duration_s
        count = min(max(math.ceil(self.duration_s / SAMPLE_S), 1), MAX_SAMPLES) + 1
        self._times_s: Array = np.linspace(0.0, self.duration_s, count)
        places = chain.poses(trajectory.sample(self._times_s))[:, :3]
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        self._lengths_m: Array = np.concatenate([[0.0], np.cumsum(steps)])

    def append_to(self, before: TcpWay | None, at_s: float, from_s: float) -> TcpWay:
        """This path, delayed by `at_s`, appended to the part of the path `before` from `from_s` to `at_s`."""
        found = copy(self)
        found.duration_s = at_s + self.duration_s
        found._times_s = at_s + self._times_s
        if before is not None:
            kept = (before._times_s >= from_s - SAMPLE_S) & (before._times_s < at_s)
            lengths_m = before.length_m(at_s) + self._lengths_m
            found._times_s = np.concatenate([before._times_s[kept], found._times_s])
            found._lengths_m = np.concatenate([before._lengths_m[kept], lengths_m])
        return found

    def length_m(self, path_time_s: float) -> float:
        """Length of the path up to a path time, m."""
        return float(np.interp(path_time_s, self._times_s, self._lengths_m))

    def path_time_s(self, length_m: float) -> float:
        """First path time at which the path has this length, s."""
        return float(np.interp(length_m, *self._increasing()))

    def _increasing(self) -> tuple[Array, Array]:
        """Lengths and times of the path, without those at which the TCP does not move."""
        grows = np.concatenate([[True], np.diff(self._lengths_m) > 0.0])
        return self._lengths_m[grows], self._times_s[grows]


def place_signals(
    segments: Sequence[PathSignals],
    ends_s: Sequence[float],
    way: TcpWay,
    begin_s: float = 0.0,
    *,
    is_cut: bool = False,
) -> Placed:
    """Place the actions and conditions of the motions in a trajectory.

    Args:
        segments: the signals of each motion.
        ends_s: the path time at which each motion ends.
        begin_s: the path time at which the first motion begins.
        is_cut: whether a blend may have cut off the end of a motion. An action in the part that was cut off
            is placed at the end.

    Raises:
        InputError: an action is beyond the end of its motion, there are too many, or a condition is given for
            a motion that cannot have it.
    """
    actions: list[PlacedAction] = []
    conditions: dict[str, Any] = {}
    prefixes = [f"motions[{index}]." if len(segments) > 1 else "" for index in range(len(segments))]
    require_conditions(segments, prefixes)
    for signals, prefix, end_s in zip(segments, prefixes, ends_s, strict=True):
        for action in signals.actions:
            place_s = _path_time_s(action, prefix, (begin_s, end_s), way, is_cut=is_cut)
            path_time_s = min(place_s, way.duration_s)
            actions.append(PlacedAction(len(actions) + 1, path_time_s, action))
        conditions |= _conditions(signals, (begin_s, end_s))
        begin_s = end_s
    if len(actions) > MAX_ACTIONS:
        raise InputError(f"actions: the motion has {len(actions)}, allowed: {MAX_ACTIONS}")
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


def _path_time_s(
    action: Action, prefix: str, part_s: tuple[float, float], way: TcpWay, *, is_cut: bool
) -> float:
    """The path time of an action. The action's position is measured within the part of the path between the
    two path times in `part_s`.
    """
    place, (begin_s, end_s) = action.place, part_s
    begin_m, end_m = way.length_m(begin_s), way.length_m(end_s)
    by_time = place.unit == "time_s" or (place.unit == "fraction" and end_m - begin_m < MIN_LENGTH_M)
    begin, end = (begin_s, end_s) if by_time else (begin_m, end_m)
    if place.unit == "fraction":
        ahead = place.value * (end - begin)
    elif is_cut or place.value <= end - begin:
        ahead = min(place.value, end - begin)
    else:
        unit = "s" if by_time else "m"
        raise InputError(
            f"{prefix}{action.field}.at.{place.unit}: is {place.value:g} {unit}, but the path is "
            f"{end - begin:.4g} {unit} long; give at most this length, or a fraction"
        )
    there = end - ahead if place.from_end else begin + ahead
    if by_time:
        return there
    if there >= end_m:  # at the end, the TCP may only turn, or not move at all
        return end_s
    return min(max(way.path_time_s(there), begin_s), end_s)


def rest_of(
    signals: PathSignals, times_s: Sequence[float], now_s: float, end_s: float, way: TcpWay
) -> PathSignals:
    """The signals for the remaining part of an interrupted motion. The actions keep their positions on the
    path.

    Args:
        times_s: the path time of each action.
        now_s, end_s: the path time at which the arm has stopped, and the path time at which the motion would
            have ended.
    """
    left_m, left_s = way.length_m(end_s) - way.length_m(now_s), end_s - now_s
    by_time = left_m < MIN_LENGTH_M

    def share(path_time_s: float) -> float:
        if by_time:
            ahead = (path_time_s - now_s) / left_s if left_s > 0.0 else 0.0
        else:
            ahead = (way.length_m(path_time_s) - way.length_m(now_s)) / left_m
        return min(max(ahead, 0.0), 1.0)

    actions = tuple(
        replace(action, place=PathPlace("fraction", share(time_s)))
        for action, time_s in zip(signals.actions, times_s, strict=True)
    )
    return replace(signals, actions=actions, start_when=None)


def resting(joints: Array) -> Trajectory:
    """A motion without movement for an arm that is already at its goal, so that the actions and conditions
    are executed.
    """
    coefficients = np.zeros((1, len(joints), 6))
    coefficients[0, :, 0] = joints
    return Trajectory(np.array([0.0, REST_S]), coefficients)
