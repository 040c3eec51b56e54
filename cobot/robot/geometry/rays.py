"""Rendering without graphics hardware: MuJoCo casts a ray through each pixel."""

from __future__ import annotations

import struct
import zlib

import mujoco
import numpy as np

from cobot.types import Array

LIGHT = np.array([0.4, -0.6, 0.7]) / np.linalg.norm([0.4, -0.6, 0.7])
SKY, FLOOR = np.array([0.93, 0.95, 0.97]), np.array([0.72, 0.74, 0.76])
FAR_M = 100.0


def base_frame(mj: mujoco.MjModel, data: mujoco.MjData, name: str) -> tuple[Array, Array]:
    """The rotation and the position of a body in MuJoCo's world frame."""
    mujoco.mj_kinematics(mj, data)
    base = mj.body(name).id
    return data.xmat[base].reshape(3, 3).copy(), data.xpos[base].copy()


def view_along(forward: Array, up: Array) -> Array:
    """The matrix that converts from the world frame into the view's frame, whose axes are right, down and
    forward.
    """
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(forward, right), forward])


def rays_of(view: Array, width: int, height: int, view_rad: float) -> Array:
    """Unit vectors from the camera through the pixels, row by row, shape (height · width, 3).

    Args:
        view_rad: vertical field of view.
    """
    half = np.tan(view_rad / 2)
    down = np.linspace(-half, half, height)
    across = np.linspace(-half, half, width) * width / height
    grid = np.stack(np.broadcast_arrays(across[None, :], down[:, None], 1.0), axis=-1).reshape(-1, 3)
    return np.asarray(grid / np.linalg.norm(grid, axis=1, keepdims=True) @ view)


def cast(mj: mujoco.MjModel, data: mujoco.MjData, eye: Array, rays: Array) -> Array:
    """The colours of the pixels, 0 to 1, shape (n, 3). `data` gives the positions of the bodies."""
    count = len(rays)
    geoms, distances, normals = np.empty(count, np.int32), np.empty(count), np.empty(3 * count)
    mujoco.mj_multiRay(mj, data, eye, rays.ravel(), None, True, -1, geoms, distances, normals, count, FAR_M)
    plane = mj.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    colours = np.where(plane[:, None], FLOOR, mj.geom_rgba[:, :3])
    light = 0.45 + 0.55 * np.abs(normals.reshape(-1, 3) @ LIGHT)
    return np.where(geoms[:, None] >= 0, colours[geoms] * light[:, None], SKY)


def pixels_of(colours: Array, width: int, height: int) -> np.ndarray:
    """Colours as bytes, shape (height, width, 3)."""
    return (255.0 * colours.clip(0.0, 1.0)).astype(np.uint8).reshape(height, width, 3)


def png(pixels: np.ndarray) -> bytes:
    """A PNG file of pixels, shape (height, width, 3), as specified in ISO/IEC 15948."""
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
