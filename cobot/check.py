"""`cobot check`: everything that can be known to be wrong before anything moves."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TextIO

from cobot.config import Settings, load_endpoints
from cobot.errors import CobotError, CollisionError
from cobot.limits import check_positions
from cobot.planners import MotionRequest, plan
from cobot.robot import Robot, load_robot
from cobot.types import PlannerName, Scaling, vector


def check(settings: Settings, out: TextIO) -> bool:
    """Validate the configuration, one printed line per item.

    Checks the endpoints file, the model with its limits, and of each named position: limits,
    self-collision, and that a ptp motion leads there from the start position.

    Returns:
        Whether everything is good.
    """
    report = _Report(out)
    report.item(
        "endpoints", lambda: f"{len(load_endpoints(settings.web.endpoints))} in {settings.web.endpoints}"
    )
    robots: list[Robot] = []

    def load() -> str:
        robots.append(load_robot(settings))
        return f"{robots[0].limits.dof} joints, {settings.robot.model}, limits {settings.web.joint_limits}"

    report.item("robot", load)
    for robot in robots:
        for name in robot.positions:
            report.item(f"position {name}", partial(_position, robot, name, settings))
    return report.good


class _Report:
    def __init__(self, out: TextIO) -> None:
        self.good = True
        self._out = out

    def item(self, name: str, examine: Callable[[], str]) -> None:
        try:
            print(f"ok      {name}: {examine()}", file=self._out)
        except CobotError as exc:
            self.good = False
            print(f"FAILED  {name}: {exc}", file=self._out)


def _position(robot: Robot, name: str, settings: Settings) -> str:
    joints = vector(robot.positions[name].joints)
    check_positions(robot.limits, joints)
    contacts = robot.collision.contacts(joints)
    if contacts:
        raise CollisionError(f"{contacts[0].first} touches {contacts[0].second}")
    start = vector(robot.positions[settings.robot.start_position].joints)
    timeout_s = settings.planning.timeout_s
    plan(robot, MotionRequest(start, joints, PlannerName.PTP, Scaling(speed=1.0), None, timeout_s=timeout_s))
    x, y, z = robot.model.forward(joints).position
    return f"within limits, free, reachable; TCP at x {x:.3f} y {y:.3f} z {z:.3f} m in {robot.base_frame}"
