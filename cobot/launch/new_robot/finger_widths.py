"""Measures with MuJoCo the width of turning fingers as a function of the angle of their first joint.

The width is the distance between the ends of both fingers, or between the end of a jaw and the end of the
link that carries the jaw. It is measured between the convex collision shapes. Only the ends of the shapes are
measured, because near its axis a jaw is close to its link at every angle. The ends are cut off while the
fingers are closed.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from cobot.types import Array

END_M, END_SHARE = 0.02, 0.25
"""Length of the part that is treated as the end of a finger, m, and its maximum as a share of the finger's
length.
"""
FROM_TIP_M, FROM_TIP_SHARE = 0.01, 0.25
"""Distance of the TCP from the fingertips, m, and its maximum as a share of the fingers' length."""
ANGLES, WIDTHS = 129, 17
"""Number of angles at which the width is measured, and number of widths in the result."""
FAR_M, NEAR_M = 2.0, 1e-4
"""Largest distance that is measured, m, and distance below which two axes are treated as one, m."""
GROWS_M, TOUCH_M = 1e-7, 1e-4
"""Minimum growth of the width from one angle to the next, m, and width below which the fingers are considered
touching, m.
"""
SAME_REACH = 0.9
"""A third branch is treated as a finger if its reach is at least this share of the reach of the second
branch.
"""
STROKES_M, CLOSED_SHARE = (0.001, 0.5), 0.5


@dataclass(frozen=True, slots=True)
class Hinge:
    """A joint of the fingers in the file. Its angle is `offset` + `ratio` times the angle of the first joint.

    Attributes:
        axis, anchor: direction of the axis and a point on it, in the frame of the joint's body.
        carrier: the body that carries the branch if this joint is the first one of a branch; otherwise "".
    """

    name: str
    body: str
    axis: Array
    anchor: Array
    offset: float
    ratio: float
    carrier: str


@dataclass(frozen=True, slots=True)
class MeasuredFingers:
    """How far a gripper opens at each angle of its first finger joint.

    Attributes:
        closed, open: angles of the first joint, rad.
        widths: widths at equal steps of the angle from closed to open, m.
        further_m: distance by which closed fingers reach further out of the hand than open ones.
        tcp: the point where the fingertips meet, in the frame of the carrier: position and rotation matrix.
            The x axis points from the second to the first finger, the z axis out of the hand.
        carrier: the body that carries the fingers.
    """

    closed: float
    open: float
    widths: Array
    further_m: float
    tcp: tuple[Array, Array]
    carrier: str


