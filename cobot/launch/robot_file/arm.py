"""Finds the joints of the arm in a file. They are the chain from the base to the TCP, without fingers."""

from __future__ import annotations

import re
from collections.abc import Container
from pathlib import Path
from xml.etree.ElementTree import Element

import mujoco

from cobot.errors import ConfigError
from cobot.launch.robot_file.telescope import find_telescopes
from cobot.launch.robot_file.tree import (
    MOVABLE,
    JointTree,
    MovingJoint,
    moved_by_loop,
    moved_together,
    rigid_with,
)
from cobot.launch.robot_file.typed import typed
from cobot.xml_file import where

TCP_NAMES = tuple(
    re.compile(rf"(?:^|[^a-z]){name}(?:_?(?:link|frame|site|point))?$", re.IGNORECASE)
    for name in (
        "tcp", "tool0", "grasp(?:ing)?(?:_center)?", "pinch", "gripper_?frame", "tool", "attachment", "ee",
        "eef", "end_?effector", "grip", "flange",
    )
)  # fmt: skip
"""Names of sites and links that are probably the TCP, the most probable first."""
RIVAL_JOINTS = 4
"""Minimum number of joints of a second arm. A chain with fewer joints of its own is a head or a wheel."""


def find_arm(
    file: Path, root: Element, spec: mujoco.MjSpec, tree: JointTree, tcp: str | None
) -> list[MovingJoint]:
    """The joints of the arm in order from the base, including all joints of a telescope.

    Args:
        root: the root element of the file, for the line numbers in messages.
        tcp: the site or body at the end of the chain; None if the file has only one arm.

    Raises:
        ConfigError: there is no joint, the TCP does not exist, there are several arms, or joints of the arm
            are coupled.
    """
    chain = _only_arm(file, tree) if tcp is None else _chain_to(file, spec, tree, tcp)
    if not chain:
        raise ConfigError(f"{file}: has no joint that moves; use the file of a complete arm")
    if unnamed := next((node for node in chain if not node.joint.name), None):
        body = unnamed.joint.parent.name
        raise ConfigError(
            f"{file}: the joint of {body!r} has no name; give each joint of the arm its own name"
        )
    if tree.is_finger(chain[0]):
        raise ConfigError(
            f"{file}: has no arm: its joints are those of a gripper ({', '.join(tree.nodes)}); give the file "
            "of an arm, or name the joints to be moved with --actuators"
        )
    if ball := tree.ball_below(chain[0]):
        raise ConfigError(
            f"{file}: the arm has a ball joint, at {ball.parent.name!r}; cobot moves hinges and slides: "
            "describe it as three hinges"
        )
    _require_serial(file, root, spec, chain)
    return chain


def named_arm(
    file: Path, root: Element, spec: mujoco.MjSpec, tree: JointTree, names: Container[str]
) -> list[MovingJoint]:
    """The joints with the given names, and the other joints of their telescopes, in the file's order.

    Raises:
        ConfigError: one of them is neither rotary nor linear, or has no name; or joints are coupled.
    """
    for joint in spec.joints:
        if joint.name in names and joint.type not in MOVABLE:
            raise ConfigError(
                f"{file}: joint {joint.name!r} is a free or ball joint: an arm has a fixed base, and only "
                f"hinge and slide joints; remove the joint from the file, or leave it out of --actuators"
            )
    stages = {
        other.name
        for leaf in tree.leaves()
        for telescope in find_telescopes(spec, leaf.path)
        if telescope.first.name in names
        for other in telescope.others
    }
    chain = [node for name, node in tree.nodes.items() if name in names or name in stages]
    if not chain:
        raise ConfigError(f"{file}: has no joint that moves; use the file of a complete arm")
    _require_serial(file, root, spec, chain)
    return chain


def _require_serial(file: Path, root: Element, spec: mujoco.MjSpec, chain: list[MovingJoint]) -> None:
    """Reject an arm in which a joint does not move independently. A telescope is treated as one joint.

    Raises:
        ConfigError: there is such a joint; the message names the joint, its line and the remedies.
    """
    stages = {other for telescope in find_telescopes(spec, chain) for other in telescope.others}
    chain = [node for node in chain if node not in stages]
    if followers := [node for node in chain if node.leader]:
        pairs = ", ".join(f"{node.name!r} follows {node.leader!r}" for node in followers)
        place = where(file, _mimic(root, followers[0].name))
        raise _coupled(place, f"{pairs} (mimic)", [node.name for node in followers])
    if coupled := moved_together(spec, chain):
        raise _coupled(str(file), f"one actuator drives {', '.join(coupled)} through a tendon", coupled[1:])
    driven = {actuator.target for actuator in spec.actuators}
    if driven and (passive := moved_by_loop(spec, chain, driven)):
        element = next((each for each in root.iter("joint") if each.get("name") == passive.name), None)
        raise ConfigError(
            f"{where(file, element)}: joint {passive.name!r} of the arm has no actuator: a closed loop of "
            "links moves it, but cobot needs one drive per joint. Describe the arm as one chain of driven "
            f"joints, or fix it at its position in the file: {typed('--without', passive.name)}"
        )


