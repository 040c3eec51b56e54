"""The joints of a specification as a tree. The tree shows which joints follow others, are fingers, or belong
to linkages.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterator
from dataclasses import dataclass, field

import mujoco
import numpy as np

from cobot.launch.robot_file.mjcf import has_bounds

FINGER = re.compile(r"finger|gripper|jaw|claw|knuckle|thumb|robotiq", re.IGNORECASE)
ARM_JOINT = re.compile(r"roll|pitch|yaw|rotat|twist|tilt|wrist", re.IGNORECASE)
"""Names of joints that turn a whole gripper. For example, `gripper_roll` is a joint of the arm."""
HAND = re.compile(r"(?:^|[^a-z])hand(?:[^a-z]|$)", re.IGNORECASE)
LOOPS = (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD)
ARM_JOINTS, HAND_FINGERS, FINGER_JOINTS = 4, 3, 5
"""Minimum number of joints before a hand, minimum number of fingers in a hand, and maximum number of joints
in a finger. A torso has fewer joints before its arms.
"""
MOVABLE = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


@dataclass(slots=True, eq=False)
class MovingJoint:
    """A rotary or a linear joint.

    Attributes:
        name: joint name. For a joint without a name, this is its number in the file.
        leader: the joint that this joint follows; "" if there is none.
        polynomial: coefficients of a0 + a1 x + a2 x² + ... This is the distance of the joint from its
            reference, where x is the distance of the leader from the leader's reference.
    """

    name: str
    joint: mujoco.MjsJoint
    parent: MovingJoint | None
    children: list[MovingJoint] = field(default_factory=list)
    leader: str = ""
    polynomial: tuple[float, ...] = ()

    def reference(self, degrees: bool) -> float:
        """Position of the joint, rad or m, when its body has the pose that the file gives.

        Args:
            degrees: whether the angles in the specification are in degrees.
        """
        return _unit(self.joint, degrees) * float(self.joint.ref)

    @property
    def path(self) -> list[MovingJoint]:
        """The joints from the base to this joint."""
        path, node = [self], self.parent
        while node is not None:
            path.append(node)
            node = node.parent
        return path[::-1]

    @property
    def subtree(self) -> list[MovingJoint]:
        """This joint and all joints that it moves, in file order."""
        found, pending = [], [self]
        while pending:
            found.append(node := pending.pop())
            pending += reversed(node.children)
        return found

    @property
    def depth(self) -> int:
        """The number of joints on the longest chain from this joint to an end."""
        depth, level = 0, [self]
        while level:
            depth, level = depth + 1, [child for node in level for child in node.children]
        return depth


class JointTree:
    """The rotary and linear joints in a file, except those that are kept fixed.

    Attributes:
        nodes: the joints by name, in the file's order.
        roots: the first joints after the world.
    """

    def __init__(self, spec: mujoco.MjSpec, still: Container[str] = ()) -> None:
        self.nodes: dict[str, MovingJoint] = {}
        self.roots: list[MovingJoint] = []
        self._last: dict[str, MovingJoint | None] = {}
        self._balls: list[mujoco.MjsJoint] = []
        self._tied = set(_tied(spec))
        self._read(spec.worldbody, still)
        for equality in spec.equalities:
            if equality.type == mujoco.mjtEq.mjEQ_JOINT and equality.name1 in self.nodes:
                follower = self.nodes[equality.name1]
                follower.leader = equality.name2
                follower.polynomial = tuple(float(value) for value in equality.data[:5])

    def _read(self, world: mujoco.MjsBody, still: Container[str]) -> None:
        pending: list[tuple[mujoco.MjsBody, MovingJoint | None]] = [(world, None)]
        number = 0
        while pending:
            body, last = pending.pop()
            for joint in body.joints:
                number += 1
                if joint.name in still:
                    continue
                if joint.type == mujoco.mjtJoint.mjJNT_BALL:
                    self._balls.append(joint)
                elif joint.type in MOVABLE:
                    node = MovingJoint(joint.name or f"(no name, number {number})", joint, last)
                    (last.children if last else self.roots).append(node)
                    self.nodes[node.name] = last = node
            self._last[body.name] = last
            pending += ((child, last) for child in reversed(body.bodies))

    def resting(self, degrees: bool) -> dict[str, float]:
        """The positions at which the joints without a drive stay, rad or m. Each is the joint's reference or,
        if the joint follows another one, the position that results from it, limited to the joint's range.

        Args:
            degrees: whether the angles in the specification are in degrees.
        """
        found: dict[str, float] = {}
        for node in self.nodes.values():
            self._rest(node, degrees, found)
        return found

    def _rest(self, node: MovingJoint, degrees: bool, found: dict[str, float]) -> float:
        """Add the position of one joint. The positions of its leaders are added first."""
        if node.name not in found:
            unit = _unit(node.joint, degrees)
            found[node.name] = rest = node.reference(degrees)
            if leader := self.nodes.get(node.leader):
                moved = self._rest(leader, degrees, found) - leader.reference(degrees)
                rest += float(np.polynomial.polynomial.polyval(moved, node.polynomial))
            if has_bounds(node.joint.limited, node.joint.range):
                rest = float(np.clip(rest, *(unit * node.joint.range)))
            found[node.name] = rest
        return found[node.name]

    def path_to(self, body: str) -> list[MovingJoint]:
        """The joints that move this body, beginning at the base."""
        last = self._last[body]
        return last.path if last else []

    def ball_below(self, node: MovingJoint) -> mujoco.MjsJoint | None:
        """A ball joint that this joint moves, or that is before it on the same body."""
        return next((ball for ball in self._balls if _is_within(ball.parent, node.joint.parent)), None)

    def leaves(self) -> Iterator[MovingJoint]:
        return (node for node in self.nodes.values() if not node.children)

    def is_finger(self, node: MovingJoint) -> bool:
        """Whether a joint belongs to a finger. Either the joint's name shows this, or the joint is on one of
        several short branches, and these are numerous, slide or are coupled.
        """
        if FINGER.search(node.name) and not ARM_JOINT.search(node.name):
            return True
        branches = node.parent.children if node.parent else self.roots
        if len(branches) < 2 or node.parent is None:
            return False
        if HAND.search(node.name):
            return True
        before = len(node.parent.path)
        if before < 2 or any(branch.depth > FINGER_JOINTS for branch in branches):
            return False
        if before >= ARM_JOINTS and len(branches) >= HAND_FINGERS:
            return True
        joints = [each for branch in branches for each in branch.subtree]
        names = {each.name for each in joints}
        slide = mujoco.mjtJoint.mjJNT_SLIDE
        return any(each.leader in names for each in joints) or all(
            each.joint.type == slide for each in joints
        )

    def without_fingers(self, path: list[MovingJoint]) -> list[MovingJoint]:
        """The joints of a path before its first finger joint. If the path begins with a finger joint, the
        whole path is returned.
        """
        cut = next((index for index, node in enumerate(path) if self.is_finger(node)), len(path))
        return path[:cut] or path

    def linkages(self, chain: list[MovingJoint]) -> list[MovingJoint]:
        """The first joint of each branch that follows the joints of a chain or closes a loop."""
        on_chain = {node.name for node in chain}
        followers = {node.name for node in self.nodes.values() if self._follows(node, on_chain)}
        return [
            child
            for node in chain[:-1]
            for child in node.children
            if child.name not in on_chain
            and any(each.name in followers or each.joint.parent.name in self._tied for each in child.subtree)
        ]

    def _follows(self, node: MovingJoint, leaders: Container[str]) -> bool:
        seen: set[str] = set()
        while node.leader and node.name not in seen:
            if node.leader in leaders:
                return True
            seen.add(node.name)
            if node.leader not in self.nodes:
                return False
            node = self.nodes[node.leader]
        return False


def moved_together(spec: mujoco.MjSpec, chain: list[MovingJoint]) -> list[str]:
    """The joints of the chain that one actuator moves together through a tendon."""
    names = {node.name for node in chain}
    for actuator in spec.actuators:
        if actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON and (tendon := spec.tendon(actuator.target)):
            found = [wrap.target.name for wrap in tendon.path if wrap.target is not None]
            if len(moved := [name for name in found if name in names]) > 1:
                return moved
    return []


def moved_by_loop(
    spec: mujoco.MjSpec, chain: list[MovingJoint], driven: Container[str]
) -> MovingJoint | None:
    """The first joint of the chain that has no drive, if a closed loop in the file connects the chain to
    other links; otherwise None.
    """
    bodies = {body.name for node in chain for body in rigid_with(node.joint.parent)}
    if not bodies & set(_tied(spec)):
        return None
    return next((node for node in chain if node.name not in driven), None)


def rigid_with(body: mujoco.MjsBody) -> list[mujoco.MjsBody]:
    """The body and all its descendants that no joint moves relative to it, in file order."""
    found, pending = [], [body]
    while pending:
        found.append(each := pending.pop())
        pending += (child for child in reversed(each.bodies) if not child.joints)
    return found


def _is_within(body: mujoco.MjsBody | None, other: mujoco.MjsBody) -> bool:
    while body is not None and body != other:
        body = body.parent
    return body is not None


def _unit(joint: mujoco.MjsJoint, degrees: bool) -> float:
    return np.pi / 180.0 if degrees and joint.type == mujoco.mjtJoint.mjJNT_HINGE else 1.0


def _tied(spec: mujoco.MjSpec) -> Iterator[str]:
    """The bodies that the file connects to another body, which closes a loop.

    A connection to a mocap body is ignored, because it is a handle that a program uses to pull the arm.
    """
    for each in spec.equalities:
        if each.type in LOOPS:
            names = [each.name1, each.name2]
            if each.objtype == mujoco.mjtObj.mjOBJ_SITE:
                names = [site.parent.name if (site := spec.site(name)) else name for name in names]
            if not any((body := spec.body(name)) and body.mocap for name in names):
                yield from names
