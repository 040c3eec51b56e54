"""Selects an arm's inverse kinematics from the geometry of its axes, never from its name."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from cobot.errors import InputError
from cobot.robot.chain import Chain
from cobot.robot.inverse_kinematics.arm import Arm
from cobot.robot.inverse_kinematics.six_axis import SixAxisArm
from cobot.robot.inverse_kinematics.srs import SrsArm
from cobot.types import FREE_AXES, Array, FreeAxis, JointLimits

POSE_DOF, POSTURES, NONE_FREE = 6, 4, -1
MAX_SLOP = 1e-4
"""Axes are treated as meeting if their distance is less than this, m, and as parallel if their angle is less
than this, rad, because files are rounded. Solutions stay exact, because a few numeric steps refine the closed
form.
"""


class Axes:
    """The joint axes at one joint position, in the base frame.

    Attributes:
        directions, points: unit vector along each axis, and a point on it, m, shape (dof, 3) each. The point
            of a linear joint is 0.
        hinges: whether each joint is a rotary joint.
        slop: the largest deviation that the queries have tolerated so far, m or rad.
    """

    def __init__(self, chain: Chain, rest: Array) -> None:
        tcp, _, jacobian = chain.solve(rest)
        linear, angular = jacobian[:3].T, jacobian[3:].T
        self.hinges = np.linalg.norm(angular, axis=1) > 0.5
        self.directions = np.where(self.hinges[:, None], angular, linear).copy()
        self.points = np.where(self.hinges[:, None], tcp - np.cross(linear, angular), 0.0)
        self.tcp = tcp.copy()
        self.slop = 0.0

    def meet(self, *joints: int) -> Array | None:
        """The point where the axes intersect, shape (3,); None if they do not intersect."""
        projections = [np.eye(3) - np.outer(self.directions[j], self.directions[j]) for j in joints]
        feet = sum(projection @ self.points[j] for projection, j in zip(projections, joints, strict=True))
        matrix = np.sum(projections, axis=0)
        if np.linalg.eigvalsh(matrix)[0] < 1e-6:  # the axes are parallel
            return None
        point: Array = np.linalg.solve(matrix, feet)
        off = max(
            float(np.linalg.norm(projection @ (point - self.points[j])))
            for projection, j in zip(projections, joints, strict=True)
        )
        return point if self._accept(off) else None

    def parallel(self, *joints: int) -> bool:
        first = self.directions[joints[0]]
        off = max(float(np.linalg.norm(np.cross(first, self.directions[j]))) for j in joints[1:])
        return self._accept(off)

    def reach(self) -> float:
        """The largest possible distance of the TCP from the point on the first axis, m; infinite for an arm
        with linear joints.
        """
        if not self.hinges.all():
            return np.inf
        places = [*self.points, self.tcp]
        return float(sum(np.linalg.norm(after - before) for before, after in pairwise(places)))

    def _accept(self, off: float) -> bool:
        if off < MAX_SLOP:
            self.slop = max(self.slop, off)
        return off < MAX_SLOP


def recognised(chain: Chain, limits: JointLimits, rest: Array, free: Sequence[FreeAxis] = ()) -> Arm:
    """The inverse kinematics of an arm: in closed form if its geometry permits, otherwise numeric.

    Args:
        rest: joint positions, shape (dof,), at which the axes are examined.
        free: rotations of the TCP that a pose leaves free: none, one or all three. With free rotations the
            solution is numeric.
    """
    axes = Axes(chain, rest)
    if free:
        code = FREE_AXES.index(free[0]) if len(free) == 1 else len(FREE_AXES)
        return _numeric(chain, limits, rest, axes, code)
    if len(axes.hinges) != chain.dof or not axes.hinges.all() or chain.dof not in (6, 7):
        return _numeric(chain, limits, rest, axes)
    try:
        found = _srs(chain, limits, rest) if chain.dof == 7 else _six_axis(chain, limits, rest)
    except InputError:  # axes are parallel that must not be
        found = None
    return found or _numeric(chain, limits, rest, axes)


def _numeric(chain: Chain, limits: JointLimits, rest: Array, axes: Axes, free: int = NONE_FREE) -> Arm:
    reach = axes.reach()
    return Arm(chain, limits, rest, axes.points[0], reach, 0.0, free, _rank(chain, limits) < POSE_DOF)


def _rank(chain: Chain, limits: JointLimits) -> int:
    """The number of directions in which the joints can move the TCP. This is the maximum over some random
    postures.
    """
    random = np.random.default_rng(0)
    postures = random.uniform(limits.min_position, limits.max_position, (POSTURES, chain.dof))
    return max(int(np.linalg.matrix_rank(chain.solve(joints)[2], tol=MAX_SLOP)) for joints in postures)


def _srs(chain: Chain, limits: JointLimits, rest: Array) -> Arm | None:
    axes = Axes(chain, rest)
    shoulder, wrist = axes.meet(0, 1, 2), axes.meet(4, 5, 6)
    if shoulder is None or wrist is None:
        return None
    return SrsArm(
        chain,
        limits,
        rest,
        axes.points[0],
        axes.reach(),
        _refinement_tolerance(axes.slop),
        axes.directions,
        shoulder,
        wrist,
        axes.points[3],
    )


def _six_axis(chain: Chain, limits: JointLimits, rest: Array) -> Arm | None:
    axes = Axes(chain, rest)
    wrist, kind = axes.meet(3, 4, 5), ""
    if wrist is not None:
        kind = _first_three(axes)
    elif axes.parallel(1, 2, 3):
        wrist, kind = axes.meet(4, 5), "three parallel axes"
    if wrist is None or not kind:
        return None
    points = axes.points.copy()
    if kind == "first and second axis meet":
        points[:2] = axes.meet(0, 1)
    return SixAxisArm(
        chain,
        limits,
        rest,
        axes.points[0],
        axes.reach(),
        _refinement_tolerance(axes.slop),
        axes.directions,
        points,
        wrist,
        kind,
    )


def _first_three(axes: Axes) -> str:
    """The kind of closed form for the position of the wrist, selected from the first three axes; "" if no
    closed form is known.
    """
    kinds: Sequence[tuple[str, bool]] = (
        ("second and third axis parallel", axes.parallel(1, 2)),
        ("first and second axis meet", axes.meet(0, 1) is not None),
        ("first and second axis parallel", axes.parallel(0, 1)),
    )
    return next((kind for kind, holds in kinds if holds), "")


def _refinement_tolerance(slop: float) -> float:
    """The tolerance of the numeric refinement. It is 3 times the inaccuracy of the axes, because the
    inaccuracy adds up along the arm. It is 0 if the inaccuracy is only the rounding of the file.
    """
    return 3.0 * slop if slop > 1e-10 else 0.0
