"""The data that `cobot new-robot --srdf` reads from an SRDF: the group, its states, and the pairs of links
whose collisions are disabled. Names that do not exist in the robot are reported.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from xml.etree.ElementTree import Element

import mujoco

from cobot.errors import ConfigError
from cobot.types import Array, vector
from cobot.xml_file import parse, where

GROUP = "arm"
"""Group name if there is no SRDF."""
OTHER_NAMES = (
    ("passive_joint", "name", "joints"),
    ("virtual_joint", "child_link", "links"),
    ("disable_default_collisions", "link", "links"),
    ("end_effector", "group", "groups"),
    ("end_effector", "parent_group", "groups"),
    ("group_state", "group", "groups"),
)
"""Elements and attributes that are not used: (element, attribute, kind). Only the names in them are
checked.
"""


@dataclass(frozen=True, slots=True)
class FileJoint:
    name: str
    parent: str
    child: str
    moves: bool


@dataclass(frozen=True, slots=True)
class Tree:
    """The joints in a robot's file and the links between them, in file order."""

    joints: tuple[FileJoint, ...]
    links: frozenset[str]

    @classmethod
    def of_urdf(cls, root: Element) -> Tree:
        """The tree of a URDF. A joint that mimics another joint is not treated as a moving joint."""
        joints = []
        for joint in root.findall("joint"):
            parent, child = (joint.find(end) for end in ("parent", "child"))
            kind = joint.get("type") in ("revolute", "continuous", "prismatic")
            joints.append(
                FileJoint(
                    joint.get("name") or "",
                    "" if parent is None else parent.get("link") or "",
                    "" if child is None else child.get("link") or "",
                    kind and joint.find("mimic") is None,
                )
            )
        return cls(tuple(joints), frozenset(link.get("name") or "" for link in root.findall("link")))

    @classmethod
    def of_mjcf(cls, spec: mujoco.MjSpec) -> Tree:
        """The tree of an MJCF file. A body without joints gets a fixed joint without a name. A solid that
        belongs to the world is treated as a link.
        """
        joints = [
            FileJoint(joint.name if joint else "", body.parent.name, body.name, joint is not None)
            for body in spec.bodies[1:]
            for joint in list(body.joints) or [None]
        ]
        links = [*spec.bodies[1:], *spec.worldbody.geoms]
        return cls(tuple(joints), frozenset(each.name for each in links if each.name))

    def above(self, link: str) -> list[FileJoint]:
        """The joints between a link and the root, beginning at the link."""
        found: list[FileJoint] = []
        while len(found) <= len(self.joints):
            joints = [joint for joint in self.joints if joint.child == link]
            if not joints:
                break
            found += joints
            link = joints[0].parent
        return found


@dataclass(slots=True)
class Semantics:
    """The data in an SRDF about one group of a robot.

    Attributes:
        group: group name.
        joints: joints that have drives; empty means the joints of the arm in the robot's file.
        base, tcp: links, if the SRDF names them.
        states: the states of all groups by name. Each state gives the joint positions by joint.
        own_states: names of the states of this group.
        pairs: links whose collisions are disabled.
        said: sentences for the report.
    """

    group: str
    joints: list[str]
    base: str | None = None
    tcp: str | None = None
    states: dict[str, dict[str, float]] = field(default_factory=dict)
    own_states: set[str] = field(default_factory=set)
    pairs: list[tuple[str, str]] = field(default_factory=list)
    said: list[str] = field(default_factory=list)

    def states_of(self, names: tuple[str, ...], of_model: dict[str, float] | None) -> dict[str, Array]:
        """Positions of the given joints in each state that defines all of them, and in the state `home` of
        the model's file.
        """
        found: dict[str, Array] = {}
        for state, values in self.states.items():
            missing = [name for name in names if name not in values]
            if not missing:
                found[state] = vector([values[name] for name in names])
            elif state in self.own_states:
                self.said.append(f"state {state!r} is left out: it has no {', '.join(missing)}")
        if of_model and "home" not in found:
            found["home"] = vector([of_model.get(name, 0.0) for name in names])
        return found


