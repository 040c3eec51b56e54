"""`python -m benchmarks.planning.pictures FOLDER [NAME...]`: draws all or some of the pictures in
docs/planning.md.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from benchmarks.planning import scenes
from benchmarks.planning.clutter_picture import draw_clutter
from benchmarks.planning.sphere_picture import draw_spheres
from cobot.config import load_settings
from cobot.errors import CobotError
from cobot.motions.constraints import Box, Cone, Constraints
from cobot.motions.requests import Arc, MotionRequest
from cobot.planners import plan
from cobot.planners.blending.joined import joined, leg_of
from cobot.planners.path.lin import straight_line
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import RobotDescription, load_robot
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, Pose, Scaling, Synchronization

FULL = Scaling(1.0)
DPI = 72
WORK = np.array([0.0, 0.6, 0.0, -1.4, 0.0, 1.1416, 0.0])
NEAR_SINGULAR = (
    np.array([2.66, 1.0181, -1.3849, 0.0279, -2.3634, 0.7365, -0.7479]),
    Pose(np.array([-0.776, 0.3592, 0.507]), np.array([0.61633, 0.29657, -0.16455, -0.71071])),
)
"""A line that begins near a singularity."""
SHARES, ANGLES = np.linspace(0.0, 1.0, 161), np.linspace(-np.pi, np.pi, 181)
UPRIGHT_RAD = 0.1
CORNER_START = np.array([0.0, 0.5, 0.0, -1.3, 0.0, 1.34, 0.0])
CORNER_WAYS = ((0.0, 0.2, 0.0), (0.0, 0.2, -0.2))


def main() -> None:
    folder, robot = Path(sys.argv[1]), load_robot(load_settings(None))
    for name in sys.argv[2:] or PICTURES:
        figure = PICTURES[name](robot)
        if figure.get_layout_engine() is None:
            figure.tight_layout()
        figure.savefig(folder / f"planning-{name}.png", dpi=DPI)
        plt.close(figure)


def motion_of(robot: RobotDescription, request: MotionRequest) -> Trajectory:
    motion = plan(robot, request)
    assert motion is not None
    return motion


def draw_ptp(robot: RobotDescription) -> plt.Figure:
    """One motion, in time and in phase: velocities, and two joints against each other."""
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.4))
    goal = WORK + np.array([1.0, -0.5, 0.25, 0.3, 0.7, -0.4, 1.6])
    for axis, kind in zip(axes, (Synchronization.TIME, Synchronization.PHASE), strict=False):
        motion = motion_of(
            robot, replace(MotionRequest(WORK, goal, PlannerName.PTP, FULL), synchronization=kind)
        )
        times = np.linspace(0.0, motion.duration_s, 400)
        axis.plot(times, motion.sample(times, 1) / robot.limits.max_velocity, linewidth=1.0)
        axis.set(
            xlabel="time, s",
            ylabel="velocity / its limit",
            title=f"synchronization {kind}",
            ylim=(-0.6, 1.1),
        )
        rows = motion.sample(times)
        axes[2].plot(rows[:, 2], rows[:, 6], label=str(kind))
    axes[2].set(xlabel="joint 3, rad", ylabel="joint 7, rad", title="path")
    axes[2].legend()
    return figure


def draw_lin(robot: RobotDescription) -> plt.Figure:
    """The arm angle along a line on which the nearest joint positions reach a limit, and along a line near a
    singularity.
    """
    figure, (angle, speed) = plt.subplots(1, 2, figsize=(11, 4))
    request, reason = _needs_the_redundancy(robot)
    motion, arm = motion_of(robot, request), robot.model.inverse_kinematics.arm_angle
    assert arm is not None
    assert isinstance(request.goal, Pose)
    first = robot.model.forward(request.start)
    grid = arm.grid(straight_line(first, request.goal).poses(SHARES), ANGLES)
    nodes = grid[:, :, arm.of(request.start)[1]]
    good = ~np.isnan(nodes).any(axis=2)
    good[good] = robot.collision.clearance.are_free(nodes[good])
    angle.pcolormesh(SHARES, ANGLES, good.T, cmap="Greys_r", vmin=-1.0, vmax=1.0, shading="nearest")
    rows = motion.sample(np.linspace(0.0, motion.duration_s, 300))
    way = request.goal.position - first.position
    shares = (robot.model.poses(rows)[:, :3] - first.position) @ way / (way @ way)
    angle.plot(shares, [arm.of(row)[0] for row in rows], color="tab:blue", label="as planned")
    angle.set(xlabel="share of the line", ylabel="arm angle, rad", title=f"white: possible\n{reason}")
    angle.title.set_fontsize(8)
    angle.legend()
    _line_near_a_singularity(robot, speed)
    return figure


def _needs_the_redundancy(robot: RobotDescription) -> tuple[MotionRequest, str]:
    """A line that the arm cannot follow if each joint position is the one nearest to the previous one, and
    the reason.
    """
    from cobot.planners.path.continued import continued

    random, limits = np.random.default_rng(8), robot.limits
    while True:
        start = random.uniform(limits.min_position, limits.max_position)
        here = robot.model.forward(start)
        way = random.normal(size=3)
        goal = Pose(here.position + 0.5 * way / np.linalg.norm(way), here.quaternion)
        _, error = continued(robot, start, straight_line(here, goal))
        reason = str(error or "")
        request = MotionRequest(start, goal, PlannerName.LIN, FULL)
        if "limit" in reason and _possible(robot, request):
            return request, f"without the redundancy {reason.removeprefix('lin: ')}"


def _possible(robot: RobotDescription, request: MotionRequest) -> bool:
    try:
        return plan(robot, request) is not None
    except CobotError:
        return False


def _line_near_a_singularity(robot: RobotDescription, axis: Axes) -> None:
    start, goal = NEAR_SINGULAR
    motion = motion_of(robot, MotionRequest(start, goal, PlannerName.LIN, FULL))
    times = np.linspace(0.0, motion.duration_s, 600)
    used = np.abs(motion.sample(times, 1)) / robot.limits.max_velocity
    fastest = int(used.max(axis=0).argmax())
    speeds = np.linalg.norm(
        robot.model.chain.twists(motion.sample(times), motion.sample(times, 1))[:, :3], axis=1
    )
    axis.plot(times, speeds, label="TCP, m/s")
    axis.plot(times, used[:, fastest], label=f"{robot.limits.names[fastest]}, share of its velocity")
    axis.set(xlabel="time, s", title=f"a line from a singularity on: {motion.duration_s:.2f} s (was 22.3 s)")
    axis.legend()


def draw_paths(robot: RobotDescription) -> plt.Figure:
    """A circle, a helix, and a polyline with three radii."""
    figure = plt.figure(figsize=(11, 3.8))
    space = figure.add_subplot(1, 3, 1, projection="3d")
    plane, speed = figure.add_subplot(1, 3, 2), figure.add_subplot(1, 3, 3)
    here = robot.model.forward(WORK)
    for rise, name in ((0.0, "full circle"), (0.25, "helix, three turns")):
        turns = 1.0 if rise == 0.0 else 3.0
        given = Arc(
            here.position + np.array([0.0, 0.1, 0.0]), np.array([0.0, 0.0, 1.0]), turns * 2 * np.pi, rise
        )
        motion = motion_of(robot, MotionRequest(WORK, here, PlannerName.CIRC, FULL, arc=given))
        space.plot(*_way(robot, motion).T, label=f"{name}, {motion.duration_s:.1f} s")
    space.set(title="circ", xlabel="x, m", ylabel="y, m", zlabel="z, m")
    space.legend(fontsize=7)
    corners = [(0.0, 0.25), (-0.15, 0.25), (-0.15, -0.2), (0.05, -0.2)]
    poses = [Pose(here.position + np.array([x, y, 0.0]), here.quaternion) for x, y in corners]
    for radius in (0.0, 0.02, 0.06):
        request = MotionRequest(
            WORK, poses[-1], PlannerName.POLYLINE, FULL, through=tuple(poses[:-1]), radius_m=radius
        )
        motion = motion_of(robot, request)
        way = _way(robot, motion)
        label = f"radius {1e3 * radius:g} mm, {motion.duration_s:.2f} s"
        plane.plot(way[:, 1], way[:, 0], linewidth=1.2, label=label)
        times = np.linspace(0.0, motion.duration_s, len(way))
        moved = np.linalg.norm(np.diff(way, axis=0), axis=1) / np.diff(times)
        speed.plot(times[1:], moved, linewidth=1.0)
    plane.set(xlabel="y, m", ylabel="x, m", title="polyline", aspect="equal")
    plane.legend(fontsize=7)
    speed.set(xlabel="time, s", ylabel="speed of the TCP, m/s", title="polyline")
    return figure


def _way(robot: RobotDescription, motion: Trajectory) -> Array:
    return np.asarray(robot.model.poses(motion.sample(np.linspace(0.0, motion.duration_s, 900)))[:, :3])


def draw_auto(robot: RobotDescription) -> plt.Figure:
    """The same request with and without an obstacle."""
    figure, axes = plt.subplots(1, 2, figsize=(11, 3.4), sharey=True)
    left, right = WORK.copy(), WORK.copy()
    left[0], right[0] = -0.9, 0.9
    post = scenes.among(robot, [(0.6, 0.0, 0.25, 0.05, 0.05, 0.25)])
    for axis, there, name in zip(axes, (robot, post), ("nothing", "a post"), strict=True):
        request = MotionRequest(left, right, PlannerName.AUTO, FULL)
        taken = motion_of(there, request)
        direct = plan_ptp(there, replace(request, planner=PlannerName.PTP), right)
        for motion, label, style in ((direct, "ptp", "--"), (taken, "auto", "-")):
            times = np.linspace(0.0, motion.duration_s, 300)
            nearest = there.collision.clearance.distances(motion.sample(times), 0.25).min(axis=1)
            axis.plot(times, 1e3 * nearest, style, label=f"{label}, {motion.duration_s:.2f} s")
        axis.axhline(1e3 * there.collision.margin_m, color="red", linewidth=0.8)
        note = taken.note.split(" at joints")[0]
        title = "\n".join([f"{name} in the way: {note[:60]}", note[60:150]])
        axis.set(xlabel="time, s", title=title)
        axis.title.set_fontsize(8)
        axis.legend()
    axes[0].set(ylabel="nearest distance, mm")
    return figure


def draw_constraints(robot: RobotDescription) -> plt.Figure:
    """The tool's tilt on the way around a post, with and without a cone."""
    figure, (tilt, top) = plt.subplots(1, 2, figsize=(11, 3.6))
    there = scenes.among(robot, [(0.6, 0.0, 0.3, 0.05, 0.05, 0.3)])
    left, right = WORK.copy(), WORK.copy()
    left[0], right[0] = -0.9, 0.9
    request = MotionRequest(left, right, PlannerName.OMPL, FULL)
    cone = Constraints(Cone(np.array([0.0, 0.0, 1.0]), UPRIGHT_RAD))
    upright = there.model.chain.solve(left)[1][:, 2].copy()
    for name, asked in (("ompl", request), ("ompl, upright", replace(request, constraints=cone))):
        motion = motion_of(there, asked)
        times = np.linspace(0.0, motion.duration_s, 500)
        rows = motion.sample(times)
        axes = np.array([there.model.chain.solve(row)[1][:, 2].copy() for row in rows])
        tilt.plot(times, np.arccos(np.clip(axes @ upright, -1.0, 1.0)), label=name)
        way = there.model.poses(rows)[:, :3]
        top.plot(way[:, 1], way[:, 2], label=f"{name}, {motion.duration_s:.2f} s")
    tilt.axhline(UPRIGHT_RAD, color="red", linewidth=0.8)
    tilt.set(
        xlabel="time, s", ylabel="tilt of the tool, rad", title="red: what constraints.orientation allows"
    )
    box = np.array([(-0.05, 0.0), (-0.05, 0.6), (0.05, 0.6), (0.05, 0.0)])
    for begin, end in pairwise(box):
        top.plot(*np.array([begin, end]).T, color="0.5")
    top.set(xlabel="y, m", ylabel="z, m", title="path of the TCP, and the post")
    tilt.legend()
    top.legend()
    return figure


