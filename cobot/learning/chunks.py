"""Converts the actions of a policy to timed waypoints, and measures the policy's latency."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from itertools import islice
from typing import Any, Literal

import numpy as np

from cobot.errors import ExecutionError
from cobot.foreign import MAX_NAME, plain_text
from cobot.ipc.layout import CHUNK_POINTS
from cobot.types import Array

ACTIONS = "actions"
MAX_SHOWN = 20
"""Maximum number of keys of an answer that an error message lists."""
Meaning = Literal["positions", "offsets"]


def actions_of(answer: Mapping[str, Any], dof: int, *, fingers: bool = False) -> Array:
    """The actions in a policy's answer. Their shape is (k, dof), or (k, dof + 1) with fingers. Further
    columns are ignored.

    Raises:
        ExecutionError: the actions are missing or invalid; the message describes the content of the answer.
    """
    columns = dof + fingers
    if ACTIONS not in answer:
        there = ", ".join(sorted(plain_text(key, MAX_NAME) for key in islice(answer, MAX_SHOWN))) or "nothing"
        raise ExecutionError(f"the policy's answer has no {ACTIONS!r}; it has {there}")
    try:
        actions = np.asarray(answer[ACTIONS], float)
    except (TypeError, ValueError) as exc:
        raise ExecutionError(f"the policy's {ACTIONS} are not numbers: {plain_text(exc)}") from exc
    if actions.ndim != 2 or not len(actions) or actions.shape[1] < columns:
        raise ExecutionError(
            f"the policy's {ACTIONS} have shape {actions.shape}; a chunk for this arm is (k, {columns}), "
            "with k at least 1, and may have more columns"
        )
    actions = actions[:, :columns]
    if not np.isfinite(actions).all():
        row, column = np.argwhere(~np.isfinite(actions))[0]
        whose = f"joint {column + 1}" if column < dof else "the fingers"
        raise ExecutionError(f"the policy's action {row} is not a finite number for {whose}")
    return actions


def timed(
    actions: Array, observed_s: float, period_s: float, now_s: float, meaning: Meaning, position: Array
) -> tuple[Array, Array]:
    """The waypoints that can still be reached in time, and the time of each.

    Action i is the target i + 1 periods after its observation. The times of the first actions have passed
    while the policy was computing, so these are left out. The others keep their times.

    Args:
        actions: actions, shape (k, n). A row contains the joints, or the joints and the width between the
            fingers, m.
        observed_s: time of the observation, on the robot's clock.
        position: the observed joint positions, rad, to which `offsets` are relative. Widths are never
            offsets.

    Returns:
        Times on the robot's clock, shape (m,), and positions, shape (m, n). m is between 0 and CHUNK_POINTS.
    """
    times_s: Array = observed_s + period_s * np.arange(1.0, len(actions) + 1.0)
    ahead = times_s > now_s
    points = actions.copy()
    if meaning == "offsets":
        points[:, : len(position)] += position
    return times_s[ahead][:CHUNK_POINTS], points[ahead][:CHUNK_POINTS]


class Latency:
    """Recent latencies of a policy, s. A latency is the time from the observation until its chunk is sent."""

    def __init__(self, kept: int = 20) -> None:
        self._kept: deque[float] = deque(maxlen=kept)

    def add(self, taken_s: float) -> None:
        self._kept.append(taken_s)

    @property
    def last_s(self) -> float:
        return self._kept[-1] if self._kept else 0.0

    @property
    def expected_s(self) -> float:
        """An upper estimate of the next latency, s. It is the maximum of the recent latencies."""
        return max(self._kept, default=0.0)
