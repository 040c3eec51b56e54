"""The columns of observations and actions: first the joints, then the gripper."""

from __future__ import annotations

from cobot.client.states import GripperReading

SUFFIX = ".pos"
WIDTH = "gripper.pos"
OBSERVED = (WIDTH, "gripper.commanded_pos", "gripper.force", "gripper.held")
"""Columns of the gripper in an observation: widths in m, force in N, and 1 while it holds an object,
otherwise 0.
"""


def observed(reading: GripperReading) -> dict[str, float]:
    """The columns of a gripper reading. Values that the gripper does not report are 0."""
    held = float(reading.object.is_held)
    numbers = (reading.known_width, reading.target_width, reading.known_force, held)
    return dict(zip(OBSERVED, numbers, strict=True))
