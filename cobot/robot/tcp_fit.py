"""Computation of a tool's TCP from poses in which the tip of the tool touches one fixed point."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cobot.errors import InputError
from cobot.pose import Pose
from cobot.types import Array

MIN_POSES, MAX_POSES = 4, 20
MIN_SPREAD = 0.1
"""Minimum spread of the flange's orientations. Below it, an error in the poses causes a tenfold error in the
TCP.
"""
MIN_TILT_DEG = 20.0
"""Tilt between the poses that messages recommend. It is larger than the tilt that `MIN_SPREAD` requires."""


@dataclass(frozen=True, slots=True)
class TcpFit:
    """A TCP that fits poses of the flange.

    Attributes:
        tcp: TCP position in the flange's frame, shape (3,), m.
        point: the touched point in the base frame, shape (3,), m.
        errors_m: distance of the tip from that point in each pose, m.
    """

    tcp: Array
    point: Array
    errors_m: tuple[float, ...]

    @property
    def error_m(self) -> float:
        """Root mean square of the distances, m."""
        return math.sqrt(sum(each * each for each in self.errors_m) / len(self.errors_m))


def fit_tcp(flanges: Sequence[Pose]) -> TcpFit:
    """Find the TCP by least squares: the point in the flange's frame that moves least from pose to pose.

    Args:
        flanges: flange poses in the base frame. In all of them the tip touches the same point.

    Raises:
        InputError: there are too few or too many poses, or their orientations do not determine the TCP.
    """
    if not MIN_POSES <= len(flanges) <= MAX_POSES:
        raise InputError(f"points: {len(flanges)} are given, allowed: {MIN_POSES} to {MAX_POSES}")
    rotations = np.array([each.rotation for each in flanges])
    positions = np.array([each.position for each in flanges])
    # In each pose, rotation @ tcp + position = point. Subtracting the mean of these equations removes the
    # point.
    turned = (rotations - rotations.mean(axis=0)).reshape(-1, 3)
    moved = (positions - positions.mean(axis=0)).ravel()
    _, spreads, directions = np.linalg.svd(turned / math.sqrt(len(flanges)), full_matrices=False)
    if spreads[1] < MIN_SPREAD:
        raise InputError(
            "points: the flange has nearly the same orientation in all of them, so they do not "
            f"determine the TCP; turn the flange by {MIN_TILT_DEG:g}° or more between them, about two "
            "different axes"
        )
    if spreads[2] < MIN_SPREAD:
        axis = directions[2] * np.sign(directions[2][np.argmax(np.abs(directions[2]))])
        x, y, z = np.round(axis, 2) + 0.0  # avoids a -0
        raise InputError(
            f"points: the flange turns about one axis only, ({x:.2f}, {y:.2f}, {z:.2f}) in its own frame, so "
            f"they do not determine the TCP along it; turn the flange by {MIN_TILT_DEG:g}° or more about "
            "another axis too"
        )
    tcp = np.linalg.lstsq(turned, -moved, rcond=None)[0]
    tips = rotations @ tcp + positions
    point = tips.mean(axis=0)
    return TcpFit(tcp, point, tuple(float(each) for each in np.linalg.norm(tips - point, axis=1)))
