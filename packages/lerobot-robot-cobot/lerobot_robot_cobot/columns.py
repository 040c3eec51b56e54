"""The columns of observations and actions: the joints, and then the gripper."""

from __future__ import annotations

from cobot.client.states import GripperReading

SUFFIX = ".pos"
WIDTH = "gripper.pos"
OBSERVED = (WIDTH, "gripper.commanded_pos", "gripper.force", "gripper.held")
"""The gripper in an observation: widths, m; N; 1 while it holds an object, else 0."""


def observed(reading: GripperReading) -> dict[str, float]:
    """The columns of a reading. What the gripper does not know is 0."""
    held = float(reading.object.is_held)
    numbers = (reading.known_width, reading.target_width, reading.known_force, held)
    return dict(zip(OBSERVED, numbers, strict=True))
