"""Arms of every kind, at any place and with any tool, as cobot has them and as pinocchio does.

Each is given by its axes at rest: directions and a point on each, in its own frame, m.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio
from scipy.spatial.transform import Rotation

from cobot.robot.model import RobotModel
from cobot.types import Array, JointLimits, Pose

X, Y, Z = np.eye(3)
TURN = 2.0 * np.pi
Range = tuple[float, float]


@dataclass(frozen=True)
class SomeArm:
    """One arm: `model` is cobot's, the other two are pinocchio's."""

    model: RobotModel
    other: pinocchio.Model
    data: pinocchio.Data

    def pose(self, joints: Array) -> Pose:
        """Of the TCP in the base frame, by pinocchio."""
        position, turn = self._place(joints)
        return Pose(position, Rotation.from_matrix(turn).as_quat(scalar_first=True))

    def off(self, joints: Array, pose: Pose) -> float:
        """How far pinocchio finds the TCP from a pose, m or rad, whichever is more."""
        position, turn = self._place(joints)
        wanted = Rotation.from_quat(pose.quaternion, scalar_first=True).as_matrix()
        angle = np.linalg.norm(pinocchio.log3(wanted.T @ turn))
        return float(max(np.linalg.norm(position - pose.position), angle))

    def drawn(self, random: np.random.Generator, count: int) -> Array:
        limits = self.model.limits
        return random.uniform(limits.min_position, limits.max_position, (count, limits.dof))

    def _place(self, joints: Array) -> tuple[Array, Array]:
        pinocchio.framesForwardKinematics(self.other, self.data, joints)
        frames = self.data.oMf
        place = frames[self.other.getFrameId("base_link")].inverse() * frames[self.other.getFrameId("tcp")]
        return place.translation, place.rotation


def made(
    axes: Sequence[Array],
    points: Sequence[Array],
    ranges: Sequence[Range],
    folder: Path,
    random: np.random.Generator,
    slides: Sequence[int] = (),
    digits: int = 17,
) -> SomeArm:
    """An arm that stands askew, with a displaced base and TCP; numbers have so many digits."""
    turn, shift = Rotation.random(random_state=random).as_matrix(), random.uniform(-0.5, 0.5, 3)
    directions, places = [turn @ axis for axis in axes], [turn @ point + shift for point in points]

    def words(values: Array) -> str:
        return " ".join(f"{float(value):.{digits}g}" for value in values)

    def link(name: str, parent: str, kind: str, origin: Array, turned: Array, rest: str = "") -> str:
        return (
            f'<link name="{name}"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" '
            f'ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="to_{name}" type="{kind}">'
            f'<origin xyz="{words(origin)}" rpy="{words(turned)}"/><parent link="{parent}"/>'
            f'<child link="{name}"/>{rest}</joint>'
        )

    parts = ['<robot name="arm"><link name="world_link"/>']
    parts.append(
        link("base_link", "world_link", "fixed", random.uniform(-0.4, 0.4, 3), np.array([0.3, -0.2, 1]))
    )
    parent, before = "world_link", np.zeros(3)
    for index, (axis, place) in enumerate(zip(directions, places, strict=True)):
        kind = "prismatic" if index in slides else "revolute"
        low, high = ranges[index]
        rest = f'<axis xyz="{words(axis)}"/><limit lower="{low}" upper="{high}" effort="9" velocity="3"/>'
        parts.append(link(f"j{index}", parent, kind, place - before, np.zeros(3), rest))
        parent, before = f"j{index}", place
    parts.append(link("tcp", parent, "fixed", random.uniform(-0.2, 0.2, 3), random.uniform(-3.0, 3.0, 3)))
    file = folder / "arm.urdf"
    file.write_text("\n".join([*parts, "</robot>"]))
    other = pinocchio.buildModelFromXML(file.read_text())
    low, high = np.array(ranges).T
    ones = np.ones(len(axes))
    names = tuple(f"to_j{index}" for index in range(len(axes)))
    limits = JointLimits(names, low, high, ones, ones, ones, ones)
    return SomeArm(RobotModel.load(file, limits), other, other.createData())


def direction(random: np.random.Generator) -> Array:
    axis = random.normal(size=3)
    return np.asarray(axis / np.linalg.norm(axis))


def points(*rows: Sequence[float]) -> list[Array]:
    return [np.array(row, dtype=float) for row in rows]


Kind = tuple[list[Array], list[Array], list[Range]]


def universal(random: np.random.Generator) -> Kind:
    """Three parallel axes, as Universal Robots' UR5e; most joints turn twice round."""
    at = points(
        (0, 0, 0), (0, 0, 0.1625), (-0.425, 0, 0.1625), (-0.8172, 0, 0.1625), (-0.8172, -0.1333, 0.1625),
        (-0.8172, -0.1333, 0.0628),
    )  # fmt: skip
    return [Z, -Y, -Y, -Y, -Z, -Y], at, [(-TURN, TURN)] * 2 + [(-3.1, 3.1)] + [(-TURN, TURN)] * 3