class Linkage:
    """A copy of a specification whose finger joints had been removed, with these joints added again.

    Args:
        rest: angles at which the joints were removed, rad.
    """

    def __init__(self, spec: mujoco.MjSpec, joints: Sequence[Hinge], rest: Mapping[str, float]) -> None:
        self._spec, self._joints, self._rest = spec.copy(), joints, rest
        for each in joints:
            self._spec.body(each.body).add_joint(
                name=each.name,
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=each.axis,
                pos=each.anchor,
                limited=mujoco.mjtLimited.mjLIMITED_FALSE,
            )
        self._spec.compiler.boundmass = self._spec.compiler.boundinertia = 1e-6
        self._spec.compiler.discardvisual = False
        self._compile()

    def _compile(self) -> None:
        self._mj = self._spec.compile()
        self._data = mujoco.MjData(self._mj)

    def turn(self, angle: float) -> None:
        """Turn the first joint of the fingers to an angle, rad. All other joints move accordingly."""
        for each in self._joints:
            self._data.joint(each.name).qpos[0] = each.offset + each.ratio * angle - self._rest[each.name]
        mujoco.mj_kinematics(self._mj, self._data)

    def place(self, body: str) -> tuple[Array, Array]:
        """Position and quaternion of a body in the frame of its parent."""
        data, child = self._data, self._mj.body(body).id
        parent = int(self._mj.body_parentid[child])
        inverse, place, quaternion = np.zeros(4), np.zeros(3), np.zeros(4)
        mujoco.mju_negQuat(inverse, data.xquat[parent])
        mujoco.mju_rotVecQuat(place, data.xpos[child] - data.xpos[parent], inverse)
        mujoco.mju_mulQuat(quaternion, inverse, data.xquat[child])
        return place, quaternion

    def measure(self, span: tuple[float, float]) -> MeasuredFingers | str:
        """Measure the width over a range of the first joint, rad. Returns the reason if that is
        impossible.
        """
        sides = self._sides(span[0])
        if isinstance(sides, str):
            return sides
        carrier = next(each.carrier for each in self._joints if each.body == sides[0])
        bodies = [self._carried(side) for side in sides]
        if len(sides) == 1:
            bodies.append(self._rigid_with(carrier))
        if not all(self._shapes(each) for each in bodies):
            return "its fingers have no shapes, so their width is unknown"
        self.turn(min(span, key=lambda angle: self._tip_clearance(angle, sides[0], bodies[1])))
        first = self._common_geometry(span, sides, bodies)
        if isinstance(first, str):
            return first
        self.turn(first[1][0])  # the ends are cut off at the closed angle, which is known now
        second = self._common_geometry(span, sides, bodies)
        if isinstance(second, str):
            return second
        groups, (closed, opened) = second
        widths = np.array([self._distance(angle, groups) for angle in np.linspace(closed, opened, WIDTHS)])
        if widths[0] < TOUCH_M:
            widths[0] = 0.0
        further, tcp = self._tcp((closed, opened), sides, groups, carrier)
        return MeasuredFingers(closed, opened, widths, further, tcp, carrier)

    def _common_geometry(
        self, span: tuple[float, float], sides: Sequence[str], bodies: Sequence[Sequence[int]]
    ) -> tuple[list[list[int]], tuple[float, float]] | str:
        """Determine the ends of both fingers, and the range of angles over which the fingers open. If this
        fails, return the reason as text.
        """
        groups = self._cut_ends(sides, bodies)
        if not all(groups):
            return "it has no second finger where the first one ends"
        angles = np.linspace(*span, ANGLES)
        ends = _stretch(angles, [self._distance(angle, groups) for angle in angles])
        return ends if isinstance(ends, str) else (groups, ends)

    def _cut_ends(self, sides: Sequence[str], bodies: Sequence[Sequence[int]]) -> list[list[int]]:
        """Add the ends of both fingers as shapes. Returns each finger's shapes."""
        fingers = [body for each in bodies[: len(sides)] for body in each]
        out, corners = self._pointing_direction(sides), self._corners(self._shapes(fingers))
        far, near = float((corners @ out).max()), float(self._middle(sides) @ out)
        level = far - min(END_M, END_SHARE * (far - near))
        names = [self._add_end(each, out, level) for each in bodies]
        self._compile()
        return [[int(self._mj.geom(name).id) for name in each] for each in names]

    def _sides(self, angle: float) -> list[str] | str:
        """The first link of each finger. The fingers are the branches that reach farthest; a hand with a
        single jaw has only one.
        """
        self.turn(angle)
        begins = [each.body for each in self._joints if each.carrier]
        middle = self._middle(begins)
        reach = {
            body: float(np.linalg.norm(corners - middle, axis=1).max())
            for body in begins
            if len(corners := self._corners(self._shapes(self._carried(body))))
        }
        sides = sorted(reach, key=lambda body: -reach[body])
        if not sides:
            return "its fingers have no shapes, so their width is unknown"
        if len(sides) > 2 and reach[sides[2]] > SAME_REACH * reach[sides[1]]:
            return f"cobot simulates two fingers, but this gripper has more: {', '.join(sides)}"
        return sides[:2]

    def _joint(self, body: str) -> Any:
        return self._data.joint(next(each.name for each in self._joints if each.body == body))

    def _middle(self, bodies: Sequence[str]) -> Array:
        """The point midway between the axes of the bodies' joints."""
        return np.asarray(np.mean([self._joint(body).xanchor for body in bodies], axis=0))

    def _tip(self, side: str) -> Array:
        """The point of a finger that is farthest from its axis."""
        joint = self._joint(side)
        offsets = self._corners(self._shapes(self._carried(side))) - joint.xanchor
        across = offsets - np.outer(offsets @ joint.xaxis, joint.xaxis)
        return np.asarray(joint.xanchor + across[np.argmax(np.linalg.norm(across, axis=1))])

    def _tip_clearance(self, angle: float, side: str, others: Sequence[int]) -> float:
        """The distance between the tip of a finger and the nearest corner of other bodies."""
        self.turn(angle)
        corners = self._corners(self._shapes(others))
        return float(np.linalg.norm(corners - self._tip(side), axis=1).min())

    def _pointing_direction(self, sides: Sequence[str]) -> Array:
        """The direction in which the fingers point out of the hand."""
        out = np.mean([self._tip(side) for side in sides], axis=0) - self._middle(sides)
        if len(sides) > 1:
            across = self._middle(sides[:1]) - self._middle(sides[1:])
            if (length := float(np.linalg.norm(across))) > NEAR_M:
                out -= (out @ across) * across / length**2
        return np.asarray(out / np.linalg.norm(out))

    def _add_end(self, bodies: Sequence[int], out: Array, level: float) -> list[str]:
        """Add the parts of these bodies that are beyond a plane, as shapes that collide with nothing. Returns
        their names.
        """
        names = []
        for geom in self._shapes(bodies):
            body = int(self._mj.geom_bodyid[geom])
            end = _cut_off(self._corners([geom]), out, level)
            if end is None:
                continue
            local = (end - self._data.xpos[body]) @ self._data.xmat[body].reshape(3, 3)
            name = f"end of a finger {self._mj.ngeom} {geom}"
            mesh = self._spec.add_mesh(name=name, uservert=local.ravel())
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
            self._spec.body(self._mj.body(body).name).add_geom(
                name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, contype=0, conaffinity=0, mass=0.0
            )
            names.append(name)
        return names

    def _distance(self, angle: float, groups: Sequence[Sequence[int]]) -> float:
        """The distance between the nearest shapes of two groups; negative if they overlap."""
        self.turn(angle)
        mj, data, pairs = self._mj, self._data, itertools.product(*groups)
        return float(min(mujoco.mj_geomDistance(mj, data, one, other, FAR_M, None) for one, other in pairs))

    def _nearest(self, groups: Sequence[Sequence[int]]) -> Array:
        """The point midway between the nearest points of two groups."""
        least, found = FAR_M, np.zeros(6)
        for one in groups[0]:
            for other in groups[1]:
                ends = np.zeros(6)
                if (now := mujoco.mj_geomDistance(self._mj, self._data, one, other, least, ends)) < least:
                    least, found = now, ends
        return np.asarray(0.5 * (found[:3] + found[3:]))

    def _tcp(
        self, ends: tuple[float, float], sides: Sequence[str], groups: Sequence[Sequence[int]], carrier: str
    ) -> tuple[float, tuple[Array, Array]]:
        """The values `further_m` and `tcp` of `MeasuredFingers`."""
        shapes = [geom for side in sides for geom in self._shapes(self._carried(side))]
        closed, opened = ends
        self.turn(closed)
        out, place, corners = self._pointing_direction(sides), self._nearest(groups), self._corners(shapes)
        far, near = float((corners @ out).max()), float(self._middle(sides) @ out)
        height = far - min(FROM_TIP_M, FROM_TIP_SHARE * (far - near))
        first = self._tip(sides[0])
        end = self._corners([geom for group in groups for geom in group])
        hand = self._shapes(self._rigid_with(carrier)) + shapes
        reach = float((self._corners(hand) @ out).max())
        self.turn(opened)
        across = self._tip(sides[0]) - (self._tip(sides[1]) if len(sides) > 1 else first)
        across -= (across @ out) * out
        across /= np.linalg.norm(across)
        further = reach - float((self._corners(hand) @ out).max())
        body = self._data.body(carrier)
        frame = body.xmat.reshape(3, 3)
        beside = np.cross(out, across)
        place += (height - place @ out) * out + (
            0.5 * ((end @ beside).max() + (end @ beside).min()) - place @ beside
        ) * beside
        turn = frame.T @ np.column_stack([across, beside, out])
        return further, (frame.T @ (place - body.xpos), turn)

    def _carried(self, body: str) -> list[int]:
        """A body and all bodies that it carries."""
        top, found = self._mj.body(body).id, []
        for each in range(top, self._mj.nbody):
            if each == top or int(self._mj.body_parentid[each]) in found:
                found.append(each)
        return found

    def _rigid_with(self, body: str) -> list[int]:
        weld = self._mj.body_weldid
        return np.flatnonzero(weld == weld[self._mj.body(body).id]).tolist()

    def _shapes(self, bodies: Sequence[int]) -> list[int]:
        """The collision shapes of bodies."""
        mj = self._mj
        return [geom for geom in range(mj.ngeom) if mj.geom_bodyid[geom] in bodies and mj.geom_contype[geom]]

    def _corners(self, shapes: Sequence[int]) -> Array:
        """Corners of the convex shapes in the world frame, shape (n, 3). A shape without corners is replaced
        by the corners of its box.
        """
        mj, found = self._mj, [np.zeros((0, 3))]
        for geom in shapes:
            if mj.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
                mesh = int(mj.geom_dataid[geom])
                begin = int(mj.mesh_vertadr[mesh])
                local = mj.mesh_vert[begin : begin + int(mj.mesh_vertnum[mesh])].astype(float)
            else:
                signs = 2.0 * np.array(list(np.ndindex(2, 2, 2))) - 1.0
                local = mj.geom_aabb[geom, :3] + mj.geom_aabb[geom, 3:] * signs
            turn = self._data.geom_xmat[geom].reshape(3, 3)
            found.append(self._data.geom_xpos[geom] + local @ turn.T)
        return np.concatenate(found)


