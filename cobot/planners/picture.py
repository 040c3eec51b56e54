"""A picture of a motion: the arm where it ends, faintly where it begins, and the way of its TCP.

MuJoCo casts a ray through each pixel, so that it needs no graphics of the computer.
"""

from __future__ import annotations

import struct
import zlib
from itertools import pairwise

import mujoco
import numpy as np

from cobot.robot.description import RobotDescription
from cobot.types import Array

WIDTH, HEIGHT = 480, 360
VIEW_RAD = 0.75
"""The angle from the top of the picture to its bottom."""
EYE = np.array([0.75, -1.0, 0.55])
"""From what is looked at, in the base frame: from the front, the right and above."""
LIGHT = np.array([0.4, -0.6, 0.7]) / np.linalg.norm([0.4, -0.6, 0.7])
SKY, PATH, FLOOR = np.array([0.93, 0.95, 0.97]), np.array([0.05, 0.35, 0.85]), np.array([0.72, 0.74, 0.76])
GHOST = 0.3
DOT = 1
"""The path's dots are so many pixels wide to each side."""
FAR_M = 100.0
AROUND_M = 0.45
"""What is seen around the base and the path."""


def picture(robot: RobotDescription, joints: Array, poses: Array) -> bytes:
    """A PNG file.

    Args:
        joints: along the motion, shape (n, dof), rad.
        poses: of the TCP there, in the base frame, shape (n, 7).
    """
    checker = robot.collision
    mj = robot.model.among(checker.scene, checker.tool)
    data = mujoco.MjData(mj)
    data.qpos[:] = mj.qpos0
    turn, place = _base(robot, mj, data)
    seen = np.vstack([poses[:, :3], np.zeros((1, 3))]) @ turn.T + place
    low, high = seen.min(axis=0) - AROUND_M, seen.max(axis=0) + AROUND_M
    middle = 0.5 * (low + high)
    eye = middle + turn @ EYE / np.linalg.norm(EYE) * np.linalg.norm(high - low) / (
        2.0 * np.tan(VIEW_RAD / 2)
    )
    rays, to_view = _rays(middle - eye)
    last, first = (_cast(mj, data, each, eye, rays) for each in (joints[-1], joints[0]))
    image = (1.0 - GHOST) * last + GHOST * first
    _draw(image, _dense(seen[:-1]) - eye, to_view)
    return _png((255.0 * image.clip(0.0, 1.0)).astype(np.uint8).reshape(HEIGHT, WIDTH, 3))


def _base(robot: RobotDescription, mj: mujoco.MjModel, data: mujoco.MjData) -> tuple[Array, Array]:
    """Rotation and place of the base frame in MuJoCo's world."""
    mujoco.mj_kinematics(mj, data)
    base = mj.body(robot.base_frame).id
    return data.xmat[base].reshape(3, 3).copy(), data.xpos[base].copy()


def _rays(forward: Array) -> tuple[Array, Array]:
    """Unit vectors through the pixels, row by row, shape (n, 3), and the matrix from the world into the view:
    right, down, forward."""
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    view = np.array([right, np.cross(forward, right), forward])
    half = np.tan(VIEW_RAD / 2)
    down = np.linspace(-half, half, HEIGHT)
    across = np.linspace(-half, half, WIDTH) * WIDTH / HEIGHT
    grid = np.stack(np.broadcast_arrays(across[None, :], down[:, None], 1.0), axis=-1).reshape(-1, 3)
    return grid / np.linalg.norm(grid, axis=1, keepdims=True) @ view, view


def _cast(mj: mujoco.MjModel, data: mujoco.MjData, joints: Array, eye: Array, rays: Array) -> Array:
    """The colours of the pixels, shape (n, 3)."""
    data.qpos[:] = joints
    mujoco.mj_kinematics(mj, data)
    count = len(rays)
    geoms, distances, normals = np.empty(count, np.int32), np.empty(count), np.empty(3 * count)
    mujoco.mj_multiRay(mj, data, eye, rays.ravel(), None, True, -1, geoms, distances, normals, count, FAR_M)
    plane = mj.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    colours = np.where(plane[:, None], FLOOR, mj.geom_rgba[:, :3])
    light = 0.45 + 0.55 * np.abs(normals.reshape(-1, 3) @ LIGHT)
    return np.where(geoms[:, None] >= 0, colours[geoms] * light[:, None], SKY)


def _dense(points: Array) -> Array:
    """The points of a line and others between them, so that it has no gaps."""
    steps = np.linspace(0.0, 1.0, 20, endpoint=False)[:, None]
    pieces = [a + steps * (b - a) for a, b in pairwise(points)]
    return np.vstack([*pieces, points[-1:]])


def _draw(image: Array, away: Array, view: Array) -> None:
    """Colour the pixels of points, given from the eye: also of those behind the arm, for who looks wants to
    know where they are."""
    across, down, ahead = view @ away.T
    half = np.tan(VIEW_RAD / 2)
    columns = np.rint((across / ahead / half * HEIGHT / WIDTH + 1.0) / 2.0 * (WIDTH - 1)).astype(int)
    rows = np.rint((down / ahead / half + 1.0) / 2.0 * (HEIGHT - 1)).astype(int)
    pixels = image.reshape(HEIGHT, WIDTH, 3)
    for row, column in zip(rows, columns, strict=True):
        pixels[max(row - DOT, 0) : row + DOT + 1, max(column - DOT, 0) : column + DOT + 1] = PATH


def _png(pixels: np.ndarray) -> bytes:
    """A file of pixels, shape (height, width, 3), as the PNG specification (ISO/IEC 15948) has it."""
    height, width, _ = pixels.shape

    def chunk(kind: bytes, content: bytes) -> bytes:
        whole = kind + content
        return struct.pack(">I", len(content)) + whole + struct.pack(">I", zlib.crc32(whole))

    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", head)
        + chunk(b"IDAT", zlib.compress(rows, 6))
        + chunk(b"IEND", b"")
    )
