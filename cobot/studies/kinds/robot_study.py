"""The base of studies that try parameters on one robot."""

from __future__ import annotations

from functools import cached_property

from cobot.robot.description import RobotDescription
from cobot.studies.parameters.sampled import SampledStudy
from cobot.studies.robot_choice import RobotChoice, hashes_of


class RobotStudy(SampledStudy):
    """A study over a space of parameters, whose tasks need a robot."""

    metric: str
    robot: RobotChoice = RobotChoice()

    @property
    def measure(self) -> str:
        return self.metric

    @cached_property
    def description(self) -> RobotDescription:
        """The robot in its scene. A kernel may modify this object during a computation."""
        return self.robot.load()

    def contents(self) -> dict[str, str]:
        return hashes_of(self.description)
