"""The robot of a study: its settings, surrounding objects and tool, and hashes of their content."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import mujoco
import numpy as np
from pydantic import Field, TypeAdapter, ValidationError

from cobot.config import Location, Settings, load_settings
from cobot.errors import ConfigError, InputError
from cobot.foreign import plain_error
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.kept import read_kept
from cobot.robot.scene import Scene, SceneFile, SceneObject
from cobot.robot.tool import BARE, Tool, ToolFile, check_tool
from cobot.strict import StrictModel, unknown_key
from cobot.types import Array, NamedPosition, Numbers3, Numbers7

SIZES = {"box": 3, "sphere": 1, "cylinder": 2, "capsule": 2}
LENGTH_TOLERANCE = 1e-3
"""Maximum difference of a quaternion's length from 1."""
Positive = Annotated[float, Field(gt=0.0, le=100.0, allow_inf_nan=False)]
_POSITIONS = TypeAdapter(dict[str, NamedPosition])
Finite = Annotated[float, Field(ge=-100.0, le=100.0, allow_inf_nan=False)]


class StudyObject(StrictModel):
    """A solid around the robot; see `cobot.robot.scene.SceneObject`.

    Attributes:
        pose: x, y, z (m) and w, x, y, z of its centre in the base frame.
    """

    shape: Annotated[str, Field(pattern="^(box|sphere|cylinder|capsule)$")]
    size: Annotated[list[Positive], Field(min_length=1, max_length=3)]
    pose: Annotated[list[Finite], Field(min_length=7, max_length=7)]

    def solid(self, name: str) -> SceneObject:
        """The object for a scene.

        Raises:
            InputError: the size or the pose does not match the shape.
        """
        if len(self.size) != SIZES[self.shape]:
            raise InputError(
                f"robot.objects.{name}.size: a {self.shape} has {SIZES[self.shape]} numbers, "
                f"got {len(self.size)}"
            )
        pose = numbers7(self.pose, f"robot.objects.{name}.pose")
        return SceneObject(self.shape, tuple(self.size), pose)  # type: ignore[arg-type]


class StudyTool(StrictModel):
    """A tool on the flange; see `cobot.robot.tool.Tool`."""

    mass: Annotated[float, Field(ge=0.0, le=1000.0, allow_inf_nan=False)] = 0.0
    centre: Annotated[list[Finite], Field(min_length=3, max_length=3)] = Field(
        default_factory=lambda: [0.0, 0.0, 0.0]
    )
    tcp: Annotated[list[Finite], Field(min_length=7, max_length=7)] | None = None

    def tool(self) -> Tool:
        """The tool with the given values.

        Raises:
            InputError: the quaternion of the TCP's pose is not a unit quaternion.
        """
        tcp = None if self.tcp is None else numbers7(self.tcp, "robot.tool.tcp")
        return Tool(version=1, mass=self.mass, centre=numbers3(self.centre), tcp=tcp)


class RobotChoice(StrictModel):
    """The robot of a study, with the objects around it and the tool on its flange.

    Attributes:
        settings: settings file; None means the settings that are part of cobot.
        name: name of a robot of the settings; None means the default robot.
        scene: file with a scene, as the service keeps it.
        objects: further objects, by name.
        tool_file: file with the tool, as the service keeps it; for a robot without `tool`.
        positions: file with taught positions, as the service keeps it.
    """

    settings: Location | None = None
    name: str | None = None
    scene: Location | None = None
    objects: dict[str, StudyObject] = Field(default_factory=dict)
    tool: StudyTool | None = None
    tool_file: Location | None = None
    positions: Location | None = None

    def load_settings(self) -> Settings:
        """Read the settings.

        Raises:
            ConfigError: the settings are invalid or contain no robot with this name.
        """
        whole = load_settings(self.settings)
        each = {settings.robot.name: settings for settings in whole.robots or (whole,)}
        if self.name is None:
            return whole
        if self.name not in each:
            raise ConfigError(f"robot.name: {unknown_key(self.name, list(each), 'robot')}")
        return each[self.name]

    def load(self) -> RobotDescription:
        """The robot with its tool, in its scene.

        Raises:
            CobotError: a file is invalid, or the robot rejects the tool or the objects.
        """
        settings = self.load_settings()
        robot = load_robot(settings)
        scene, tool = self._scene(), self.carried()
        if tool != BARE:
            check_tool(tool, settings.robot.max_payload_kg, robot.model.file_gravity)
        robot = replace(robot, positions=self._taught() | robot.positions)
        for name in self.objects:
            if name in robot.model.frame_names:
                raise InputError(
                    f"robot.objects.{name}: is the name of a part of the robot; rename the object"
                )
        robot.model.carry(tool, scene)
        robot.collision.surround(scene, tool)
        return robot

    def carried(self) -> Tool:
        """The tool on the flange.

        Raises:
            ConfigError, InputError: the tool is invalid.
        """
        if self.tool is not None:
            return self.tool.tool()
        tool = BARE if self.tool_file is None else ToolFile(self.tool_file).read()
        return tool if tool == BARE else replace(tool, version=1)  # the number of its changes does not matter

    def _taught(self) -> dict[str, NamedPosition]:
        if self.positions is None:
            return {}
        try:
            return _POSITIONS.validate_json(read_kept(self.positions))
        except (OSError, ValidationError) as exc:
            raise ConfigError(
                f"robot.positions: {self.positions}: cannot be read: {plain_error(exc)}"
            ) from exc

    def _scene(self) -> Scene:
        if self.scene is not None and not self.scene.is_file():
            raise ConfigError(f"robot.scene: {self.scene}: no such file")
        scene = Scene() if self.scene is None else SceneFile(self.scene).read()
        solids = {name: each.solid(name) for name, each in self.objects.items()}
        twice = sorted(scene.objects.keys() & solids.keys())
        if twice:
            raise InputError(f"robot.objects.{twice[0]}: is also in {self.scene}; rename one of them")
        return replace(scene, version=0, loads=0, objects=scene.objects | solids)