def read_srdf(file: Path, tree: Tree, group: str | None, arm: Sequence[str], only_arm: bool) -> Semantics:
    """Read an SRDF for the robot that a tree describes.

    Args:
        group: name of the chosen group. None means the only group, or the group with the joints of the arm.
        arm: the known joints of the arm.
        only_arm: whether the user has named these joints instead of a group.

    Raises:
        ConfigError: the file is not an SRDF, or the group cannot be chosen.
    """
    root, xacro = parse(file)
    if xacro or file.suffix == ".xacro":
        stem = file.name.split(".")[0]
        raise ConfigError(f"{file}: is xacro; expand it first: xacro {file.name} > {stem}.srdf")
    if root.tag != "robot":
        raise ConfigError(f"{where(file, root)}: the first element is <{root.tag}>; in an SRDF it is <robot>")
    return _Reader(file, root, tree).read(group, arm, only_arm)


class _Reader:
    def __init__(self, file: Path, root: Element, tree: Tree) -> None:
        self._file, self._root, self._tree = file, root, tree
        self._groups = {group.get("name") or "": group for group in root.findall("group")}
        self._joints = {joint.name for joint in tree.joints if joint.name}
        self._joints |= {each.get("name") or "" for each in root.findall("virtual_joint")}
        self._unknown: dict[str, list[str]] = {}

    def read(self, group: str | None, arm: Sequence[str], only_arm: bool) -> Semantics:
        movable = {name: self._movable(name) for name in self._groups}
        name = self._chosen(group, movable, arm, only_arm)
        joints = list(arm) if only_arm else movable.get(name, [])
        found = Semantics(name, joints)
        self._read_ends(found)
        self._read_states(found)
        found.pairs = self._pairs()
        self._check_others()
        ends = [f"{what} {link}" for what, link in (("base_frame", found.base), ("tcp", found.tcp)) if link]
        taken = ", ".join([f"group {name}", *ends])
        found.said.append(f"{self._file.name}: {taken}; {len(found.pairs)} pairs of links that may touch")
        found.said += [
            f"{self._file.name}: {what} that the robot does not have, left out: {', '.join(names)}"
            for what, names in self._unknown.items()
        ]
        return found

    def _chosen(
        self, group: str | None, movable: dict[str, list[str]], arm: Sequence[str], only_arm: bool
    ) -> str:
        listed = "; ".join(f"{name} ({', '.join(joints) or 'no joint'})" for name, joints in movable.items())
        if group is not None:
            if not movable.get(group):
                what = "has no joint that moves" if group in movable else "is not in the file"
                raise ConfigError(f"{self._file}: group {group!r} {what}; valid names: {listed or 'none'}")
            return group
        groups = [name for name, joints in movable.items() if joints]
        same = [name for name in groups if arm and set(movable[name]) == set(arm)]
        if only_arm or not groups:
            return next(iter(same), GROUP)
        if len(groups) > 1 and len(same) != 1:
            raise ConfigError(f"{self._file}: choose one of its groups with --group NAME: {listed}")
        return (same or groups)[0]

    def _movable(self, group: str) -> list[str]:
        passive = {str(each.get("name")) for each in self._root.findall("passive_joint")}
        wanted = self._members(group, set()) - passive
        return [joint.name for joint in self._tree.joints if joint.moves and joint.name in wanted]

    def _members(self, group: str, seen: set[str]) -> set[str]:
        """The names of a group's joints, including those of its links, chains and subgroups."""
        seen.add(group)
        names: set[str] = set()
        for element in self._groups[group]:
            name = element.get("name") or ""
            if element.tag == "joint" and self._exists("joints", name, self._joints):
                names.add(name)
            elif element.tag == "link" and self._exists("links", name, self._tree.links):
                names |= {joint.name for joint in self._tree.joints if joint.child == name}
            elif element.tag == "chain":
                names |= self._chain(element)
            elif element.tag == "group" and name not in seen and self._exists("groups", name, self._groups):
                names |= self._members(name, seen)
        return names

    def _chain(self, element: Element) -> set[str]:
        base, tip = element.get("base_link") or "", element.get("tip_link") or ""
        known = [self._exists("links", each, self._tree.links) for each in (base, tip)]
        if not all(known):
            return set()
        names = set()
        for joint in self._tree.above(tip):
            names.add(joint.name)
            if joint.parent == base:
                return names
        raise ConfigError(f"{where(self._file, element)}: the link {tip!r} is not on a chain from {base!r}")

    def _exists(self, what: str, name: str, names: Collection[str]) -> bool:
        if name in names:
            return True
        if name not in (listed := self._unknown.setdefault(what, [])):
            listed.append(name)
        return False

    def _check_others(self) -> None:
        """Report unknown names in elements that cobot does not use, or does not use for this group."""
        known = {"joints": self._joints, "links": self._tree.links, "groups": self._groups}
        for tag, attribute, what in OTHER_NAMES:
            for element in self._root.iterfind(f"{tag}[@{attribute}]"):
                self._exists(what, str(element.get(attribute)), known[what])

    def _read_ends(self, found: Semantics) -> None:
        """Read base and TCP from the group's chain. Without a chain, the TCP is that of the group's end
        effector.
        """
        group = self._groups.get(found.group)
        chains = [] if group is None else group.findall("chain")
        if len(chains) == 1 and self._chain(chains[0]):
            base, tip = chains[0].get("base_link"), chains[0].get("tip_link") or ""
            found.base = base if not any(each.moves for each in self._tree.above(base or "")) else None
            found.tcp = tip if self._is_moved(tip, found.joints) else None
        for element in self._root.findall("end_effector"):
            link, on = element.get("parent_link") or "", element.get("parent_group") or element.get("group")
            known = self._exists("links", link, self._tree.links)
            if found.tcp is None and known and on == found.group and self._is_moved(link, found.joints):
                found.tcp = link

    def _is_moved(self, link: str, joints: list[str]) -> bool:
        above = {joint.name for joint in self._tree.above(link)}
        return bool(joints) and above.issuperset(joints)

    def _read_states(self, found: Semantics) -> None:
        """Read the states. If several states have one name, the first one is used, and states of this group
        take precedence over those of other groups.
        """
        states = self._root.findall("group_state")
        for state in sorted(states, key=lambda state: state.get("group") != found.group):
            name = state.get("name") or ""
            if not name or name in found.states:
                continue
            if state.get("group") == found.group:
                found.own_states.add(name)
            found.states[name] = {
                joint.get("name") or "": self._value(name, joint)
                for joint in state.findall("joint")
                if self._exists("joints", joint.get("name") or "", self._joints)
            }

    def _value(self, state: str, joint: Element) -> float:
        text = joint.get("value") or ""
        values = [math.nan]
        with contextlib.suppress(ValueError):
            values = [float(each) for each in text.split()]  # A floating joint has seven values.
        if not values or not all(map(math.isfinite, values)):
            raise ConfigError(
                f"{where(self._file, joint)}: state {state!r}: the value of {joint.get('name')} is "
                f"{text!r}; it must be a finite number"
            )
        return values[0]

    def _pairs(self) -> list[tuple[str, str]]:
        """The pairs of links whose collisions are disabled.

        These are the pairs of `disable_collisions`, and each link of `disable_default_collisions` with every
        other link, except pairs in `enable_collisions`.
        """
        disabled = self._named_pairs("disable_collisions")
        enabled = {frozenset(pair) for pair in self._named_pairs("enable_collisions")}
        apart = {str(each.get("link")) for each in self._root.findall("disable_default_collisions")}
        disabled += [pair for pair in combinations(sorted(self._tree.links), 2) if apart.intersection(pair)]
        unique = {frozenset(pair): pair for pair in reversed(disabled) if frozenset(pair) not in enabled}
        return list(reversed(unique.values()))

    def _named_pairs(self, tag: str) -> list[tuple[str, str]]:
        pairs = []
        for element in self._root.findall(tag):
            first, second = element.get("link1") or "", element.get("link2") or ""
            known = [self._exists("links", each, self._tree.links) for each in (first, second)]
            if all(known) and first != second:
                pairs.append((first, second))
        return pairs