def draw_corners(robot: RobotDescription) -> plt.Figure:
    """Two lines: with a stop, with a radius, and with a radius that a constraint reduces."""
    figure, (plane, speed) = plt.subplots(1, 2, figsize=(9, 3.6))
    here = robot.model.forward(CORNER_START)
    corner, end = (Pose(here.position + np.array(way), here.quaternion) for way in CORNER_WAYS)
    box = Box(here.position - np.array([0.3, 0.3, 0.006]), here.position + 0.3)
    for radius_m, held, name in (
        (0.0, None, "a stop"),
        (0.05, Constraints(box=box), "50 mm, the first line held above -6 mm"),
        (0.05, None, "50 mm"),
    ):
        first = MotionRequest(CORNER_START, corner, PlannerName.LIN, FULL, constraints=held)
        legs = [leg_of(robot, first, motion_of(robot, first))]
        second = MotionRequest(legs[0].motion.end, end, PlannerName.LIN, FULL)
        legs.append(leg_of(robot, second, motion_of(robot, second)))
        motion = joined(robot, legs, [radius_m]).trajectory
        way = _way(robot, motion)
        plane.plot(way[:, 1], way[:, 2], linewidth=1.2, label=name)
        times = np.linspace(0.0, motion.duration_s, len(way))
        moved = np.linalg.norm(np.diff(way, axis=0), axis=1) / np.diff(times)
        speed.plot(times[1:], moved, linewidth=1.0, label=f"{motion.duration_s:.2f} s")
    plane.add_patch(plt.Circle(corner.position[1:], 0.05, fill=False, linestyle=":", color="0.5"))
    plane.set(xlabel="y, m", ylabel="z, m", title="path of the TCP, and the radius", aspect="equal")
    plane.legend(fontsize=7, loc="lower left")
    speed.set(xlabel="time, s", ylabel="speed of the TCP, m/s", title="two lines of 0.2 m")
    speed.legend(fontsize=7)
    return figure


PICTURES = {
    "ptp": draw_ptp,
    "lin": draw_lin,
    "paths": draw_paths,
    "corners": draw_corners,
    "clutter": draw_clutter,
    "spheres": draw_spheres,
    "auto": draw_auto,
    "constraints": draw_constraints,
}


if __name__ == "__main__":
    main()
