"""Motions through round corners next to the same motions with stops, and the share of each radius that is
used.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.table import Row, row
from cobot.config import load_settings
from cobot.motions.requests import MotionRequest
from cobot.planners import plan
from cobot.planners.blending.joined import Leg, joined, leg_of
from cobot.planners.blending.prolonged import begin_stretch, extend_stretch
from cobot.robot.description import RobotDescription, load_robot
from cobot.types import Array, PlannerName, Pose, Scaling

RADIUS_M = 0.05
LEAD_S = 0.2
"""For so long nothing may change of the motion under way."""
START = np.array([0.0, 0.5, 0.0, -1.3, 0.0, 1.34, 0.0])
LIN, PTP = PlannerName.LIN, PlannerName.PTP
Step = tuple[PlannerName, Array | Pose, float]


def corners() -> Iterator[Row]:
    """Rectangles of lines, and mixtures of ptp and lin, at several speeds. All corners have the same
    radius.
    """
    robot = load_robot(load_settings(None))
    here = robot.model.forward(START)

    def at(x: float, y: float, z: float) -> Pose:
        return Pose(here.position + np.array([x, y, z]), here.quaternion)

    there = START + np.array([0.5, 0.3, 0.0, 0.2, 0.0, -0.3, 0.0])
    ways = [(0.05, 0.2, 0.0), (0.05, 0.2, -0.2), (0.05, -0.2, -0.2), (0.05, 0.0, 0.0)]
    for speed in (0.1, 0.5, 1.0):
        lines: list[Step] = [(LIN, at(*way), speed) for way in ways]
        mixed: list[Step] = [
            (PTP, there, speed),
            (LIN, at(0.05, 0.2, -0.1), speed),
            (PTP, START, speed),
            (PTP, there, speed),
        ]
        for name, steps in (("lin", lines), ("ptp and lin", mixed)):
            legs = _planned(robot, steps)
            motion = joined(robot, legs, [RADIUS_M] * (len(legs) - 1))
            used = 100.0 * min(motion.used_m) / RADIUS_M
            stops_s = sum(leg.motion.duration_s for leg in legs)
            yield row(
                f"4 motions, {name}, speed {speed:g}, {1e3 * RADIUS_M:g} mm at 3 corners",
                "",
                (motion.trajectory.duration_s, used),
                "stops, all of the radius",
                (stops_s, 100.0),
                columns=("duration, s", "least radius used, %"),
                aim="100 % used",
            )
            on_the_way_s, rounded = _on_the_way(robot, legs)
            yield row(
                f"4 motions, {name}, speed {speed:g}, each joined while the arm moves on the one before",
                "",
                (on_the_way_s, rounded),
                "joined before they begin",
                (motion.trajectory.duration_s, 100.0 * np.mean(motion.blended)),
                columns=("duration, s", "corners without a stop, %"),
            )


def _on_the_way(robot: RobotDescription, legs: list[Leg]) -> tuple[float, float]:
    """The duration of the motions and the number of round corners, if each motion is sent while the arm
    executes the previous one.
    """
    stretch, passed_s, round_corners = begin_stretch(robot, legs[:1], [RADIUS_M]), 0.0, 0
    for number, leg in enumerate(legs[1:], start=2):
        radius_m = RADIUS_M if number < len(legs) else 0.0
        now_s = min(stretch.valid_s, stretch.trajectory.duration_s) + 0.01
        stretch = extend_stretch(robot, stretch, [leg], [radius_m], now_s, now_s + LEAD_S)
        passed_s += stretch.offset_s
        round_corners += stretch.used_m[0] > 0.0
    return passed_s + stretch.trajectory.duration_s, 100.0 * round_corners / (len(legs) - 1)


def _planned(robot: RobotDescription, steps: list[Step]) -> list[Leg]:
    legs, start = [], START
    for planner, goal, speed in steps:
        request = MotionRequest(start, goal, planner, Scaling(speed))
        motion = plan(robot, request)
        assert motion is not None
        legs.append(leg_of(robot, request, motion))
        start = motion.end
    return legs
