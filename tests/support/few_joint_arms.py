"""Small arms of a few joints, each a chain of axes, and their kinematics by plain numpy."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from cobot.robot.collision import CollisionChecker
from cobot.robot.description import RobotDescription
from cobot.robot.model import RobotModel
from cobot.types import Array, CartesianLimits, JointLimits

X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
DOWN = np.array([0.0, 0.0, 1.0, 0.0])
"""The tool's z axis points down; w, x, y, z."""


@dataclass(frozen=True, slots=True)
class Chain:
    """Hinges: `ways` leads from each of them to the next one, and from the last one to the TCP, m."""

    axes: tuple[tuple[float, float, float], ...]
    ways: tuple[tuple[float, float, float], ...]

    def tcp(self, joints: Array) -> tuple[Array, Array]:
        """Position, m, and rotation matrix of the TCP at joint angles, rad: the product of the turns."""
        place, turn = np.zeros(3), np.eye(3)
        for axis, way, angle in zip(self.axes, self.ways, joints, strict=True):
            turn = turn @ Rotation.from_rotvec(angle * np.array(axis)).as_matrix()
            place = place + turn @ np.array(way)
        return place, turn


def up(*heights: float) -> tuple[tuple[float, float, float], ...]:
    """Ways along z, m."""
    return tuple((0.0, 0.0, height) for height in heights)


FIVE = Chain((Z, Y, Y, Z, Y), up(0.2, 0.3, 0.15, 0.15, 0.2))
"""The fourth joint turns the forearm, the fifth bends the hand."""
ROLLING = Chain((Z, Y, Y, Y, Z), up(0.1, 0.3, 0.3, 0.1, 0.08))
"""As hobby arms: three parallel axes, and the hand turns about itself."""
FOUR = Chain((Z, Y, Y, Y), up(0.1, 0.3, 0.3, 0.1))
SCARA = Chain((Z, Z, Z), ((0.3, 0.0, 0.2), (0.25, 0.0, 0.0), (0.0, 0.0, -0.1)))
SIX = Chain((Z, Y, Y, Z, Y, Z), up(0.3, 0.3, 0.15, 0.15, 0.08, 0.06))
SEVEN = Chain(
    (Z, Y, Z, Y, Z, Y, Z),
    (*up(0.3, 0.2), (0.05, 0.0, 0.2), *up(0.2, 0.2), (0.09, 0.0, 0.0), *up(0.08)),
)
"""Seven joints and an offset wrist: there is no arm angle."""


def robot_of(chain: Chain, reach_rad: float = 2.9, radius_m: float | None = 0.03) -> RobotDescription:
    """With so thick links, or without any shape, and the joints' limits as far as `reach_rad` both ways."""
    dof = len(chain.axes)
    names = tuple(f"joint{number}" for number in range(1, dof + 1))
    bodies, closing, place = "", "", (0.0, 0.0, 0.0)
    for name, axis, way in zip(names, chain.axes, chain.ways, strict=True):
        shape = ""
        if radius_m is not None and np.linalg.norm(way) > 0.05:
            ends = " ".join(f"{share * part:.6f}" for share in (0.3, 0.7) for part in way)
            shape = f'<geom type="capsule" fromto="{ends}" size="{radius_m}" mass="0"/>'
        bodies += (
            f'<body name="{name}_link" pos="{_words(place)}">'
            f'<joint name="{name}" axis="{_words(axis)}" range="{-reach_rad} {reach_rad}" limited="true"/>'
            f'<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>{shape}'
        )
        closing += "</body>"
        place = way
    tip = f'<site name="tcp" pos="{_words(place)}"/>'
    spec = mujoco.MjSpec.from_string(
        f'<mujoco><compiler angle="radian"/><worldbody><body name="base_link">{bodies}{tip}{closing}</body>'
        "</worldbody></mujoco>"
    )
    ones = np.ones(dof)
    limits = JointLimits(
        names, -reach_rad * ones, reach_rad * ones, 2.0 * ones, 8.0 * ones, 80.0 * ones, 200.0 * ones
    )
    model = RobotModel(spec.compile(), limits, "base_link", "tcp", spec)
    tcp_limits = CartesianLimits(1.0, 4.0, 40.0, 2.0, 8.0, 80.0)
    return RobotDescription(
        "few", "base_link", model, CollisionChecker(model, 0.005), model.limits, tcp_limits, {}
    )


def _words(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:.9g}" for value in values)
