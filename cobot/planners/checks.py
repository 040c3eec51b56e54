"""The checks that every plan has to pass."""

from __future__ import annotations

import numpy as np

from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import check_efforts, check_limits
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits

ALREADY_THERE_RAD = 1e-6
TOLERANCE = 1e-9
"""The share of a limit by which a planned motion may exceed it: rounding."""


def validate(
    robot: RobotDescription, trajectory: Trajectory, limits: JointLimits, labels: list[str] | None = None
) -> None:
    """The checks that no motion escapes: limits on true extrema, efforts, self-collision and
    surroundings.

    An arm that stands beyond a limit, because it was pushed there, may move back, but not further out.

    Raises:
        LimitError: from `check_limits` and `check_efforts`.
        CollisionError: from the collision checker.
    """
    check_limits(trajectory, limits.including(trajectory.start), labels, TOLERANCE)
    check_efforts(robot.model, trajectory, limits)
    robot.collision.check_trajectory(trajectory)


def is_there(start: Array, goal: Array) -> bool:
    """Whether there is nothing to move."""
    return bool(np.abs(goal - start).max() < ALREADY_THERE_RAD)
