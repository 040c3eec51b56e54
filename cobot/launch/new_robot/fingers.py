"""The fingers that `cobot new-robot` keeps as a gripper: two fingers that slide towards each other.

Their joints are removed from the model, like all joints that do not belong to the arm. The settings describe
how the links slide (`robot.gripper.hand`), and the simulation moves them. In the model the fingers are open,
because planned motions avoid collisions with the fingers at their position in the model.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

from cobot.cell import OwnHand, SlidingFinger
from cobot.launch.new_robot.masses import set_ball
from cobot.launch.robot_file.mjcf import has_bounds
from cobot.launch.robot_file.tree import MovingJoint
from cobot.robot.quaternion import from_matrix
from cobot.types import Array

TRAVELS_M = (0.001, 0.5)
FORCES_N, SPEEDS_M_S = (1.0, 2000.0), (0.01, 1.0)
OPPOSITE = 0.9
"""Two fingers move towards each other if the cosine between their directions is below minus this value."""
APART_M = 1e-4
LIGHT_KG, LIGHT_M = 0.02, 0.01
"""Mass and radius of the ball that replaces a finger without a mass. A finger that slides needs a mass."""
TCP = "between_fingers"
FROM_TIP_M, FROM_TIP_SHARE = 0.01, 0.25
"""Distance of the TCP from the fingertips, m, and its maximum as a share of the fingers' length."""


@dataclass(frozen=True, slots=True)
class _Slide:
    """A finger's joint in the file.

    Attributes:
        axis: direction of the axis in the frame of the joint's body, unit length.
        low, high: positions of this joint at the lower and the upper bound of the leading joint, m.
    """

    name: str
    body: str
    axis: Array
    low: float
    high: float


@dataclass(slots=True)
class FingerPair:
    """Two fingers of a file.

    Attributes:
        joints: the two joints; the first one is the leader.
        coupled: whether the second joint follows the first one.
        rate: velocity and effort limits of the leader in the file; 0 if unknown.
    """

    joints: tuple[_Slide, _Slide]
    coupled: bool
    rate: tuple[float, float]
    _hand: OwnHand | None = field(default=None, init=False)

    def open(
        self, spec: mujoco.MjSpec, mj: mujoco.MjModel, rest: Mapping[str, float]
    ) -> tuple[OwnHand, str] | str:
        """Open the fingers in a specification whose finger joints have been removed.

        Args:
            mj: the compiled specification.
            rest: positions of the joints in the specification, m.

        Returns:
            The hand and its description. If the fingers cannot be simulated, the reason as text.
        """
        data = mujoco.MjData(mj)
        mujoco.mj_kinematics(mj, data)
        axes = [data.body(each.body).xmat.reshape(3, 3) @ each.axis for each in self.joints]
        signs = self._opening(axes, [_middle(mj, data, each.body) for each in self.joints])
        if float(signs[0] * axes[0] @ (signs[1] * axes[1])) > -OPPOSITE:
            return "its fingers do not slide towards each other"
        fingers, places, light = [], [], []
        for each, sign in zip(self.joints, signs, strict=True):
            opens = each.high if sign * (each.high - each.low) > 0.0 else each.low
            body = spec.body(each.body)
            turned = np.zeros(3)
            mujoco.mju_rotVecQuat(turned, each.axis, mj.body(each.body).quat)
            body.pos = body.pos + (opens - rest[each.name]) * turned
            axis = (sign * each.axis).round(9) + 0.0
            fingers.append(
                SlidingFinger(body=each.body, axis=tuple(axis.tolist()), travel_m=abs(each.high - each.low))
            )
            places.append(f"{each.name} at {opens:.4g} m")
            if mj.body(each.body).mass[0] <= 0.0:
                set_ball(body, LIGHT_KG, LIGHT_M)
                light.append(each.body)
        velocity, effort = self.rate
        speed = velocity * sum(each.travel_m for each in fingers) / max(each.travel_m for each in fingers)
        known: dict[str, float] = {}
        if effort > 0.0:
            known["max_force_n"] = float(np.clip(effort, *FORCES_N))
        if velocity > 0.0:
            known["max_speed_m_s"] = float(np.clip(speed, *SPEEDS_M_S))
        hand = self._hand = OwnHand(fingers=(fingers[0], fingers[1]), **known)
        return hand, (
            f"gripper found; robot.gripper is simulated, {1e3 * hand.stroke_m:g} mm wide, "
            f"{hand.max_force_n:g} N, {hand.max_speed_m_s:g} m/s; planning assumes open fingers: "
            + ", ".join(places)
            + (f"; mass {LIGHT_KG:g} kg assumed of {', '.join(light)}" if light else "")
        )

    def _opening(self, axes: Sequence[Array], middles: Sequence[Array | None]) -> list[float]:
        """For each joint: 1 if the finger opens in the direction of the joint's axis, otherwise -1."""
        signs = [1.0, 1.0]
        first, second = middles
        if first is not None and second is not None:
            along = [float(axis @ (first - second)) for axis in axes]
            if abs(along[0]) > APART_M:
                signs[0] = float(np.sign(along[0]))
            if abs(along[1]) > APART_M:
                signs[1] = -float(np.sign(along[1]))
        if self.coupled:
            ways = [each.high - each.low for each in self.joints]
            signs[1] = signs[0] * float(np.sign(ways[0] * ways[1]))
        return signs

    def add_tcp(self, spec: mujoco.MjSpec, mj: mujoco.MjModel) -> str | None:
        """Add a site between the tips of the open fingers. Returns its name, or None for fingers without
        shapes.

        The z axis of the site points out of the hand. Its x axis is the axis of the first finger's joint.

        Args:
            mj: the compiled specification.
        """
        hand = self._hand
        if hand is None:
            return None
        data = mujoco.MjData(mj)
        mujoco.mj_kinematics(mj, data)
        first, second = hand.fingers
        corners = [_corners(mj, data, each.body) for each in hand.fingers]
        parent = spec.body(first.body).parent
        if any(len(each) == 0 for each in corners) or not parent.name:
            return None
        frame = data.body(parent.name).xmat.reshape(3, 3)
        opens = data.body(first.body).xmat.reshape(3, 3) @ first.axis
        both = np.concatenate(corners)
        from_hand = (both - data.body(parent.name).xpos) @ frame
        reach = {
            (axis, sign): float((sign * from_hand[:, axis]).max())
            for axis in range(3)
            for sign in (1.0, -1.0)
            if abs(frame[:, axis] @ opens) < 0.5
        }
        axis, sign = max(reach, key=lambda each: reach[each])
        out = sign * frame[:, axis]
        out = (out - (out @ opens) * opens) / np.linalg.norm(out - (out @ opens) * opens)
        far, near = float((both @ out).max()), float((both @ out).min())
        inner = float((corners[0] @ opens).min()), float((corners[1] @ opens).max())
        across = np.cross(out, opens)
        place = (
            opens * 0.5 * (inner[0] - first.travel_m + inner[1] + second.travel_m)
            + out * (far - min(FROM_TIP_M, FROM_TIP_SHARE * (far - near)))
            + across * 0.5 * ((both @ across).max() + (both @ across).min())
        )
        turn = frame.T @ np.column_stack([opens, across, out])
        pos = frame.T @ (place - data.body(parent.name).xpos)
        parent.add_site(name=TCP, pos=pos, quat=from_matrix(turn.ravel().tolist()))
        return TCP


