"""The limited quantities of the joints and the TCP along a path, and their derivatives by the
path parameter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cobot.planners.derivatives import coordinates_at, speeds_and_bends
from cobot.planners.timing.path import JointCurve
from cobot.robot.model import RobotModel
from cobot.types import Array, CartesianLimits, JointLimits

LOOKS = 33
"""Number of points of the path. The TCP motion at these points decides the directions in which it
is limited.
"""
STILL, STILL_BESIDE = 1e-9, 1e-4
"""Values for the linear and the angular TCP motion: the first is per unit of the path, the second is relative
to the other of the two motions, rad per m. A motion below these values is only the deviation of the joint
path from the line. Then only its speed is limited.
"""
DIRECTIONS = np.pi / 8.0 * np.array([-3.0, -1.0, 1.0, 3.0])
"""Directions along which a vector is limited, as angles from its tangent, rad. These limits form an
octagon within the circle. The octagon is exact at its corners, on the tangent and the normal. In between
it is up to 8 % too strict.
"""
NEARLY_STRAIGHT = 0.01
"""If the normal acceleration at full speed is below this share of its limit, only the acceleration along the
tangent is limited.
"""


@dataclass(frozen=True, slots=True)
class Zones:
    """Limits that change along a path.

    Attributes:
        ends: path parameter at the end of each zone, shape (n,).
        shares: shares of the path's velocity, acceleration and jerk limits, for each joint and for the linear
            and the angular TCP motion, shape (3, n, dof + 2).
    """

    ends: Array
    shares: Array

    def at(self, places: Array) -> Array:
        """The shares at the given places on the path, shape (3, len(places), dof + 2)."""
        return np.asarray(self.shares[:, np.searchsorted(self.ends[:-1], places)])


class Coordinates:
    """The limited quantities: the joints, then the directions in which the TCP's velocity may change.

    Attributes:
        path, limits: the path and the joint limits.
        zones: the zones of the path: a single one if the limits do not change.
        max_acceleration, max_jerk: limits of each coordinate, shape (m,), per s² and per s³.
    """

    def __init__(
        self,
        model: RobotModel,
        path: JointCurve,
        limits: JointLimits,
        tcp_limits: CartesianLimits | None = None,
        zones: Zones | None = None,
    ) -> None:
        self._chain, self.path, self.limits = model.chain, path, limits
        self.zones = zones or Zones(np.array([path.length]), np.ones((3, 1, path.dof + PARTS)))
        self._tcp: list[_Tcp] = []
        if tcp_limits is not None:
            places = np.linspace(0.0, path.length, LOOKS)
            speeds, bends = speeds_and_bends(model.chain, path.derivatives(places)).swapaxes(0, 1)
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
            amounts = speeds.max(axis=1)
            still = amounts < max(STILL, STILL_BESIDE * float(amounts.max()))
            self._tcp = [
                _Tcp(speed, bend, bool(at_rest), *rate)
                for speed, bend, at_rest, rate in zip(speeds, bends, still, rates, strict=True)
            ]
        velocities = [tcp.velocity for tcp in self._tcp] or [np.inf] * PARTS
        self._max_velocity = np.append(limits.max_velocity, velocities)
        self._columns = [*range(path.dof)]
        for number, tcp in enumerate(self._tcp):
            self._columns += [path.dof + number] * len(tcp.directions)
        self.max_acceleration, self.max_jerk = (
            np.append(of_joints, of_tcp)[self._columns]
            for of_joints, of_tcp in (
                (limits.max_acceleration, [tcp.acceleration for tcp in self._tcp]),
                (limits.max_jerk, [tcp.jerk for tcp in self._tcp]),
            )
        )

    def at(self, places: Array) -> tuple[Array, Array, Array]:
        """Evaluate the path at points.

        Returns:
            The joints and their derivatives by s, shape (4, n, dof); the derivatives of all coordinates,
            shape (3, n, m); and the shortest time per s that the velocity limits allow, shape (n,).
        """
        joints = self.path.derivatives(places)
        fastest = self._max_velocity * self.zones.at(places)[0]
        rows, slowness = coordinates_at(self._chain, joints, fastest, [tcp.directions for tcp in self._tcp])
        return joints, rows, slowness

    def shares(self, places: Array) -> Array:
        """Shares of the velocity, acceleration and jerk limits, for each coordinate at each given point.
        Shape: (3, n, m).
        """
        return np.asarray(self.zones.at(places)[:, :, self._columns])


PARTS = 2
"""Number of parts of the TCP's motion: the linear and the angular motion."""


class _Tcp:
    """The linear or angular TCP motion: a vector whose length is limited.

    Attributes:
        directions: directions in which the vector is limited, rad from its tangent towards its normal.
        velocity, acceleration, jerk: limits. The limits of acceleration and jerk hold in each of these
            directions.
    """

    def __init__(
        self, speeds: Array, bends: Array, still: bool, velocity: float, acceleration: float, jerk: float
    ) -> None:
        """
        Args:
            speeds, bends: values at some points of the path, per s and per s², shape (n,) each; see
                `speeds_and_bends`.
        """
        bend = bends * (velocity / np.maximum(speeds, 1e-12)) ** 2
        straight = still or bend.max() < NEARLY_STRAIGHT * acceleration
        self.directions = np.zeros(0 if still else 1) if straight else DIRECTIONS
        inner = 1.0 if straight else np.cos(np.pi / 8.0)
        self.velocity, self.acceleration, self.jerk = velocity, inner * acceleration, inner * jerk
