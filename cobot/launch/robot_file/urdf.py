"""URDF as a MuJoCo specification."""

from __future__ import annotations

import tempfile
from collections.abc import Container, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco

from cobot.errors import ConfigError
from cobot.launch.robot_file.meshes import find_mesh
from cobot.launch.robot_file.mjcf import read_mjcf


def read_urdf(file: Path, root: Element, still: Container[str], packages: Sequence[Path]) -> mujoco.MjSpec:
    """Its root link would become the world and lose its name, so it gets a parent.

    Args:
        still: the joints that stay where they are.
        packages: folders, in which or as which the packages of package://NAME/... are looked for.

    Raises:
        ConfigError: names the joint, the link or the mesh, and the way out.
    """
    for joint in root.iter("joint"):
        _check_joint(file, joint, still)
    children = {child.get("link") for child in root.iter("child")}
    first = [link.get("name") for link in root.iter("link") if link.get("name") not in children]
    if len(first) != 1:
        raise ConfigError(f"{file}: needs one root link, has {', '.join(map(str, first)) or 'none'}")
    SubElement(root, "link", name="cobot_world")
    stand = SubElement(root, "joint", name="cobot_stand", type="fixed")
    SubElement(stand, "parent", link="cobot_world")
    SubElement(stand, "child", link=str(first[0]))
    for link in root.iter("link"):
        for seen in link.findall("visual"):
            link.remove(seen)
    for mesh in root.iter("mesh"):
        mesh.set("filename", str(find_mesh(file, mesh.get("filename") or "", packages)))
    extension = root.find("mujoco")
    extension = SubElement(root, "mujoco") if extension is None else extension
    compiler = extension.find("compiler")
    compiler = SubElement(extension, "compiler") if compiler is None else compiler
    compiler.attrib.pop("meshdir", None)
    compiler.set("strippath", "false")
    compiler.set("fusestatic", "false")
    with tempfile.TemporaryDirectory() as place:
        expanded = Path(place) / "robot.urdf"
        ElementTree.ElementTree(root).write(expanded)
        spec = read_mjcf(expanded, file)
    spec.compiler.fusestatic = False
    return spec


def _check_joint(file: Path, joint: Element, still: Container[str]) -> None:
    name, kind = joint.get("name"), joint.get("type")
    if kind in ("floating", "planar"):
        if name not in still:
            raise ConfigError(
                f"{file}: joint {name!r} is {kind}: the base must stand; make it fixed, or keep it where it "
                f"is with --without {name}"
            )
        joint.set("type", "fixed")
