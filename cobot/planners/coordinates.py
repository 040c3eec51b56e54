"""What is limited along a path, and how it changes with the path's parameter: the joints, and the TCP."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cobot.planners.path import Path
from cobot.robot.model import RobotModel
from cobot.types import Array, CartesianLimits, JointLimits

DIFFERENCE = 1e-4
"""The TCP's derivatives are differences over this share of the path."""
STILL, STILL_BESIDE = 1e-9, 1e-4
"""A part of the TCP's motion that is less than these, per unit of the path and beside the other part (rad for
m), is what the joints' path deviates from the line: it is limited in speed alone."""
DIRECTIONS = np.pi / 8.0 * np.array([-3.0, -1.0, 1.0, 3.0])
"""A vector is limited along these directions, rad from its tangent: an octagon within the circle, with
corners on the tangent and on the normal, where it is exact. In between it lacks 8 % at the most."""
NEARLY_STRAIGHT = 0.01
"""Where the normal acceleration at full speed stays below this share of the limit, the tangent alone counts.
"""


@dataclass(frozen=True, slots=True)
class Zones:
    """Limits that change along a path.

    Attributes:
        ends: shape (n,), of the path's parameter: where each zone ends.
        shares: shape (3, n, dof + 2), of the path's limits of velocity, acceleration and jerk: of each joint,
            of the TCP's linear and of its angular ones.
    """

    ends: Array
    shares: Array

    def at(self, places: Array) -> Array:
        """The shares, shape (3, len(places), dof + 2)."""
        return np.asarray(self.shares[:, np.searchsorted(self.ends[:-1], places)])


class Coordinates:
    """The joints, and after them the directions in which the TCP's velocity may change.

    Attributes:
        path, limits: what they are of.
        max_acceleration, max_jerk: shape (m,), of each coordinate, per s² and s³.
    """

    def __init__(
        self,
        model: RobotModel,
        path: Path,
        limits: JointLimits,
        tcp_limits: CartesianLimits | None = None,
        zones: Zones | None = None,
    ) -> None:
        self._model, self.path, self.limits = model, path, limits
        self._zones = zones or Zones(np.array([path.length]), np.ones((3, 1, path.dof + len(PARTS))))
        self._tcp: list[_Tcp] = []
        if tcp_limits is not None:
            places = np.linspace(0.0, path.length, 33)
            twists = _twists(model, path, places)
            rates = (
                (
                    tcp_limits.max_linear_velocity,
                    tcp_limits.max_linear_acceleration,
                    tcp_limits.max_linear_jerk,
                ),
                (
                    tcp_limits.max_angular_velocity,
                    tcp_limits.max_angular_acceleration,
                    tcp_limits.max_angular_jerk,
                ),
            )
            amounts = [float(np.linalg.norm(twists[0, :, part], axis=1).max()) for part in PARTS]
            still = [amount < max(STILL, STILL_BESIDE * max(amounts)) for amount in amounts]
            self._tcp = [
                _Tcp(twists[:, :, part], at_rest, *rate)
                for part, at_rest, rate in zip(PARTS, still, rates, strict=True)
            ]
        self.max_acceleration = np.concatenate(
            [limits.max_acceleration, *(np.full(tcp.rows, tcp.acceleration) for tcp in self._tcp)]
        )
        self.max_jerk = np.concatenate([limits.max_jerk, *(np.full(tcp.rows, tcp.jerk) for tcp in self._tcp)])

    def at(self, places: Array) -> tuple[Array, Array, Array]:
        """At places of the path: the joints and their derivatives by s, shape (4, n, dof); the derivatives of
        all coordinates, (3, n, m); and the least time per s, shape (n,), that the velocities allow."""
        joints = self.path.derivatives(places)
        velocity = self._zones.at(places)[0]
        fastest = self.limits.max_velocity * velocity[:, : self.path.dof]
        slowness = (np.abs(joints[1]) / fastest).max(axis=1, initial=0.0)
        rows = [joints[1:]]
        if self._tcp:
            twists = _twists(self._model, self.path, places)
            for part, tcp, share in zip(PARTS, self._tcp, velocity.T[self.path.dof :], strict=True):
                speed = np.linalg.norm(twists[0, :, part], axis=1)
                slowness = np.maximum(slowness, speed / (tcp.velocity * share))
                rows.append(tcp.projected(twists[:, :, part]))
        return joints, np.concatenate(rows, axis=2), slowness

    @property
    def zones(self) -> int:
        """In how many zones the limits differ."""
        return len(self._zones.ends)

    def shares(self, places: Array) -> Array:
        """Of the limits of velocity, acceleration and jerk there, of each coordinate, shape (3, n, m)."""
        columns = [*range(self.path.dof)]
        for number, tcp in enumerate(self._tcp):
            columns += [self.path.dof + number] * tcp.rows
        return np.asarray(self._zones.at(places)[:, :, columns])


PARTS = (slice(0, 3), slice(3, 6))
"""The linear and the angular part of a twist."""


class _Tcp:
    """The linear or the angular motion of the TCP: a vector whose length is limited.

    Attributes:
        rows: in how many directions it is looked at.
        velocity, acceleration, jerk: its limits, the latter two in each of these directions.
    """

    def __init__(self, twists: Array, still: bool, velocity: float, acceleration: float, jerk: float) -> None:
        _, normal = _frame(twists)
        speed = velocity / np.maximum(np.linalg.norm(twists[0], axis=1), 1e-12)
        bend = np.abs((normal * twists[1]).sum(axis=1)) * speed**2
        straight = still or bend.max() < NEARLY_STRAIGHT * acceleration
        self._directions = np.zeros(0 if still else 1) if straight else DIRECTIONS
        self.rows = len(self._directions)
        inner = 1.0 if straight else np.cos(np.pi / 8.0)
        self.velocity, self.acceleration, self.jerk = velocity, inner * acceleration, inner * jerk

    def projected(self, twists: Array) -> Array:
        """Derivatives, shape (3, n, 3), in the directions between tangent and normal, shape (3, n, rows)."""
        if self.rows == 0:
            return np.zeros((*twists.shape[:2], 0))
        tangent, normal = _frame(twists)
        along, across = (twists * tangent).sum(axis=2), (twists * normal).sum(axis=2)
        return np.asarray(
            along[:, :, None] * np.cos(self._directions) + across[:, :, None] * np.sin(self._directions)
        )


def _frame(twists: Array) -> tuple[Array, Array]:
    """Tangent and normal, shape (n, 3) each; where there is none it is 0."""
    first, second = twists[0], twists[1]
    tangent = first / np.maximum(np.linalg.norm(first, axis=1), 1e-12)[:, None]
    across = second - (second * tangent).sum(axis=1)[:, None] * tangent
    return tangent, across / np.maximum(np.linalg.norm(across, axis=1), 1e-12)[:, None]


def _twists(model: RobotModel, path: Path, places: Array) -> Array:
    """The TCP's velocity per unit of s, and its first two derivatives, shape (3, n, 6)."""
    step = DIFFERENCE * path.length
    middles = np.clip(places, step, path.length - step)
    samples = path.derivatives(np.concatenate([middles - step, middles, middles + step]))
    before, here, after = np.split(model.chain.twists(samples[0], samples[1]), 3)
    return np.array([here, (after - before) / (2.0 * step), (after - 2.0 * here + before) / step**2])
