"""What ptp, ompl and chomp plan at a shelf, drawn for `pictures`."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from benchmarks.planning import scenes
from benchmarks.planning.scenes import Box, Problem
from cobot.planners import MotionRequest, plan
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import PlannerName, Scaling

COLOURS = {"ptp, refused": "0.45", "ompl": "tab:blue", "chomp": "tab:orange"}


def draw_clutter(robot: RobotDescription) -> plt.Figure:
    """The TCP's paths, and the nearest distance over time."""
    problem = next(scenes.problems(robot, "shelf", 1, seed=7))
    figure = plt.figure(figsize=(11, 4.5))
    space = figure.add_subplot(1, 2, 1, projection="3d")
    clear = figure.add_subplot(1, 2, 2)
    for box in _boxes(problem):
        space.add_collection3d(Poly3DCollection(_faces(box), alpha=0.12, edgecolor="0.5", linewidth=0.5))
    for name, motion in _motions(problem).items():
        times = np.linspace(0.0, motion.duration_s, 400)
        joints = motion.sample(times)
        space.plot(*problem.robot.model.poses(joints)[:, :3].T, color=COLOURS[name], label=name)
        nearest_m = problem.robot.collision.clearance.distances(joints, 0.2).min(axis=1)
        clear.plot(times, 1e3 * nearest_m, color=COLOURS[name], label=f"{name}: {motion.duration_s:.2f} s")
    space.set(xlabel="x, m", ylabel="y, m", zlabel="z, m", title="Path of the TCP")
    clear.axhline(1e3 * problem.robot.collision.margin_m, color="red", linewidth=0.8)
    clear.set(xlabel="time, s", ylabel="nearest distance, mm", title="Clearance; the margin is red")
    clear.legend()
    return figure


def _motions(problem: Problem) -> dict[str, Trajectory]:
    motions = {}
    for name in ("ptp, refused", "ompl", "chomp"):
        planner = PlannerName(name.split(",")[0])
        request = MotionRequest(problem.start, problem.goal, planner, Scaling(1.0))
        straight = planner is PlannerName.PTP
        motion = plan_ptp(problem.robot, request, problem.goal) if straight else plan(problem.robot, request)
        assert motion is not None
        motions[name] = motion
    return motions


def _boxes(problem: Problem) -> list[Box]:
    mj = problem.robot.model.mj
    names = [mj.geom(index).name for index in range(mj.ngeom)]
    return [
        (*mj.geom_pos[index], *mj.geom_size[index])
        for index, name in enumerate(names)
        if name.startswith("box")
    ]


def _faces(box: Box) -> list[list[list[float]]]:
    x, y, z, a, b, c = box
    faces = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            corners = []
            for first, second in ((-1, -1), (-1, 1), (1, 1), (1, -1)):
                signs = [first, second]
                signs.insert(axis, side)
                corners.append([x + signs[0] * a, y + signs[1] * b, z + signs[2] * c])
            faces.append(corners)
    return faces