def _cut_off(corners: Array, out: Array, level: float) -> Array | None:
    """The corners of the part of a convex solid that is beyond a plane; None if that part has no volume."""
    try:
        hull = ConvexHull(corners)
    except QhullError:
        return None
    heights = corners @ out - level
    edges = hull.simplices[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    below, above = edges[heights[edges[:, 0]] * heights[edges[:, 1]] < 0.0].T
    share = (heights[below] / (heights[below] - heights[above]))[:, None]
    beyond = hull.vertices[heights[hull.vertices] >= 0.0]
    points = np.concatenate([corners[beyond], corners[below] + share * (corners[above] - corners[below])])
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        return None


def _stretch(angles: Array, widths: Sequence[float]) -> tuple[float, float] | str:
    """The angles of the closed and the open fingers, between which the width increases steadily. If there are
    no such angles, the reason.
    """
    if widths[0] > widths[-1]:
        angles, widths = angles[::-1], widths[::-1]
    last = int(np.argmax(widths))
    first = last
    while first > 0 and widths[first] > 0.0 and widths[first] - widths[first - 1] > GROWS_M:
        first -= 1
    low, high = max(widths[first], 0.0), widths[last]
    if high - low > STROKES_M[1] or low > CLOSED_SHARE * high or high - low < STROKES_M[0]:
        return (
            f"the ends of its fingers are {1e3 * low:.3g} to {1e3 * high:.3g} mm apart; closed fingers may "
            f"be at most {CLOSED_SHARE:g} times as far apart as open ones, and the travel must be "
            f"{1e3 * STROKES_M[0]:g} to {1e3 * STROKES_M[1]:g} mm"
        )
    closed = float(angles[first])
    if widths[first] < 0.0:  # between this angle and the next, the fingers separate
        share = widths[first] / (widths[first] - widths[first + 1])
        closed += share * float(angles[first + 1] - angles[first])
    return closed, float(angles[last])
