"""Cameras in the scene. Ray casting computes their pictures of the arm and its surroundings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from cobot.errors import InputError
from cobot.robot.description import RobotDescription
from cobot.robot.geometry.rays import base_frame, cast, pixels_of, rays_of, view_along
from cobot.robot.rotations import matrix_of
from cobot.types import Array

Vector = tuple[float, float, float]
MAX_PIXELS = 1280 * 960


@dataclass(frozen=True, slots=True)
class Camera:
    """The pose and the properties of a camera.

    Attributes:
        name: name of the camera; letters, digits and underscores.
        eye, target: position of the camera, and the point at which it looks, m, in the frame on which it is
            mounted.
        mounted: base, or tcp if it moves with the TCP.
        up: upward direction in the pictures. It must not be parallel to the viewing direction.
        width, height: size of the pictures in pixels.
        view_rad: vertical field of view, rad.
    """

    name: str
    eye: Vector
    target: Vector
    mounted: Literal["base", "tcp"] = "base"
    up: Vector = (0.0, 0.0, 1.0)
    width: int = 96
    height: int = 72
    view_rad: float = 0.9

    def __post_init__(self) -> None:
        what = f"camera {self.name!r}"
        if not self.name.isidentifier():
            raise InputError(f"{what}: the name must be letters, digits and underscores")
        if self.mounted not in ("base", "tcp"):
            raise InputError(f"{what}: mounted must be base or tcp, got {self.mounted!r}")
        for name, value in (("eye", self.eye), ("target", self.target), ("up", self.up)):
            if len(value) != 3 or not np.isfinite(value).all():
                raise InputError(f"{what}: {name} must be 3 finite numbers, got {value}")
        if self.width < 1 or self.height < 1 or self.width * self.height > MAX_PIXELS:
            raise InputError(
                f"{what}: {self.width} x {self.height} pixels; 1 to {MAX_PIXELS} in total are allowed"
            )
        if not 0.01 <= self.view_rad <= 3.0:
            raise InputError(f"{what}: view_rad must be 0.01 to 3 rad, got {self.view_rad}")
        forward = np.subtract(self.target, self.eye)
        if np.linalg.norm(np.cross(forward, self.up)) < 1e-6:
            raise InputError(
                f"{what}: up must not be parallel to the viewing direction, and target must differ from eye"
            )


FRONT = Camera("front", (1.4, -1.2, 1.0), (0.3, 0.0, 0.4))
WRIST = Camera("wrist", (0.0, -0.1, -0.1), (0.0, 0.0, 0.15), "tcp", (0.0, -1.0, 0.0))
CAMERAS = {camera.name: camera for camera in (FRONT, WRIST)}
"""Two cameras that are useful for any arm, by their names."""


class Renderer:
    """Renders pictures of one robot. Not thread safe."""

    def __init__(self, robot: RobotDescription, cameras: Sequence[Camera]) -> None:
        names = [camera.name for camera in cameras]
        if len(set(names)) < len(names):
            raise InputError(f"each camera needs a different name, got {', '.join(names)}")
        self._robot, self._cameras = robot, tuple(cameras)
        self._mj = robot.model.among(robot.collision.scene, robot.collision.tool)
        self._data = mujoco.MjData(self._mj)
        self._data.qpos[:] = self._mj.qpos0
        self._turn, self._place = base_frame(self._mj, self._data, robot.base_frame)

    def render(self, joints: Array) -> dict[str, np.ndarray]:
        """Each camera's picture while the arm is at the given joint positions (rad): uint8, shape (height,
        width, 3).
        """
        self._data.qpos[:] = joints
        mujoco.mj_kinematics(self._mj, self._data)
        tcp = np.empty(7)
        self._robot.model.forward_into(np.asarray(joints, float), tcp)
        return {camera.name: self._picture(camera, tcp) for camera in self._cameras}

    def _picture(self, camera: Camera, tcp: Array) -> np.ndarray:
        turn, place = self._turn, self._place
        if camera.mounted == "tcp":
            place = place + turn @ tcp[:3]
            turn = turn @ matrix_of(tcp[3:])
        eye = place + turn @ np.array(camera.eye)
        forward = turn @ np.subtract(camera.target, camera.eye)
        view = view_along(forward, turn @ np.array(camera.up))
        rays = rays_of(view, camera.width, camera.height, camera.view_rad)
        return pixels_of(cast(self._mj, self._data, eye, rays), camera.width, camera.height)
