"""Checks whether the TCP is on the requested path, with its own geometry: lin, circ, polyline and round
corners.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.stress.judge import Judge
from cobot.motions.requests import MotionRequest
from cobot.types import Array, PlannerName, Pose

BESIDE_M, BESIDE_RAD = 5.2e-5, 1.8e-4
"""What is allowed, 0.05 mm and 0.01 degrees, and the rounding of this judgement."""


def flaws(judge: Judge, request: MotionRequest, rows: Array) -> Iterator[str]:
    """Yield the deviations of joint samples, shape (n, dof), from the requested path."""
    positions, turns = judge.path(rows)
    if request.planner is PlannerName.LIN:
        assert isinstance(request.goal, Pose)
        yield from _lin_flaws(positions, turns, request.goal)
    elif request.planner is PlannerName.CIRC:
        yield from _circ_flaws(positions, turns, request)
    else:
        assert isinstance(request.goal, Pose)
        corners = [positions[0], *(pose.position for pose in request.through), request.goal.position]
        yield from _beside_flaws(positions, corners, request.radius_m)


def _lin_flaws(positions: Array, turns: Rotation, goal: Pose) -> Iterator[str]:
    way = goal.position - positions[0]
    length = float(np.linalg.norm(way))
    if length < 1e-3:
        if np.linalg.norm(positions - positions[0], axis=1).max() > length + BESIDE_M:
            yield "path: the TCP leaves its place"
        return
    along = (positions - positions[0]) @ way / length**2
    beside = np.linalg.norm(positions - positions[0] - along[:, None] * way, axis=1).max()
    over = length * max(-along.min(), along.max() - 1.0)
    if max(beside, over) > BESIDE_M:
        yield f"path: {1e3 * beside:.4f} mm beside the line, from {along.min():.6f} to {along.max():.6f}"
    last = Rotation.from_quat(goal.quaternion, scalar_first=True)
    yield from _turn_flaws(turns, last, along, BESIDE_M / length)


def _turn_flaws(turns: Rotation, last: Rotation, shares: Array, slack: float) -> Iterator[str]:
    """Yield deviations of the orientation. `slack` is the possible error of the shares of the path, which are
    computed from the positions.
    """
    whole = (last * turns[0].inv()).as_rotvec()
    if np.linalg.norm(whole) > 3.1:  # which way round is open
        return
    wanted = Rotation.from_rotvec(shares[:, None] * whole) * turns[0]
    off = float((wanted.inv() * turns).magnitude().max())
    if off > BESIDE_RAD + slack * float(np.linalg.norm(whole)):
        yield f"path: the hand is turned {off:.3g} rad otherwise"


def _circ_flaws(positions: Array, turns: Rotation, request: MotionRequest) -> Iterator[str]:
    arc = request.arc
    if arc is None or arc.angle_rad is None:
        assert request.via is not None
        assert isinstance(request.goal, Pose)
        start, via, goal = positions[0], request.via, request.goal.position
        axis = np.cross(via - start, goal - start)
        axis /= np.linalg.norm(axis)
        rows = np.array([via - start, goal - start, axis])
        known = np.array([rows[0] @ (via + start) / 2.0, rows[1] @ (goal + start) / 2.0, axis @ start])
        centre, rise = np.linalg.solve(rows, known), 0.0
    else:
        assert arc.axis is not None
        axis = arc.axis / np.linalg.norm(arc.axis)
        centre, rise = arc.centre + ((positions[0] - arc.centre) @ axis) * axis, arc.rise_m
    x = positions[0] - centre
    radius, y = float(np.linalg.norm(x)), np.cross(axis, x)
    from_centre = positions - centre
    angles = np.unwrap(np.arctan2(from_centre @ y, from_centre @ x))
    if arc is not None and arc.angle_rad is not None and abs(angles[-1] - arc.angle_rad) > 1e-4:
        yield f"path: it turns by {angles[-1]:.6f} rad, not by {arc.angle_rad:.6f}"
    shares = angles / angles[-1]
    if arc is None:
        to_via = np.arctan2((request.via - centre) @ y, (request.via - centre) @ x) % (2.0 * np.pi)
        if not 0.0 <= to_via <= angles[-1] + 1e-6:
            yield f"path: it leads the other way round, to {angles[-1]:.3f} rad, via at {to_via:.3f} rad"
    if abs(rise) > radius * abs(angles[-1]):  # the angle of a steep helix says little
        shares = (positions - positions[0]) @ axis / rise
        angles = shares * angles[-1]
    wanted = centre + np.cos(angles)[:, None] * x + np.sin(angles)[:, None] * y
    wanted += (shares * rise)[:, None] * axis
    beside = float(np.linalg.norm(positions - wanted, axis=1).max())
    if beside > BESIDE_M:
        yield f"path: {1e3 * beside:.4f} mm beside the arc of {1e3 * radius:.1f} mm"
    if arc is None and isinstance(request.goal, Pose):
        last = Rotation.from_quat(request.goal.quaternion, scalar_first=True)
        yield from _turn_flaws(turns, last, shares, BESIDE_M / (radius * float(angles[-1])))
    elif arc is not None and not arc.turns_tool and (turns * turns[0].inv()).magnitude().max() > BESIDE_RAD:
        yield "path: the hand does not keep its orientation"


def _beside_flaws(positions: Array, corners: Sequence[Array], radius_m: float) -> Iterator[str]:
    """Yield the places that are neither on the legs nor within the radius of a corner."""
    beside = np.min([_from_leg(positions, a, b) for a, b in pairwise(corners)], axis=0)
    near = np.zeros(len(positions), dtype=bool)
    for corner in corners[1:-1]:
        near |= np.linalg.norm(positions - corner, axis=1) <= radius_m * (1.0 + 1e-6) + BESIDE_M
    off = float(beside[~near].max(initial=0.0))
    if off > BESIDE_M:
        yield f"path: {1e3 * off:.4f} mm beside the legs, away from the corners"


def _from_leg(positions: Array, begin: Array, end: Array) -> Array:
    way = end - begin
    share = np.clip((positions - begin) @ way / max(float(way @ way), 1e-18), 0.0, 1.0)
    return np.asarray(np.linalg.norm(positions - begin - share[:, None] * way, axis=1))


def beside_corners(
    judge: Judge, rows: Array, legs: Sequence[Array], radii_m: Sequence[float]
) -> Iterator[str]:
    """Yield the places of a motion through corners that are away from the corners and not on a motion with
    stops.
    """
    positions, _ = judge.path(rows)
    paths = [judge.path(each)[0] for each in legs]
    beside = np.min([_from_leg(positions, a, b) for path in paths for a, b in pairwise(path)], axis=0)
    near = np.zeros(len(positions), dtype=bool)
    for path, radius in zip(paths, radii_m, strict=False):
        near |= np.linalg.norm(positions - path[-1], axis=1) <= radius + BESIDE_M
    chord = max(float(np.abs(np.diff(path, 2, axis=0)).max()) for path in paths)
    off = float(beside[~near].max(initial=0.0))
    if off > BESIDE_M + chord:
        yield f"path: {1e3 * off:.4f} mm beside the motions with stops, away from the corners"
