"""The fingers that `cobot new-robot` keeps as a gripper: two fingers that turn together, or one jaw that
turns.

Their joints are removed from the model, as in `fingers`. The settings describe how the links turn
(`robot.gripper.hand`), and give the width for each angle; see `finger_widths`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np
from pydantic import ValidationError

from cobot.cell import TurningHand, TurningJoint
from cobot.launch.new_robot.finger_widths import Hinge, Linkage, MeasuredFingers
from cobot.launch.new_robot.masses import set_ball
from cobot.launch.robot_file.mjcf import has_bounds
from cobot.launch.robot_file.tree import MovingJoint
from cobot.robot.quaternion import from_matrix
from cobot.strict import sentences

FORCES_N, SPEEDS_M_S = (1.0, 2000.0), (0.01, 1.0)
TURNS_RAD = (0.05, 6.3)
LIGHT_KG, LIGHT_M = 0.02, 0.01
"""Mass and radius of the ball that replaces a finger without a mass. A finger that moves needs a mass."""
TCP = "between_fingers"
FAR_M = 0.001
"""If closed fingers reach further out than open ones by at least this length, the output reports it."""


@dataclass(slots=True)
class TurningFingers:
    """The fingers of a gripper in a robot file, if they open by turning about joints.

    Attributes:
        joints: the joints of the fingers. The first one is the leader, and all others follow it.
        range: range of the leader, rad.
        rate: velocity and effort limits of the leader in the file; 0 if unknown.
    """

    joints: tuple[Hinge, ...]
    range: tuple[float, float]
    rate: tuple[float, float]
    _found: MeasuredFingers | None = field(default=None, init=False)

    @property
    def names(self) -> list[str]:
        return [each.name for each in self.joints]

    def open(
        self, spec: mujoco.MjSpec, mj: mujoco.MjModel, rest: Mapping[str, float]
    ) -> tuple[TurningHand, str] | str:
        """Open the fingers in a specification without their joints; see `FingerPair.open`."""
        linkage = Linkage(spec, self.joints, rest)
        found = linkage.measure(self.range)
        if isinstance(found, str):
            return found
        try:
            hand = self._hand(found)
        except ValidationError as exc:
            return f"no gripper of cobot: {sentences(exc.errors())}"
        self._found = found
        linkage.turn(found.open)
        light = []
        for each in self.joints:
            body = spec.body(each.body)
            body.pos, body.quat = linkage.place(each.body)
            body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
            if mj.body(each.body).mass[0] <= 0.0:
                set_ball(body, LIGHT_KG, LIGHT_M)
                light.append(each.body)
        leader, further = self.joints[0].name, found.further_m
        return hand, (
            f"gripper found; robot.gripper is simulated, {1e3 * hand.closed_m:.3g} to "
            f"{1e3 * hand.stroke_m:.3g} mm wide between the ends of the fingers' shapes, "
            f"{hand.max_force_n:.3g} N, {hand.max_speed_m_s:.3g} m/s; motions are planned with open "
            f"fingers: {leader} is at {found.open:.4g} rad when open, and at {found.closed:.4g} rad "
            "when closed"
            + (f" and they reach {1e3 * further:.0f} mm further out" if further > FAR_M else "")
            + (f"; mass {LIGHT_KG:g} kg assumed of {', '.join(light)}" if light else "")
        )

    def _hand(self, found: MeasuredFingers) -> TurningHand:
        way, (velocity, effort) = found.open - found.closed, self.rate
        slopes = np.diff(found.widths) * (len(found.widths) - 1) / abs(way)
        known: dict[str, float] = {}
        if effort > 0.0:
            known["max_force_n"] = float(np.clip(effort / slopes.max(), *FORCES_N).round(3))
        if velocity > 0.0:
            known["max_speed_m_s"] = float(np.clip(velocity * slopes.min(), *SPEEDS_M_S).round(4))
        return TurningHand(
            joints=tuple(
                TurningJoint(
                    body=each.body,
                    axis=tuple((np.sign(way) * each.axis).round(9) + 0.0),
                    anchor_m=tuple(each.anchor.round(9) + 0.0),
                    ratio=round(each.ratio, 9),
                )
                for each in self.joints
            ),
            travel_rad=round(abs(way), 6),
            widths_m=tuple(found.widths.round(6).tolist()),
            **known,
        )

    def add_tcp(self, spec: mujoco.MjSpec, mj: mujoco.MjModel) -> str | None:
        """Add a site where the fingertips meet, with its z axis out of the hand. Returns its name."""
        if self._found is None:
            return None
        position, turn = self._found.tcp
        quaternion = from_matrix(turn.ravel().tolist())
        spec.body(self._found.carrier).add_site(name=TCP, pos=position, quat=quaternion)
        return TCP


def turning_fingers(
    fingers: Sequence[MovingJoint], rates: Mapping[str, tuple[float, float]], degrees: bool
) -> TurningFingers | str:
    """Find the turning fingers of a gripper. If they cannot be simulated, return the reason as text.

    Args:
        degrees: whether the angles in the specification are in degrees.
    """
    leaders = [each for each in fingers if not each.leader]
    if len(leaders) != 1:
        return (
            f"cobot simulates fingers that one joint moves, but these have {len(leaders)} such joints: "
            f"{', '.join(each.name for each in leaders)}"
        )
    (leader,) = leaders
    if not all(each.name and each.joint.parent.name for each in fingers):
        return "its links have no names"
    if not has_bounds(leader.joint.limited, leader.joint.range):
        return f"{leader.name} has no range"
    unit = np.pi / 180.0 if degrees else 1.0
    low, high = (unit * float(each) for each in leader.joint.range)
    if not TURNS_RAD[0] <= high - low <= TURNS_RAD[1]:
        bounds = f"{TURNS_RAD[0]:g} to {TURNS_RAD[1]:g} rad"
        return f"{leader.name} turns by {high - low:.4g} rad, allowed: {bounds}"
    nodes = {each.name: each for each in fingers}
    joints = []
    for each in [leader, *(each for each in fingers if each is not leader)]:
        followed = _followed(each, nodes, degrees)
        if isinstance(followed, str):
            return followed
        root = "" if each.parent in fingers else each.joint.parent.parent.name
        axis = np.array(each.joint.axis) / np.linalg.norm(each.joint.axis)
        joints.append(
            Hinge(each.name, each.joint.parent.name, axis, np.array(each.joint.pos), *followed, root)
        )
    return TurningFingers(tuple(joints), (low, high), rates.get(leader.name, (0.0, 0.0)))


def _followed(
    node: MovingJoint, nodes: Mapping[str, MovingJoint], degrees: bool
) -> tuple[float, float] | str:
    """Offset and ratio that give a joint's angle from the angle of the first joint. If the angles are not
    proportional, the reason is returned as text.
    """
    offset, ratio, seen = 0.0, 1.0, {node.name}
    while node.leader:
        if any(node.polynomial[2:]) or not node.polynomial[1]:
            return f"{node.name} does not follow {node.leader} in proportion"
        leader = nodes.get(node.leader)
        if leader is None or leader.name in seen:
            return f"{node.name} follows {node.leader}, which is not a joint of the gripper"
        first, slope = node.polynomial[:2]
        offset += ratio * (node.reference(degrees) + first - slope * leader.reference(degrees))
        ratio *= slope
        seen.add(leader.name)
        node = leader
    return offset, ratio
