"""The arms of the stress test: the shipped arm, and four arms that `cobot new-robot` makes from
URDF files.
"""

from __future__ import annotations

import copy
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import independent_models
import numpy as np
import pinocchio

from cobot.config import load_settings
from cobot.launch.new_robot.new_robot import NewRobot
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.model import RobotModel
from cobot.robot.tool import Tool
from cobot.types import Array

Point = tuple[float, float, float]
Joint = tuple[str, Point, Point, tuple[float, float]]
"""Its kind, axis, a point on the axis (with all joints at 0, in the base frame, m), and its range."""
X, Y, Z, BACK, DOWN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)
TURN, SLIDE = "revolute", "prismatic"
SPHERICAL: list[Joint] = [
    (TURN, Z, (0.0, 0.0, 0.1), (-3.1, 3.1)),
    (TURN, Y, (0.15, 0.0, 0.4), (-2.2, 1.6)),
    (TURN, Y, (0.15, 0.0, 0.95), (-2.4, 2.4)),
    (TURN, X, (0.4, 0.0, 1.0), (-3.1, 3.1)),
    (TURN, Y, (0.65, 0.0, 1.0), (-2.1, 2.1)),
    (TURN, X, (0.75, 0.0, 1.0), (-3.1, 3.1)),
]
JOINTS: dict[str, list[Joint]] = {
    "srs": [
        (TURN, Z, (0.0, 0.0, 0.15), (-2.9, 2.9)),
        (TURN, Y, (0.0, 0.0, 0.35), (-2.1, 2.1)),
        (TURN, Z, (0.0, 0.0, 0.5), (-2.9, 2.9)),
        (TURN, BACK, (0.0, 0.0, 0.8), (-2.3, 2.3)),
        (TURN, Z, (0.0, 0.0, 1.0), (-2.9, 2.9)),
        (TURN, Y, (0.0, 0.0, 1.2), (-2.1, 2.1)),
        (TURN, Z, (0.0, 0.0, 1.27), (-2.9, 2.9)),
    ],
    "ur": [
        (TURN, Z, (0.0, 0.0, 0.05), (-6.2, 6.2)),
        (TURN, BACK, (0.0, -0.13, 0.1625), (-6.2, 6.2)),
        (TURN, BACK, (-0.425, -0.01, 0.1625), (-3.1, 3.1)),
        (TURN, BACK, (-0.8172, -0.133, 0.1625), (-6.2, 6.2)),
        (TURN, DOWN, (-0.8172, -0.133, 0.1), (-6.2, 6.2)),
        (TURN, BACK, (-0.8172, -0.18, 0.0628), (-6.2, 6.2)),
    ],
    "spherical": SPHERICAL,
    "gantry": [
        (SLIDE, X, (0.0, 0.0, 0.0), (-0.6, 0.6)),
        (SLIDE, Y, (0.0, 0.0, 0.05), (-0.4, 0.4)),
        *SPHERICAL,
    ],
}  # fmt: skip
TIPS: dict[str, Point] = {
    "srs": (0.0, 0.0, 1.4),
    "ur": (-0.8172, -0.26, 0.0628),
    "spherical": (0.85, 0.0, 1.0),
    "gantry": (0.85, 0.0, 1.0),
}
INERTIA = (("ixx", 0, 0), ("iyy", 1, 1), ("izz", 2, 2), ("ixy", 0, 1), ("ixz", 0, 2), ("iyz", 1, 2))
SHIPPED = "iiwa"
NAMES = (SHIPPED, *JOINTS)
VELOCITY = {TURN: 2.0, SLIDE: 0.5}


@dataclass(frozen=True, slots=True)
class Build:
    """The material of an arm's links, and its drives.

    Attributes:
        thick_m: radius of the links; those of the last three are thin.
        least_kg: mass of a link without length; each metre adds `kg_per_m`.
        inertia: of each link about its middle, kg·m²; None for that of a solid cylinder.
        efforts: of the joints, N·m or N; without them the file does not say.
        damping: N·m·s/rad.
        friction: dry, N·m.
    """

    thick_m: float = 0.05
    thin_m: float = 0.03
    least_kg: float = 0.5
    kg_per_m: float = 4.0
    inertia: float | None = 0.02
    efforts: tuple[float, ...] = ()
    damping: float = 0.0
    friction: float = 0.0


ORDINARY = Build()


@dataclass(frozen=True, slots=True)
class Arm:
    """An arm. `robot` is cobot's description. The other three attributes are pinocchio's model of the same
    URDF, and the ids of its frames `base` and `tcp`.
    """

    name: str
    robot: RobotDescription
    model: pinocchio.Model
    base: int
    tcp: int


@cache
def arm(name: str) -> Arm:
    """The arm with this name, which must be one of `NAMES`."""
    if name == SHIPPED:
        other = independent_models.Pinocchio()
        base = other.model.getFrameId("base_link")
        return Arm(name, load_robot(load_settings(None)), other.model, base, other.tcp)
    with tempfile.TemporaryDirectory() as place:
        file = Path(place) / "arm.urdf"
        file.write_text(urdf(name))
        NewRobot(file).write(Path(place) / name)
        return loaded(name, Path(place) / name)


