"""The columns of observations and actions: first the joints, then the gripper."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from cobot.client.states import GripperReading

SUFFIX = ".pos"
WIDTH = "gripper.pos"
OBSERVED = (WIDTH, "gripper.commanded_pos", "gripper.force", "gripper.held")
"""Columns of the gripper in an observation: widths in m, force in N, and 1 while it holds an object,
otherwise 0.
"""


def observed(reading: GripperReading) -> dict[str, float]:
    """Return the columns of a gripper reading. Values that the gripper does not report are 0."""
    held = float(reading.object.is_held)
    numbers = (reading.known_width, reading.target_width, reading.known_force, held)
    return dict(zip(OBSERVED, numbers, strict=True))


def targets(action: Mapping[str, Any], features: Mapping[str, Any]) -> dict[str, float]:
    """Return the numbers of an action, one for each feature.

    Raises:
        ValueError: a feature is missing or not a finite number.
    """
    missing = [name for name in features if name not in action]
    if missing:
        raise ValueError(f"the action has no {missing[0]!r}; it needs {', '.join(features)}")
    found = {name: float(action[name]) for name in features}
    for name, value in found.items():
        if not math.isfinite(value):
            raise ValueError(f"{name} of the action is {value}; it must be a finite number")
    return found
