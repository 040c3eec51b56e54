"""Tasks of episodes: additional observations, and rewards."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from gymnasium import spaces

from cobot.errors import CollisionError, InputError
from cobot.robot.description import RobotDescription
from cobot.types import Array

TRIES = 100


class Task(Protocol):
    """Interface of a task. Random numbers must come from the generator that `reset` gets, so that a seed
    defines an episode.
    """

    def spaces(self) -> dict[str, spaces.Space[Any]]:
        """For each observation that the task adds: its name and its space."""
        ...

    def reset(self, robot: RobotDescription, start: Array, random: np.random.Generator) -> None:
        """Begin an episode, in which the arm starts at `start`, rad."""
        ...

    def observe(self) -> dict[str, Array]:
        """The additional observations of the task."""
        ...

    def judge(self, observation: dict[str, Any]) -> tuple[float, bool]:
        """The reward, and whether the episode is done."""
        ...


class Reach:
    """The task to move the TCP to a target. The target is the TCP's position in a random posture of the arm.

    The reward is minus the distance in metres, and 1 when the target is reached.

    Args:
        spread_rad: maximum distance of each joint in this posture from the start, rad.
        near_m: distance at which the target is reached, m.
    """

    def __init__(self, spread_rad: float = 0.5, near_m: float = 0.02) -> None:
        if not 0.0 < spread_rad <= 3.0 or not 0.0 < near_m <= 1.0:
            raise InputError(
                f"Reach: spread_rad must be above 0 and at most 3 rad, near_m above 0 and at most 1 m; "
                f"got {spread_rad} and {near_m}"
            )
        self._spread_rad, self._near_m = spread_rad, near_m
        self._goal = np.zeros(3)

    def spaces(self) -> dict[str, spaces.Space[Any]]:
        return {"goal": spaces.Box(-3.0, 3.0, (3,), np.float64)}

    def reset(self, robot: RobotDescription, start: Array, random: np.random.Generator) -> None:
        limits = robot.limits
        for _ in range(TRIES):
            away = random.uniform(-self._spread_rad, self._spread_rad, limits.dof)
            posture = (start + away).clip(limits.min_position, limits.max_position)
            self._goal = robot.model.forward(posture).position
            try:
                robot.collision.check_position(posture, "a goal")
            except CollisionError:
                continue
            return

    def observe(self) -> dict[str, Array]:
        return {"goal": self._goal.copy()}

    def judge(self, observation: dict[str, Any]) -> tuple[float, bool]:
        away_m = float(np.linalg.norm(observation["tcp_pose"][:3] - self._goal))
        return (1.0, True) if away_m < self._near_m else (-away_m, False)
