"""Closed paths that are planned once and executed repeatedly: the deviation of the joints at the end, and of
the TCP.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from benchmarks.table import Row, row
from benchmarks.virtual import rig
from cobot.config import load_settings
from cobot.motions.requests import Arc, MotionRequest
from cobot.planners import plan
from cobot.robot.description import RobotDescription, load_robot
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, Pose, Scaling

START = np.array([0.2, 0.5, -0.3, -1.3, 0.4, 0.9, 0.1])
FULL = Scaling(1.0)
RADIUS_M = 0.1
CORNERS_M = np.array([[0.0, 0.12, 0.0], [0.0, 0.12, 0.1], [0.0, 0.0, 0.1]])
AWAY_M = np.array([-0.1, 0.15, -0.1])
COLUMNS = ("joints off after the last run, rad", "TCP off its path, mm")


def repeats(times: int) -> Iterator[Row]:
    """Each path, executed this number of times on the virtual clock, next to one execution that need not be
    closed.
    """
    robot = load_robot(load_settings(None))
    for name in ("circle", "square", "line and back"):
        closed, open_ = paths(robot, name, cyclic=True), paths(robot, name, cyclic=False)
        yield row(
            f"closed paths: {name}, {times} runs of one plan",
            "",
            run(robot, closed, name, times),
            "one run without cyclic or end_joints",
            run(robot, open_, name, 1),
            columns=COLUMNS,
            aim="1e-6 rad, 0.05 mm",
        )


def paths(robot: RobotDescription, name: str, *, cyclic: bool) -> list[Trajectory]:
    """The plans that lead from the start back to the start, one after the other."""
    here = pose_at(robot, START)
    if name == "circle":
        arc = Arc(here.position - [RADIUS_M, 0.0, 0.0], np.array([0.0, 0.0, 1.0]), 2.0 * np.pi)
        return [planned(robot, MotionRequest(START, here, PlannerName.CIRC, FULL, arc=arc, cyclic=cyclic))]
    if name == "square":
        through = tuple(Pose(here.position + way, here.quaternion) for way in CORNERS_M)
        square = MotionRequest(START, here, PlannerName.POLYLINE, FULL, through=through, cyclic=cyclic)
        return [planned(robot, square)]
    there = Pose(here.position + AWAY_M, here.quaternion)
    away = planned(robot, MotionRequest(START, there, PlannerName.LIN, FULL))
    back = MotionRequest(away.end, here, PlannerName.LIN, FULL)
    return [away, planned(robot, replace(back, end_joints=START) if cyclic else back)]


def planned(robot: RobotDescription, request: MotionRequest) -> Trajectory:
    trajectory = plan(robot, request)
    assert trajectory is not None
    return trajectory


def pose_at(robot: RobotDescription, joints: Array) -> Pose:
    pose = robot.model.chain.poses(joints[None])[0]
    return Pose(pose[:3], pose[3:])


def run(robot: RobotDescription, plans: Sequence[Trajectory], name: str, times: int) -> tuple[float, float]:
    """The largest deviation of all commands: of the joints, rad, and of the TCP, mm."""
    with rig(start=START) as arm:
        for _ in range(times):
            for each in plans:
                refusal = arm.start(each)
                assert not refusal, refusal
                arm.run()
        commanded = np.array(arm.commanded)
    positions = robot.model.chain.poses(commanded)[:, :3]
    off_rad = float(np.abs(commanded[-1] - START).max())
    return off_rad, 1e3 * float(off_path(positions, pose_at(robot, START).position, name).max())


def off_path(positions: Array, start: Array, name: str) -> Array:
    """The distance of each position, (n, 3), from the path, m."""
    if name == "circle":
        away = positions - (start - [RADIUS_M, 0.0, 0.0])
        off: Array = np.hypot(np.linalg.norm(away[:, :2], axis=1) - RADIUS_M, away[:, 2])
        return off
    corners = [start, *(start + CORNERS_M), start] if name == "square" else [start, start + AWAY_M]
    legs = [off_line(positions, *ends) for ends in pairwise(corners)]
    nearest: Array = np.min(legs, axis=0)
    return nearest


def off_line(positions: Array, begin: Array, end: Array) -> Array:
    way = end - begin
    share = np.clip((positions - begin) @ way / (way @ way), 0.0, 1.0)
    away: Array = np.linalg.norm(positions - begin - share[:, None] * way, axis=1)
    return away
