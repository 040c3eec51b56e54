"""SRDF files: named positions (`group_state`), and pairs of links whose collisions are disabled."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from xml.etree import ElementTree

from cobot.errors import ConfigError
from cobot.foreign import plain_text
from cobot.types import Array, NamedPosition
from cobot.xml_file import is_printable, shown


def load_named_positions(path: Path, joint_names: tuple[str, ...], group: str) -> dict[str, NamedPosition]:
    """The named positions of a planning group by their names, in file order.

    Raises:
        ConfigError: the file is unreadable, the group is missing, a state lacks a joint or contains an
            unknown one, a value is not a finite number, or a name occurs twice.
    """
    root = _parse(path)
    groups = [str(element.get("name")) for element in root.iter("group")]
    if group not in groups:
        raise ConfigError(f"{path}: has no group {group!r}; valid names: {', '.join(groups) or 'none'}")
    positions: dict[str, NamedPosition] = {}
    for state in root.iter("group_state"):
        if state.get("group") != group:
            continue
        position = _position(path, state, joint_names, group)
        if position.name in positions:
            raise ConfigError(f"{path}: the position {position.name!r} occurs twice")
        positions[position.name] = position
    if not positions:
        raise ConfigError(f"{path}: has no group_state of group {group!r}")
    return positions


def disabled_pairs(path: Path) -> set[frozenset[str]]:
    """The pairs of links whose collisions are disabled (`disable_collisions`), by name.

    Raises:
        ConfigError: the file is unreadable, or an element lacks one of its two links.
    """
    pairs = set()
    for element in _parse(path).iter("disable_collisions"):
        first, second = element.get("link1"), element.get("link2")
        if not first or not second:
            raise ConfigError(f"{path}: a disable_collisions needs link1 and link2")
        pairs.add(frozenset((first, second)))
    return pairs


def write_srdf(
    file: Path,
    group_name: str,
    names: tuple[str, ...],
    positions: Mapping[str, Array],
    pairs: Iterable[tuple[str, str]],
) -> None:
    """Write the text of an SRDF with a planning group, named positions for the given joints, and the pairs of
    links that may touch.
    """
    root = ElementTree.Element("robot", name=group_name)
    group = ElementTree.SubElement(root, "group", name=group_name)
    for name in names:
        ElementTree.SubElement(group, "joint", name=name)
    for position, joints in positions.items():
        state = ElementTree.SubElement(root, "group_state", name=position, group=group_name)
        for name, value in zip(names, joints, strict=True):
            ElementTree.SubElement(state, "joint", name=name, value=repr(float(value)))
    for first, second in pairs:
        ElementTree.SubElement(root, "disable_collisions", link1=first, link2=second, reason="User")
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(file, encoding="utf-8", xml_declaration=True)


def _parse(path: Path) -> ElementTree.Element:
    try:
        text = path.read_text(encoding="utf-8")
        if "<!DOCTYPE" in text:  # entities could overload the parser, and an SRDF does not need them
            raise ConfigError(f"{path}: must not have a DOCTYPE")
        return ElementTree.fromstring(text)
    except FileNotFoundError as exc:
        raise ConfigError(f"{path}: no such file") from exc
    except (OSError, UnicodeDecodeError, ElementTree.ParseError) as exc:
        raise ConfigError(f"{path}: not a readable SRDF: {exc}") from exc


def _position(
    path: Path, state: ElementTree.Element, joint_names: tuple[str, ...], group: str
) -> NamedPosition:
    name = state.get("name") or ""
    if not is_printable(name):
        told = (
            f"the name {shown(name)}; give it a printable one of 1 to 200 characters" if name else "no name"
        )
        raise ConfigError(f"{path}: a group_state has {told}")
    values: dict[str, float] = {}
    for joint in state.iter("joint"):
        joint_name = joint.get("name") or ""
        if joint_name not in joint_names or joint_name in values:
            problem = (
                "occurs twice"
                if joint_name in values
                else f"is unknown; valid names: {', '.join(joint_names)}"
            )
            raise ConfigError(f"{path}: position {name!r}: joint {joint_name!r} {problem}")
        try:
            values[joint_name] = float(joint.get("value") or "")
        except ValueError as exc:
            raise ConfigError(
                f"{path}: position {name!r}: {joint_name} is not a number: {joint.get('value')!r}"
            ) from exc
        if not math.isfinite(values[joint_name]):
            raise ConfigError(f"{path}: position {name!r}: {joint_name} is not finite")
    missing = [joint for joint in joint_names if joint not in values]
    if missing:
        raise ConfigError(f"{path}: position {name!r}: {', '.join(missing)} missing")
    description = plain_text(state.get("description") or "")
    return NamedPosition(name, group, tuple(values[joint] for joint in joint_names), description)
