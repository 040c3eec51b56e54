"""Removes the joints that do not move from a specification."""

from __future__ import annotations

from collections.abc import Container, Iterable

import mujoco
import numpy as np

from cobot.launch.robot_file.tree import LOOPS, JointTree, MovingJoint
from cobot.robot.quaternion import Quaternion, exp, normalised, product, rotated


def keep_joints(spec: mujoco.MjSpec, kept: Container[str]) -> dict[str, float]:
    """Remove all joints except `kept`, everything that refers to the removed joints, and all actuators,
    sensors and keys.

    Mocap bodies do not move.

    Returns:
        The position at which each removed joint stays, rad or m.
    """
    for element in (*spec.actuators, *spec.sensors, *spec.keys):
        spec.delete(element)
    for body in spec.bodies:
        body.mocap = False
    tree = JointTree(spec)
    resting = tree.resting(bool(spec.compiler.degree))
    left = {name: node for name, node in tree.nodes.items() if name not in kept}
    place(spec, {node: resting[name] for name, node in left.items()})
    gone = [joint for joint in spec.joints if joint.name not in kept]
    names = [joint.name for joint in gone if joint.name]
    for joint in gone:
        spec.delete(joint)
    lost = set(names)
    for tendon in list(spec.tendons):
        if any(wrap.target is None or wrap.target.name in lost for wrap in tendon.path):
            lost.add(tendon.name)
            spec.delete(tendon)
    for equality in list(spec.equalities):
        if equality.type in LOOPS or {equality.name1, equality.name2} & lost:
            spec.delete(equality)
    return {name: resting.get(name, 0.0) for name in [*names, *left]}


def remove_shapes(branches: Iterable[MovingJoint]) -> None:
    """Remove the shapes of the links that the given joints move. The masses of these links remain."""
    for branch in branches:
        pending = [branch.joint.parent]
        while pending:
            body = pending.pop()
            pending.extend(body.bodies)
            for geom in body.geoms:  # without an <inertial>, the shapes define its mass, so they stay
                geom.contype = geom.conaffinity = 0


def place(spec: mujoco.MjSpec, resting: dict[MovingJoint, float]) -> None:
    """Move each body to the pose that it has at the given position of its joint, rad or m."""
    degrees = bool(spec.compiler.degree)
    for node, at in resting.items():
        if (by := at - node.reference(degrees)) == 0.0:
            continue
        joint, body = node.joint, node.joint.parent
        turn, after, shift = orientation(spec, body), (1.0, 0.0, 0.0, 0.0), np.zeros(3)
        motion = by * np.array(joint.axis) / np.linalg.norm(joint.axis)
        if joint.type == mujoco.mjtJoint.mjJNT_SLIDE:
            shift = motion
        else:
            after = exp(motion.tolist())
            shift = joint.pos - rotated(after, joint.pos.tolist())
        body.pos = body.pos + rotated(turn, shift.tolist())
        body.quat = product(turn, after)
        body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT


def orientation(spec: mujoco.MjSpec, body: mujoco.MjsBody) -> Quaternion:
    """Orientation of a body in its parent's frame. Any of MuJoCo's notations is accepted."""
    if body.alt.type == mujoco.mjtOrientation.mjORIENTATION_QUAT:
        return normalised(body.quat)
    alone = mujoco.MjSpec()
    alone.compiler.degree, alone.compiler.eulerseq = spec.compiler.degree, spec.compiler.eulerseq
    copy = alone.worldbody.add_body()
    for name in ("type", "axisangle", "xyaxes", "zaxis", "euler"):
        setattr(copy.alt, name, getattr(body.alt, name))
    return normalised(alone.compile().body_quat[1])
