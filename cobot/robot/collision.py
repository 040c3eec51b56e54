"""Does the arm touch itself or its surroundings? Answered by MuJoCo's collision detection."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from cobot.errors import CollisionError, InputError
from cobot.robot.model import RobotModel
from cobot.trajectory import Trajectory
from cobot.types import Array

CHECK_STEP_RAD = 0.02
"""No joint moves further between two checks of a motion: 16 mm at the tip of a stretched arm, which the
collision margin and the width of the capsules cover."""

MAX_CHECKS = 1_000_000
"""Some seconds' work; more is no motion but a mistake."""


@dataclass(frozen=True, slots=True)
class Contact:
    """Two bodies nearer than the margin; `distance_m` is negative when they overlap."""

    first: str
    second: str
    distance_m: float

    def __str__(self) -> str:
        return f"{self.first} and {self.second} at {1e3 * self.distance_m:.0f} mm"


@dataclass(frozen=True, slots=True)
class Proximity:
    """The distance between two geoms, with the nearest point on each, in the world frame (m)."""

    bodies: tuple[int, int]
    distance_m: float
    points: tuple[Array, Array]


class CollisionChecker:
    """Checks configurations of one robot. Not thread safe: it works in one scratch memory.

    Which pairs of geoms may touch is the model's own rule: contact types and affinities, excluded
    pairs, parent and child.
    """

    def __init__(self, model: RobotModel, margin_m: float = 0.0) -> None:
        self.margin_m = margin_m
        self.limits = model.limits
        # A copy: the margin inflates contacts, and the simulation must not feel that.
        self._mj = copy(model.mj)
        self._mj.geom_margin[:] = margin_m
        self._data = mujoco.MjData(self._mj)
        self.pairs = geom_pairs(self._mj)

    def is_free(self, joints: Array) -> bool:
        """Whether nothing is nearer than the margin. About 5 µs."""
        self._detect(joints)
        return bool(self._data.ncon == 0 or not (self._data.contact.dist < self.margin_m).any())

    def contacts(self, joints: Array) -> list[Contact]:
        """All pairs of bodies nearer than the margin, the deepest first."""
        self._detect(joints)
        found: dict[tuple[str, str], float] = {}
        for contact in self._data.contact:
            if contact.dist < self.margin_m:
                names = self.name(contact.geom1), self.name(contact.geom2)
                found[names] = min(found.get(names, np.inf), float(contact.dist))
        return sorted((Contact(*names, dist) for names, dist in found.items()), key=lambda c: c.distance_m)

    def proximities(self, joints: Array, within_m: float) -> list[Proximity]:
        """The pairs of geoms nearer than `within_m`, with their signed distances."""
        self._data.qpos[:] = joints
        mujoco.mj_kinematics(self._mj, self._data)
        found = []
        segment = np.zeros(6)
        for first, second in self.pairs:
            distance = mujoco.mj_geomDistance(self._mj, self._data, first, second, within_m, segment)
            if distance < within_m:
                bodies = int(self._mj.geom_bodyid[first]), int(self._mj.geom_bodyid[second])
                found.append(Proximity(bodies, distance, (segment[:3].copy(), segment[3:].copy())))
        return found

    def point_jacobian(self, body: int, point: Array) -> Array:
        """Shape (3, dof): velocity of a point fixed to a body, at the configuration last looked at."""
        jacobian = np.zeros((3, self._mj.nv))
        mujoco.mj_comPos(self._mj, self._data)
        mujoco.mj_jac(self._mj, self._data, jacobian, None, point, body)
        return jacobian

    def body_name(self, body: int) -> str:
        return str(self._mj.body(body).name)

    def name(self, geom: int) -> str:
        """What a person calls a geom: its body, or the geom itself if that is part of the world."""
        body = int(self._mj.geom_bodyid[geom])
        return self.body_name(body) if body else str(self._mj.geom(geom).name or "the surroundings")

    def check_trajectory(self, trajectory: Trajectory) -> None:
        """Refuse a motion that comes nearer to anything than the margin.

        Raises:
            CollisionError: naming the bodies, the time, the part of the motion and the joint angles.
            InputError: the motion is too long to be checked.
        """
        times = self._check_times(trajectory)
        for time_s, joints in zip(times, trajectory.sample(times), strict=True):
            if not self.is_free(joints):
                share = time_s / trajectory.duration_s
                raise CollisionError(
                    f"collision of {self.contacts(joints)[0]} after {100 * share:.0f} % of the motion "
                    f"({time_s:.2f} s), at joints {_shown(joints)} rad"
                )

    def check_position(self, joints: Array, what: str) -> None:
        """Refuse a configuration that is not free.

        Raises:
            CollisionError: naming `what` and the bodies.
        """
        contacts = self.contacts(joints)
        if contacts:
            raise CollisionError(f"{what} is in collision: {contacts[0]}, at joints {_shown(joints)} rad")

    def _check_times(self, trajectory: Trajectory) -> Array:
        """Times between which no joint moves further than `CHECK_STEP_RAD`, both ends included."""
        times, speeds = trajectory.speed_bounds(max(2, 200 // trajectory.segments))
        travelled = np.concatenate([[0.0], np.cumsum(speeds * np.diff(times))])
        if not travelled[-1] <= MAX_CHECKS * CHECK_STEP_RAD:
            raise InputError(
                f"the motion travels {travelled[-1]:.4g} rad, "
                f"at the most {MAX_CHECKS * CHECK_STEP_RAD:g} rad can be checked for collisions"
            )
        count = int(np.ceil(travelled[-1] / CHECK_STEP_RAD)) + 1
        return np.asarray(np.interp(np.linspace(0.0, travelled[-1], count + 1), travelled, times))

    def _detect(self, joints: Array) -> None:
        self._data.qpos[:] = joints
        mujoco.mj_kinematics(self._mj, self._data)
        mujoco.mj_collision(self._mj, self._data)


def _shown(joints: Array) -> str:
    return "[" + ", ".join(f"{value:.3f}" for value in joints) + "]"


def geom_pairs(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """The pairs of geoms that MuJoCo's own filter lets collide."""
    excluded = {tuple(sorted((int(s) >> 16, int(s) & 0xFFFF))) for s in model.exclude_signature}
    pairs = []
    for first in range(model.ngeom):
        for second in range(first + 1, model.ngeom):
            bodies = sorted((int(model.geom_bodyid[first]), int(model.geom_bodyid[second])))
            welds = [int(model.body_weldid[body]) for body in bodies]
            parents = [int(model.body_weldid[model.body_parentid[weld]]) for weld in welds]
            affine = (
                model.geom_contype[first] & model.geom_conaffinity[second]
                or model.geom_contype[second] & model.geom_conaffinity[first]
            )
            related = welds[0] == welds[1] or (
                0 not in welds and (welds[0] == parents[1] or welds[1] == parents[0])
            )
            if affine and not related and tuple(bodies) not in excluded:
                pairs.append((first, second))
    return pairs
