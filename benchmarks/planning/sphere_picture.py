"""The spheres around the shipped arm, and their verdicts about a box next to it, drawn for `pictures`."""

from __future__ import annotations

import matplotlib.pyplot as plt
import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, FancyBboxPatch, Polygon
from scipy.spatial import ConvexHull

from benchmarks.planning.scenes import Box, among
from cobot.robot.collision import CollisionChecker
from cobot.robot.description import RobotDescription
from cobot.robot.enclosing import tree_around
from cobot.types import Array

JOINTS = np.array([0.0, 0.55, 0.0, -1.52, 0.0, 0.75, 0.0])
"""The arm is in the plane of the picture, rad."""
TOPS = {"Unsure: exact distances decide": 0.385, "Too near: the spheres decide": 0.3985}
"""Heights of the box, m, by the title of the view."""
NEAR = (0.526, 0.684, 0.354, 0.48)
"""Edges of the views of the flange, m: left, right, bottom, top."""
COLOURS = {"free": "#2f6fb0", "unsure": "#f08000", "too near": "#c8102e"}
LINK, SOLID = "#ccd0d6", "#ded3bf"
COARSE = 3
"""Depth of the spheres in the view of the whole arm."""


def draw_spheres(robot: RobotDescription) -> plt.Figure:
    """The whole arm with its spheres, and the spheres that decide next to two boxes."""
    figure, (whole, *views) = plt.subplots(1, 3, figsize=(11, 3.9), width_ratios=(1.15, 1.0, 1.0))
    for axis, (title, top) in zip(views, TOPS.items(), strict=True):
        _draw_flange(axis, among(robot, [_box(top)]).collision, top)
        axis.set(xlim=NEAR[:2], ylim=NEAR[2:], xticks=(0.55, 0.6, 0.65), title=title)
        axis.set(yticks=(0.36, 0.4, 0.44, 0.48))
    top = next(iter(TOPS.values()))
    checker = among(robot, [_box(top)]).collision
    for tree in _draw_solids(whole, checker, top):
        for row in tree[(tree[:, 6] == COARSE) | (_is_smallest(tree) & (tree[:, 6] < COARSE))]:
            _draw_sphere(whole, row, _verdict(row, checker, top))
    whole.set(xlim=(-0.2, 0.92), ylim=(0.0, 0.88), title="Spheres around the links")
    marks = [Line2D([], [], marker="o", linestyle="", color=colour) for colour in COLOURS.values()]
    margin = Line2D([], [], color="0.25", linewidth=0.9, linestyle="--")
    names = [*COLOURS, f"margin of {1e3 * robot.collision.margin_m:.0f} mm around the box"]
    figure.legend([*marks, margin], names, loc="outside lower center", ncols=4, frameon=False)
    figure.set_layout_engine("constrained")
    return figure


def _box(top: float) -> Box:
    return (0.69, 0.0, 0.5 * top, 0.2, 0.2, 0.5 * top)


def _draw_flange(axis: Axes, checker: CollisionChecker, top: float) -> None:
    """The spheres that decide. They must agree with the compiled check."""
    _draw_box(axis, top, checker.margin_m, fill=False, linestyle="--", edgecolor="0.25", linewidth=0.9)
    found = [each for tree in _draw_solids(axis, checker, top) for each in _deciding(tree, checker, top)]
    for row, verdict in sorted(found, key=lambda each: list(COLOURS).index(each[1])):
        _draw_sphere(axis, row, verdict)
    verdicts = {verdict for _, verdict in found}
    answers = checker.clearance.sphere_verdicts(JOINTS[None])
    assert answers is not None
    assert (bool(answers[0][0]), bool(answers[1][0])) == ("too near" in verdicts, verdicts != {"free"})
    distance_m = checker.clearance.distances(JOINTS[None], 1.0).min()
    axis.text(0.605, 0.362, f"exact distance: {1e3 * distance_m:.1f} mm", ha="center", va="center")


def _draw_solids(axis: Axes, checker: CollisionChecker, top: float) -> list[Array]:
    """Draw the arm and the box. Returns the spheres of each geom, rows as those of `cover`, with their
    centres in the base frame.
    """
    _draw_box(axis, top, 0.0, facecolor=SOLID, edgecolor="0.25")
    mj, data, trees = checker.mj, mujoco.MjData(checker.mj), []
    data.qpos[:] = JOINTS
    mujoco.mj_kinematics(mj, data)
    for geom in np.flatnonzero(mj.geom_bodyid):
        turn, place = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]
        outline = (_surface(mj, geom) @ turn.T + place)[:, [0, 2]]
        axis.add_patch(Polygon(outline[ConvexHull(outline).vertices], color=LINK, zorder=1))
        tree = tree_around(mj, geom).copy()
        tree[:, :3] = tree[:, :3] @ turn.T + place
        trees.append(tree)
    axis.set(aspect="equal", xlabel="x, m", ylabel="z, m")
    return trees


def _draw_box(axis: Axes, top: float, wider_m: float, **style: str | float) -> None:
    x, _, _, half, _, _ = _box(top)
    rounded = f"round,pad={wider_m}"
    axis.add_patch(FancyBboxPatch((x - half, 0.0), 2.0 * half, top, boxstyle=rounded, **style))


def _surface(mj: mujoco.MjModel, geom: int) -> Array:
    """Points on the edges of a cylinder, or on the round ends of a capsule, in its own frame, m."""
    radius, half = mj.geom_size[geom][:2]
    angles = np.linspace(0.0, 2.0 * np.pi, 90)
    ring = radius * np.column_stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])
    if mj.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE:
        ring = np.vstack([ring[:, order] for order in ([0, 1, 2], [0, 2, 1], [2, 0, 1])])
    return np.vstack([np.add(ring, (0.0, 0.0, end)) for end in (-half, half)])


def _is_smallest(tree: Array) -> Array:
    return tree[:, 5] == np.arange(len(tree)) + 1


def _deciding(tree: Array, checker: CollisionChecker, top: float) -> list[tuple[Array, str]]:
    """The largest spheres that decide about the box, and the smallest ones that do not."""
    found, index, smallest = [], 0, _is_smallest(tree)
    while index < len(tree):
        row = tree[index]
        verdict = _verdict(row, checker, top)
        is_last = verdict != "unsure" or smallest[index]
        if is_last:
            found.append((row, verdict))
        index = int(row[5]) if is_last else index + 1
    return found


def _verdict(row: Array, checker: CollisionChecker, top: float) -> str:
    """The verdict of one sphere about the box."""
    middle, half = np.split(np.array(_box(top)), 2)
    away = np.linalg.norm(np.maximum(np.abs(row[:3] - middle) - half, 0.0)) - checker.margin_m
    return "free" if away >= row[3] else "too near" if away < row[4] else "unsure"


def _draw_sphere(axis: Axes, row: Array, verdict: str) -> None:
    colour = COLOURS[verdict]
    style = {"facecolor": to_rgba(colour, 0.08), "edgecolor": to_rgba(colour, 0.9), "linewidth": 1.0}
    axis.add_patch(Circle((row[0], row[2]), row[3], zorder=2 + list(COLOURS).index(verdict), **style))