def loaded(name: str, folder: Path) -> Arm:
    """The arm with this name, which must be one of `JOINTS`, from the folder that `cobot new-robot` has made
    from its URDF.
    """
    return loaded_from(name, folder, pinocchio.buildModelFromXML(urdf(name)), "tool0")


def loaded_from(name: str, folder: Path, model: pinocchio.Model, tcp: str) -> Arm:
    """The arm in a folder that `cobot new-robot` has made, with pinocchio's model of the same arm."""
    robot = load_robot(load_settings(folder / "cobot-setting.yaml"))
    return Arm(name, robot, model, model.getFrameId(robot.base_frame), model.getFrameId(tcp))


def carrying(robot: RobotDescription, tool: Tool) -> RobotDescription:
    """The same robot with a tool. It gets its own model."""
    given = robot.model
    site = given.mj.site(given.tcp_site).name
    model = RobotModel(copy.copy(given.mj), given.limits, robot.base_frame, site, given.spec)
    model.carry(tool)
    return replace(robot, model=model)


def loaded_model(model: pinocchio.Model, frame: int, tool: Tool) -> pinocchio.Model:
    """Pinocchio's model with the tool's mass added to a frame, which is at the flange."""
    flange, loaded = model.frames[frame], model.copy()
    inertia = pinocchio.Inertia(tool.mass, np.array(tool.centre), tool.inertia_matrix)
    loaded.appendBodyToJoint(flange.parentJoint, inertia, flange.placement)
    return loaded


def urdf(name: str) -> str:
    """The URDF of one of `JOINTS`."""
    return description(name, JOINTS[name], TIPS[name])


def description(
    name: str, joints: Sequence[Joint], tip: Point, build: Build = ORDINARY, extra: str = ""
) -> str:
    """The text of a URDF. Each link is a cylinder from its joint to the next joint.

    Args:
        extra: further links and joints.
    """
    parent, before = "base_link", np.zeros(3)
    parts = [f'<robot name="{name}"><link name="base_link"/>']
    places = [np.array(place) for _, _, place, _ in joints] + [np.array(tip)]
    for index, (kind, axis, _, (low, high)) in enumerate(joints):
        place, following = places[index], places[index + 1]
        velocity = VELOCITY[kind]
        radius = build.thick_m if index < len(joints) - 3 else build.thin_m
        effort = build.efforts[index] if build.efforts else 0
        parts.append(f'<link name="link{index + 1}">{_solid(following - place, radius, build)}</link>')
        parts.append(
            f'<joint name="a{index + 1}" type="{kind}"><origin xyz="{_words(place - before)}"/>'
            f'<parent link="{parent}"/><child link="link{index + 1}"/><axis xyz="{_words(axis)}"/>'
            f'<limit lower="{low}" upper="{high}" velocity="{velocity}" effort="{effort:g}"/>'
            f'<dynamics damping="{build.damping:g}" friction="{build.friction:g}"/></joint>'
        )
        parent, before = f"link{index + 1}", place
    parts.append(
        f'<link name="tool0"/><joint name="tip" type="fixed"><origin xyz="{_words(places[-1] - before)}" '
        f'rpy="0 0 0"/><parent link="{parent}"/><child link="tool0"/></joint>'
    )
    return "".join([*parts, extra, "</robot>"])


def _solid(way: Array, radius: float, build: Build) -> str:
    """A cylinder from the link's origin along a vector, with its mass at its centre."""
    length = float(np.linalg.norm(way))
    origin = f'xyz="{_words(0.5 * way)}"'
    pitch, yaw = np.arctan2(np.hypot(way[0], way[1]), way[2]), np.arctan2(way[1], way[0])
    mass = build.least_kg + build.kg_per_m * length
    turning = build.inertia * np.eye(3) if build.inertia else _inertia_of_cylinder(mass, radius, way)
    words = (f'{name}="{turning[i, j]:.6g}"' for name, i, j in INERTIA)
    inertia = f"<inertia {' '.join(words)}/>"
    return (
        f'<inertial><origin {origin}/><mass value="{mass:.4g}"/>{inertia}</inertial>'
        f'<collision><origin {origin} rpy="0 {pitch:.17g} {yaw:.17g}"/><geometry>'
        f'<cylinder radius="{radius}" length="{length:.17g}"/></geometry></collision>'
    )


def _inertia_of_cylinder(mass: float, radius: float, way: Array) -> Array:
    """The inertia of a solid cylinder about its centre, shape (3, 3), kg·m²."""
    length = float(np.linalg.norm(way))
    axis = way / max(length, 1e-9)
    across = mass * (3.0 * radius**2 + length**2) / 12.0
    return across * np.eye(3) + (0.5 * mass * radius**2 - across) * np.outer(axis, axis)


def _words(values: Sequence[float] | Array) -> str:
    return " ".join(f"{float(value):.17g}" for value in values)