def sliding_pair(
    fingers: Sequence[MovingJoint], rates: Mapping[str, tuple[float, float]]
) -> FingerPair | str:
    """Find the two sliding fingers of a gripper. If they cannot be simulated, return the reason as text."""
    if len(fingers) != 2 or any(each.joint.type != mujoco.mjtJoint.mjJNT_SLIDE for each in fingers):
        return "cobot simulates two fingers that slide"
    leader, other = fingers if not fingers[0].leader else (fingers[1], fingers[0])
    if leader.leader or leader.parent is not other.parent or not (leader.name and other.name):
        return "cobot simulates two fingers that slide, of which one may follow the other"
    if not (leader.joint.parent.name and other.joint.parent.name):
        return "its links have no names"
    ranges: list[tuple[float, float]] = []
    for each in (leader, other):
        low, high = map(float, each.joint.range)
        if each is leader or other.leader != leader.name:
            if not has_bounds(each.joint.limited, each.joint.range):
                return f"{each.name} has no range"
        else:
            ends = np.array(ranges[0]) - leader.reference(False)
            if any(other.polynomial[2:]) or not other.polynomial[1]:
                return f"{other.name} does not follow {leader.name} in proportion"
            low, high = (other.reference(False) + np.polyval(other.polynomial[1::-1], ends)).tolist()
        if not TRAVELS_M[0] <= (travel_m := abs(high - low)) <= TRAVELS_M[1]:
            bounds = f"{TRAVELS_M[0]:g} to {TRAVELS_M[1]:g} m"
            return f"{each.name} slides by {travel_m:g} m, allowed: {bounds}"
        ranges.append((low, high))
    first, second = (
        _Slide(
            each.name,
            each.joint.parent.name,
            np.array(each.joint.axis) / np.linalg.norm(each.joint.axis),
            *ends_m,
        )
        for each, ends_m in zip((leader, other), ranges, strict=True)
    )
    return FingerPair((first, second), other.leader == leader.name, rates.get(leader.name, (0.0, 0.0)))


def _bodies(mj: mujoco.MjModel, name: str) -> Iterator[int]:
    """A body and all bodies that it carries."""
    top = mj.body(name).id
    for body in range(mj.nbody):
        each = body
        while each > top:
            each = int(mj.body_parentid[each])
        if each == top:
            yield body


def _corners(mj: mujoco.MjModel, data: mujoco.MjData, name: str) -> Array:
    """The corners of the boxes around a finger's shapes, shape (n, 3)."""
    bodies = set(_bodies(mj, name))
    found = []
    for geom in range(mj.ngeom):
        if int(mj.geom_bodyid[geom]) in bodies and mj.geom_contype[geom]:
            centre, half = mj.geom_aabb[geom, :3], mj.geom_aabb[geom, 3:]
            for corner in np.ndindex(2, 2, 2):
                local = centre + half * (2.0 * np.array(corner) - 1.0)
                found.append(data.geom_xpos[geom] + data.geom_xmat[geom].reshape(3, 3) @ local)
    return np.array(found)


def _middle(mj: mujoco.MjModel, data: mujoco.MjData, name: str) -> Array | None:
    corners = _corners(mj, data, name)
    return None if len(corners) == 0 else 0.5 * (corners.min(axis=0) + corners.max(axis=0))