def hashes_of(robot: RobotDescription) -> dict[str, str]:
    """Hashes of a robot's content, by readable names. The paths of its files do not matter."""
    limits = robot.limits
    rates = (limits.max_velocity, limits.max_acceleration, limits.max_jerk, limits.max_effort)
    ranges = (limits.min_position, limits.max_position)
    checker = robot.collision
    return {
        "model of the robot": _hash(_compiled(robot.model.mj)),
        "joint limits": _hash(*(np.ascontiguousarray(each).tobytes() for each in (*ranges, *rates))),
        "planning limits": _hash(repr((robot.cartesian_limits, checker.margin_m)).encode()),
        "named positions": _hash(repr(sorted(robot.positions.items())).encode()),
        "allowed contacts": _hash(repr(sorted(map(sorted, checker.disabled))).encode()),
        "scene": _hash(repr(checker.scene).encode()),
        "tool": _hash(repr(checker.tool).encode()),
    }


def _compiled(mj: mujoco.MjModel) -> bytes:
    content = np.empty(mujoco.mj_sizeModel(mj), np.uint8)
    mujoco.mj_saveModel(mj, None, content)
    return content.tobytes()


def hash_of_file(path: Path) -> str:
    """Hash of a file's content.

    Raises:
        ConfigError: the file cannot be read.
    """
    try:
        return _hash(path.read_bytes())
    except OSError as exc:
        raise ConfigError(f"{path}: cannot be read: {exc.strerror}") from exc


def _hash(*parts: bytes) -> str:
    whole = hashlib.sha256(json.dumps([len(part) for part in parts]).encode())
    for part in parts:
        whole.update(part)
    return whole.hexdigest()


def numbers3(values: list[float]) -> Numbers3:
    x, y, z = map(float, values)
    return x, y, z


def numbers7(values: list[float], place: str) -> Numbers7:
    """Check seven numbers: a position and a unit quaternion.

    Raises:
        InputError: the length of the quaternion is not 1.
    """
    turn: Array = np.array(values[3:], dtype=float)
    length = float(np.linalg.norm(turn))
    if abs(length - 1.0) > LENGTH_TOLERANCE:
        raise InputError(f"{place}: the quaternion w, x, y, z has length {length:.4g}; it must be 1")
    x, y, z, *_ = map(float, values)
    w, i, j, k = (turn / length).tolist()
    return x, y, z, w, i, j, k


def joints_at(robot: RobotDescription, where: str | list[float], place: str) -> Array:
    """Joint angles of a named position or a list, rad.

    Raises:
        InputError: the position does not exist, or the list has the wrong number of joints.
    """
    if isinstance(where, str):
        if where not in robot.positions:
            raise InputError(f"{place}: {unknown_key(where, list(robot.positions), 'position')}")
        return np.array(robot.positions[where].joints, dtype=float)
    if len(where) != robot.limits.dof:
        raise InputError(f"{place}: has {len(where)} angles, but the arm has {robot.limits.dof} joints")
    return np.array(where, dtype=float)
