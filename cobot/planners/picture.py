"""A picture of a motion: the arm at its end, faintly at its start, and the path of its TCP.

MuJoCo casts a ray through each pixel, so no graphics hardware is needed.
"""

from __future__ import annotations

from itertools import pairwise

import mujoco
import numpy as np

from cobot.robot.description import RobotDescription
from cobot.robot.geometry.rays import base_frame, cast, pixels_of, png, rays_of, view_along
from cobot.types import Array

WIDTH, HEIGHT = 480, 360
VIEW_RAD = 0.75
"""Vertical field of view."""
EYE = np.array([0.75, -1.0, 0.55])
"""Direction from which the camera looks, in the base frame: from the front, the right and above."""
PATH = np.array([0.05, 0.35, 0.85])
UP = np.array([0.0, 0.0, 1.0])
GHOST = 0.3
DOT = 1
"""Half width of the dots that draw the path, in pixels."""
AROUND_M = 0.45
"""Margin around the base and the path."""


def picture(robot: RobotDescription, joints: Array, poses: Array) -> bytes:
    """Render a PNG file.

    Args:
        joints: joints along the motion, shape (n, dof), rad.
        poses: TCP poses for these joints, in the base frame, shape (n, 7).
    """
    checker = robot.collision
    mj = robot.model.among(checker.scene, checker.tool)
    data = mujoco.MjData(mj)
    data.qpos[:] = mj.qpos0
    turn, place = base_frame(mj, data, robot.base_frame)
    seen = np.vstack([poses[:, :3], np.zeros((1, 3))]) @ turn.T + place
    low, high = seen.min(axis=0) - AROUND_M, seen.max(axis=0) + AROUND_M
    middle = 0.5 * (low + high)
    eye = middle + turn @ EYE / np.linalg.norm(EYE) * np.linalg.norm(high - low) / (
        2.0 * np.tan(VIEW_RAD / 2)
    )
    to_view = view_along(middle - eye, UP)
    rays = rays_of(to_view, WIDTH, HEIGHT, VIEW_RAD)
    last, first = (_cast(mj, data, each, eye, rays) for each in (joints[-1], joints[0]))
    image = (1.0 - GHOST) * last + GHOST * first
    _draw(image, _dense(seen[:-1]) - eye, to_view)
    return png(pixels_of(image, WIDTH, HEIGHT))


def _cast(mj: mujoco.MjModel, data: mujoco.MjData, joints: Array, eye: Array, rays: Array) -> Array:
    """The colours of the pixels, shape (n, 3)."""
    data.qpos[:] = joints
    mujoco.mj_kinematics(mj, data)
    return cast(mj, data, eye, rays)


def _dense(points: Array) -> Array:
    """The points of a line, with points added between them so that the line has no gaps."""
    steps = np.linspace(0.0, 1.0, 20, endpoint=False)[:, None]
    pieces = [a + steps * (b - a) for a, b in pairwise(points)]
    return np.vstack([*pieces, points[-1:]])


def _draw(image: Array, away: Array, view: Array) -> None:
    """Colour the pixels of points. The points are given relative to the camera. Points behind the arm are
    also visible.
    """
    across, down, ahead = view @ away.T
    half = np.tan(VIEW_RAD / 2)
    columns = np.rint((across / ahead / half * HEIGHT / WIDTH + 1.0) / 2.0 * (WIDTH - 1)).astype(int)
    rows = np.rint((down / ahead / half + 1.0) / 2.0 * (HEIGHT - 1)).astype(int)
    pixels = image.reshape(HEIGHT, WIDTH, 3)
    for row, column in zip(rows, columns, strict=True):
        pixels[max(row - DOT, 0) : row + DOT + 1, max(column - DOT, 0) : column + DOT + 1] = PATH
