"""Checks that a URDF describes a robot: its links and joints have names and form one tree, and its numbers
are valid.

Every error names the line, the joint or link, the value and a remedy.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element

from cobot.errors import ConfigError
from cobot.xml_file import is_printable, number, numbers, shown, where

MAX_LINKS = 1000
MAX_ORIGIN_M = 1000.0
JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
SHAPES = {"box": (("size", 3),), "cylinder": (("radius", 1), ("length", 1)), "sphere": (("radius", 1),),
          "capsule": (("radius", 1), ("length", 1))}  # fmt: skip
"""Shapes other than meshes, with their dimensions and the number of values in each dimension."""
ZERO = (0.0, 0.0, 0.0)
LISTED = 10
"""Maximum number of names in a message."""


def check_urdf(file: Path, root: Element) -> None:
    """Reject a URDF that is not one tree of links, or that contains invalid numbers.

    Raises:
        ConfigError: see the module.
    """
    links = _named(file, root, "link")
    joints = _named(file, root, "joint")
    if not links:
        raise ConfigError(f"{where(file, root)}: <robot> has no <link>; use the file of a complete robot")
    if (compiler := root.find("mujoco/compiler")) is not None:
        for option in ("boundmass", "boundinertia", "settotalmass"):
            number(file, compiler, option, "the extension for MuJoCo", 0.0)
    for link in links.values():
        _check_link(file, link)
    for joint in joints.values():
        _check_joint(file, joint, joints)
    _check_tree(file, links, joints)


def drop_points(file: Path, root: Element) -> list[str]:
    """Remove each <collision> whose shape is only a point, such as a placeholder. Returns a sentence for
    each.

    Raises:
        ConfigError: a dimension is not a number.
    """
    said = []
    for link in root.findall("link"):
        of = f"link {link.get('name')!r}"
        for collision in link.findall("collision"):
            shape = collision.find("geometry/*")
            if shape is None or shape.tag not in SHAPES:
                continue
            sizes = [numbers(file, shape, dimension, of, count) for dimension, count in SHAPES[shape.tag]]
            if not any(map(any, sizes)):
                link.remove(collision)
                said.append(f"{link.get('name')}: a <{shape.tag}> of size 0 is left out")
    return said


def listed(names: list[str]) -> str:
    """Names for a message: either all of them, or the first few and their total number."""
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return ", ".join(names[:LISTED]) + more


def _named(file: Path, root: Element, tag: str) -> dict[str, Element]:
    """The elements with this tag that are directly below <robot>, by name. A <joint> in a <transmission> has
    a different meaning.
    """
    found: dict[str, Element] = {}
    for element in root.findall(tag):
        name = element.get("name")
        if name is None or not is_printable(name):
            told = "has no name" if not name else f"has the name {shown(name)}"
            raise ConfigError(
                f"{where(file, element)}: a <{tag}> {told}; give it a printable name of 1 to 200 characters "
                "without spaces at its ends"
            )
        if name in found:
            raise ConfigError(
                f"{where(file, element)}: {tag} {name!r} has the name of the {tag} in line "
                f"{getattr(found[name], 'line', 0)}; rename one of them"
            )
        found[name] = element
    if len(found) > MAX_LINKS:
        raise ConfigError(f"{file}: has {len(found)} <{tag}> elements; at most {MAX_LINKS} are allowed")
    return found


def _check_link(file: Path, link: Element) -> None:
    of = f"link {link.get('name')!r}"
    if (inertial := link.find("inertial")) is not None:
        _check_origin(file, inertial, of)
        if (tensor := inertial.find("inertia")) is not None and tensor.attrib:
            for moment in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
                number(file, tensor, moment, of)
        if (mass := inertial.find("mass")) is not None:
            number(file, mass, "value", of)
    for collision in link.findall("collision"):
        check_shape(file, collision, of)


def check_shape(file: Path, collision: Element, of: str) -> None:
    """Reject a <collision> or <visual> element that has no shape or an invalid one."""
    _check_origin(file, collision, of)
    geometry = collision.find("geometry")
    shape = None if geometry is None else next(iter(geometry), None)
    if shape is None:
        raise ConfigError(
            f"{where(file, collision)}: {of}: its <{collision.tag}> has no shape; give its "
            f"<geometry> a <mesh>, <{'>, <'.join(SHAPES)}>, or remove the <{collision.tag}>"
        )
    if shape.tag == "mesh":
        _check_mesh(file, shape, of)
    elif shape.tag not in SHAPES:
        raise ConfigError(
            f"{where(file, shape)}: {of}: <{shape.tag}> is not a shape of URDF; valid shapes: mesh, "
            f"{', '.join(SHAPES)}"
        )
    for dimension, count in SHAPES.get(shape.tag, ()):
        if min(numbers(file, shape, dimension, of, count)) <= 0.0:
            raise ConfigError(
                f"{where(file, shape)}: {of}: {dimension} of <{shape.tag}> is "
                f"{shown(shape.get(dimension, ''))}; it must be above 0 m"
            )


def _check_mesh(file: Path, mesh: Element, of: str) -> None:
    if not mesh.get("filename"):
        raise ConfigError(f"{where(file, mesh)}: {of}: its <mesh> has no filename")
    if 0.0 in numbers(file, mesh, "scale", of, 3, (1.0, 1.0, 1.0)):
        raise ConfigError(f"{where(file, mesh)}: {of}: scale of <mesh> must not contain 0")


def _check_joint(file: Path, joint: Element, joints: dict[str, Element]) -> None:
    of, kind = f"joint {joint.get('name')!r}", joint.get("type")
    if kind not in JOINT_TYPES:
        told = "no type" if kind is None else f"the type {shown(kind)}"
        raise ConfigError(f"{where(file, joint)}: {of} has {told}; valid types: {', '.join(JOINT_TYPES)}")
    _check_origin(file, joint, of)
    axis = joint.find("axis")
    if axis is not None and kind != "fixed" and not any(numbers(file, axis, "xyz", of, 3, (1.0, 0.0, 0.0))):
        raise ConfigError(f"{where(file, axis)}: {of}: its axis is 0 0 0; give it a direction")
    if (dynamics := joint.find("dynamics")) is not None:
        for attribute in ("damping", "friction"):
            if (value := number(file, dynamics, attribute, of, 0.0)) < 0.0:
                raise ConfigError(
                    f"{where(file, dynamics)}: {of}: {attribute} is {value:g}; it must be 0 or more"
                )
    if (mimic := joint.find("mimic")) is not None and kind != "fixed":
        _check_mimic(file, mimic, of, joints)


def _check_mimic(file: Path, mimic: Element, of: str, joints: dict[str, Element]) -> None:
    number(file, mimic, "multiplier", of, 1.0)
    number(file, mimic, "offset", of, 0.0)
    if mimic.get("joint") not in joints:
        raise ConfigError(
            f"{where(file, mimic)}: {of} mimics {shown(mimic.get('joint') or '')}, which is not a joint "
            f"of this file; valid names: {listed(list(joints))}"
        )


def _check_origin(file: Path, element: Element, of: str) -> None:
    if (origin := element.find("origin")) is not None:
        if max(map(abs, numbers(file, origin, "xyz", of, 3, ZERO))) > MAX_ORIGIN_M:
            raise ConfigError(
                f"{where(file, origin)}: {of}: xyz of <origin> is {shown(origin.get('xyz', ''))}; up to "
                f"{MAX_ORIGIN_M:g} m are allowed, and URDF uses metres"
            )
        numbers(file, origin, "rpy", of, 3, ZERO)


def _check_tree(file: Path, links: dict[str, Element], joints: dict[str, Element]) -> None:
    """Check that there is one root, that each other link has exactly one parent, and that all links are below
    the root.
    """
    above: dict[str, tuple[str, Element]] = {}
    below: dict[str, list[str]] = {name: [] for name in links}
    for name, joint in joints.items():
        parent, child = (_end(file, joint, name, end, links) for end in ("parent", "child"))
        if child in above:
            other, other_joint = above[child]
            raise ConfigError(
                f"{where(file, joint)}: link {child!r} is the child of two joints, {other!r} (line "
                f"{getattr(other_joint, 'line', 0)}) and {name!r}; a URDF is a tree, so remove one of them"
            )
        above[child] = name, joint
        below[parent].append(child)
    roots = [name for name in links if name not in above]
    if len(roots) > 1:
        raise ConfigError(
            f"{where(file, links[roots[1]])}: the URDF has several root links (links that are not the child "
            f"of a joint): {listed(roots)}. Exactly one is allowed; connect the others or remove them"
        )
    reached, pending = set(roots), list(roots)
    while pending:
        for child in below[pending.pop()]:
            reached.add(child)
            pending.append(child)
    if loop := [name for name in links if name not in reached]:
        joint = above[loop[0]][1]
        raise ConfigError(
            f"{where(file, joint)}: the joints connect these links in a loop: {listed(loop)}; a URDF is "
            "a tree, so remove the joint that closes the loop"
        )


def _end(file: Path, joint: Element, name: str, end: str, links: dict[str, Element]) -> str:
    element = joint.find(end)
    link = None if element is None else element.get("link")
    if link not in links:
        told = "names no link" if link is None else f"is {shown(link)}, which is not a link of this file"
        place = where(file, joint if element is None else element)
        raise ConfigError(f"{place}: joint {name!r}: its <{end}> {told}; valid names: {listed(list(links))}")
    return link