def turned_back(random: np.random.Generator) -> Kind:
    """Three parallel axes, one of which points the other way, and ranges of less than a turn."""
    axes, at, _ = universal(random)
    return [axes[0], axes[1], -axes[2], *axes[3:]], at, [(-2.9, 2.9)] * 6


def spherical(random: np.random.Generator) -> Kind:
    """A spherical wrist, the shoulder beside the first axis, as large industrial arms have it."""
    wrist = (1.5, 0, 1.95)
    at = points((0, 0, 0), (0.35, 0, 0.8), (0.35, 0, 2.0), wrist, wrist, wrist)
    return [Z, Y, Y, X, Y, X], at, [(-3.2, 3.2), (-2.4, 1.2), (-2.0, 2.7), (-6, 6), (-2.1, 2.1), (-6, 6)]


def skew_wrist(random: np.random.Generator) -> Kind:
    """A spherical wrist whose axes are not at right angles, as painting robots have it."""
    axes, at, _ = spherical(random)
    axes[4] = np.array([np.sin(1.1), np.cos(1.1), 0.0])
    return axes, at, [(-3.0, 3.0)] * 6


def crossing(random: np.random.Generator) -> Kind:
    """A spherical wrist on two axes that meet, and a third in any direction."""
    wrist, shoulder = (0.5, 0.1, 0.8), (0, 0, 0.4)
    at = points(shoulder, shoulder, (0.3, 0.1, 0.9), wrist, wrist, wrist)
    return [Z, direction(random), direction(random), X, Y, X], at, [(-2.9, 2.9)] * 6


def stacked(random: np.random.Generator) -> Kind:
    """A spherical wrist on two parallel upright axes."""
    wrist = (0.9, 0.1, 0.6)
    at = points((0, 0, 0.4), (0.4, 0, 0.5), (0.8, 0.05, 0.5), wrist, wrist, wrist)
    return [Z, -Z, Y, X, Y, Z], at, [(-2.9, 2.9)] * 6


def srs(random: np.random.Generator) -> Kind:
    """S-R-S with axes in any direction and an elbow beside the line."""
    shoulder, elbow, wrist = (0, 0, 0.4), (0.2, 0.1, 0.8), (0.1, 0.05, 1.2)
    at = points(shoulder, shoulder, shoulder, elbow, wrist, wrist, wrist)
    return [direction(random) for _ in range(7)], at, [(-2.8, 2.8)] * 7


def bent(random: np.random.Generator) -> Kind:
    """S-R-S with axes at right angles and an elbow that stops where it is straight."""
    shoulder, elbow, wrist = (0, 0, 0.4), (0, 0, 0.8), (0, 0, 1.2)
    at = points(shoulder, shoulder, shoulder, elbow, wrist, wrist, wrist)
    return [Z, Y, Z, Y, Z, Y, Z], at, [(-2.8, 2.8)] * 3 + [(0.0, 2.5)] + [(-2.8, 2.8)] * 3


def offset_wrist(random: np.random.Generator) -> Kind:
    """Seven axes, and a wrist whose axes do not meet, as Franka's."""
    at = points(
        (0, 0, 0), (0, 0, 0.333), (0, 0, 0.649), (0.0825, 0, 0.649), (0, 0, 1.033), (0, 0, 1.033),
        (0.088, 0, 0.926),
    )  # fmt: skip
    ranges = [
        (-2.9, 2.9),
        (-1.76, 1.76),
        (-2.9, 2.9),
        (-3.07, -0.07),
        (-2.9, 2.9),
        (-0.02, 3.75),
        (-2.9, 2.9),
    ]
    return [Z, Y, Z, -Y, Z, -Y, -Z], at, ranges


def general(dof: int) -> Callable[[np.random.Generator], Kind]:
    """Axes anywhere."""

    def kind(random: np.random.Generator) -> Kind:
        at = list(np.cumsum(random.uniform(-0.3, 0.3, (dof, 3)), axis=0))
        return [direction(random) for _ in range(dof)], at, [(-2.9, 2.9)] * dof

    return kind


def gantry(random: np.random.Generator) -> Kind:
    """Two slides (joints 0 and 1) that carry a six-axis arm."""
    axes, at, ranges = spherical(random)
    return [X, Y, *axes], [*points((0, 0, 0), (0, 0, 0)), *at], [(-1.0, 1.0), (-0.5, 0.5), *ranges]