def _mimic(root: Element, follower: str) -> Element | None:
    """The element that makes a joint follow another joint: <mimic> in URDF, <equality><joint> in MJCF."""
    for joint in root.iter("joint"):
        if joint.get("name") == follower and (mimic := joint.find("mimic")) is not None:
            return mimic
        if joint.get("joint1") == follower:
            return joint
    return None


def _coupled(place: str, what: str, names: list[str]) -> ConfigError:
    them, their = ("them", "their positions") if len(names) > 1 else ("it", "its position")
    return ConfigError(
        f"{place}: joints of the arm are coupled: {what}; cobot needs one drive per joint (exception: slides "
        "along one axis). Describe the coupled joints as one joint, or fix "
        f"{them} at {their} in the file: {typed('--without', *names)}"
    )


def guess_tcp(last_link: mujoco.MjsBody) -> tuple[str, bool]:
    """A site or body that moves with the last link, and whether its name shows that it is the TCP. If no name
    shows this, the last body before the fingers is used.
    """
    bodies = rigid_with(last_link)
    names = [name for body in bodies for name in (*(site.name for site in body.sites), body.name)]
    for pattern in TCP_NAMES:
        if known := next((name for name in names if pattern.search(name)), None):
            return known, True
    last = bodies[0]
    while len(following := [child for child in last.bodies if not child.joints]) == 1:
        last = following[0]
    return last.name, False


def _only_arm(file: Path, tree: JointTree) -> list[MovingJoint]:
    arms = _arms(tree)
    if len(arms) > 1 and not all(tree.is_finger(arm[0]) for arm in arms):
        raise ConfigError(
            f"{file}: the file has {len(arms)} chains of joints. Choose one by its end. The joints of the "
            f"others do not move, and their shapes stay: {'; '.join(map(_described, arms))}"
        )
    return arms[0] if arms else []


def _described(arm: list[MovingJoint]) -> str:
    tip = guess_tcp(arm[-1].joint.parent)[0]
    joints = f"{len(arm)} joint{'s' * (len(arm) > 1)}"
    return (
        f"{typed('--tcp', tip)} (from {arm[0].joint.parent.parent.name}, {joints}: "
        f"{', '.join(node.name for node in arm)})"
    )


def _chain_to(file: Path, spec: mujoco.MjSpec, tree: JointTree, tcp: str) -> list[MovingJoint]:
    site = spec.site(tcp)
    body = site.parent if site is not None else spec.body(tcp)
    if body is None:
        names = [element.name for element in (*spec.sites, *spec.bodies) if element.name]
        raise ConfigError(f"{file}: has no site or link {tcp!r} for the TCP; valid names: {', '.join(names)}")
    chain = tree.path_to(body.name)
    if not chain:
        raise ConfigError(f"{file}: no joint moves {tcp!r}, so it cannot be the TCP; choose another --tcp")
    return tree.without_fingers(chain)


def _arms(tree: JointTree) -> list[list[MovingJoint]]:
    """The longest chain, and other chains that could also be an arm."""
    paths = sorted(_chains(tree), key=len, reverse=True)
    if not paths:
        return []
    longest, rivals = paths[0], []
    names = {node.name for node in longest}
    for path in paths[1:]:
        own = sum(node.name not in names for node in path)
        shared = len(path) - own
        if own >= min(RIVAL_JOINTS, len(longest) - shared):
            rivals.append(path)
    return [longest, *rivals]


def _chains(tree: JointTree) -> list[list[MovingJoint]]:
    """Chains from the base to each end. They contain no fingers, rods or parts of other chains."""
    found: dict[str, list[MovingJoint]] = {}
    for leaf in tree.leaves():
        if path := _without_jaw(_without_rods(tree.without_fingers(leaf.path))):
            found[path[-1].name] = path
    inner = {node.name for path in found.values() for node in path[:-1]}
    return [path for name, path in found.items() if name not in inner]


def _without_rods(path: list[MovingJoint]) -> list[MovingJoint]:
    """The path without those joints at its end that follow other joints. They belong to a linkage, unless
    they carry the TCP.
    """
    top = len(path)
    while top and path[top - 1].leader:
        top -= 1
    is_branch = top < len(path) and top > 0 and len(path[top - 1].children) > 1
    return path[:top] if is_branch and not _has_tcp(path) else path


def _without_jaw(path: list[MovingJoint]) -> list[MovingJoint]:
    """The path without its last joint if that joint does not move the TCP. Such a joint is a jaw, regardless
    of its name.
    """
    if len(path) > RIVAL_JOINTS and not _has_tcp(path) and _has_tcp(path[:-1]):
        return path[:-1]
    return path


def _has_tcp(path: list[MovingJoint]) -> bool:
    """Whether a name on the last link of the path shows that it is the TCP."""
    return guess_tcp(path[-1].joint.parent)[1]
