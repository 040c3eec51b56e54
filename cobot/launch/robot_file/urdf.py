"""URDF as a MuJoCo specification.

MuJoCo only gets links and joints that have been checked, limits as the URDF format defines them, and meshes
as convex solids in metres. So errors in the file are found, with their line numbers, before MuJoCo reads it.
"""

from __future__ import annotations

import copy
import tempfile
from collections.abc import Container
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco

from cobot.errors import ConfigError
from cobot.launch.robot_file.meshes import Meshes
from cobot.launch.robot_file.mjcf import load_spec
from cobot.launch.robot_file.typed import typed
from cobot.launch.robot_file.urdf_limits import state_limits
from cobot.xml_file import where

WORLD = "cobot_world"
CHILDREN = {
    "robot": ("link", "joint", "mujoco"),
    "link": ("inertial", "collision"),
    "joint": ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic"),
    "mujoco": ("compiler", "option"),
}
FIXED = ("origin", "parent", "child")
"""Elements that are kept in a fixed joint. A <mimic> has no effect in a fixed joint."""
MAX_NAME = 250
"""Maximum length of a file name, because the system rejects longer ones."""
DIRECTORIES = ("meshdir", "texturedir", "assetdir", "autolimits")
"""Compiler options that would be wrong for the copy in the new folder."""


def read_joints(file: Path, root: Element, still: Container[str]) -> mujoco.MjSpec:
    """The specification of a URDF that `check_urdf` accepts, but without shapes and masses. Unused elements
    are removed from `root`. This is quick, so invalid joints are reported before the meshes are read.

    Args:
        still: the joints that are kept fixed.

    Raises:
        ConfigError: a joint is not valid; the message names the joint and the remedy.
    """
    state_limits(file, root)
    for joint in root.findall("joint"):
        _check_joint(file, joint, still)
    _strip(root)
    _apply_meshdir(file, root)
    _add_world(root)
    _set_compiler(root)
    bare = copy.deepcopy(root)
    for link in bare.findall("link"):
        link[:] = []
    return _load(file, bare)


def read_urdf(file: Path, root: Element, meshes: Meshes) -> mujoco.MjSpec:
    """The complete specification. Call it after `read_joints`.

    Raises:
        ConfigError: a link or a mesh is not valid; the message names it and the remedy.
    """
    for link in root.findall("link"):
        _replace_meshes(link, meshes)
    spec = _load(file, root)
    spec.modelfiledir, spec.compiler.meshdir = str(meshes.folder), meshes.SUBFOLDER
    for mesh in spec.meshes:
        mesh.file = Path(mesh.file).name
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    return spec


def _load(file: Path, root: Element) -> mujoco.MjSpec:
    with tempfile.TemporaryDirectory() as place:
        expanded = Path(place) / "robot.urdf"
        ElementTree.ElementTree(root).write(expanded)
        spec = load_spec(file, expanded)
    spec.compiler.fusestatic = False
    return spec


def _add_world(root: Element) -> None:
    """Put the root link on a new link. Otherwise the root link would become MuJoCo's world and lose its
    name.
    """
    children = {child.get("link") for child in root.iter("child")}
    names = [str(link.get("name")) for link in root.findall("link")]
    first = next(name for name in names if name not in children)
    world = WORLD
    while world in names:
        world += "_"
    SubElement(root, "link", name=world)
    stand = SubElement(root, "joint", name=f"{world}_joint", type="fixed")
    SubElement(stand, "parent", link=world)
    SubElement(stand, "child", link=first)


def _strip(root: Element) -> None:
    """Remove elements that are only for other programs or only visual."""
    for parent in list(root.iter()):
        kept = CHILDREN.get(parent.tag)
        if parent.tag == "joint" and parent.get("type") == "fixed":
            kept = FIXED
        for child in list(parent) if kept else []:
            if child.tag not in (kept or ()):
                parent.remove(child)


def _apply_meshdir(file: Path, root: Element) -> None:
    """Replace the names of meshes by their paths in the compiler's `meshdir`, as MuJoCo does. Unless the file
    contains `strippath="false"`, only the last part of each name is used.
    """
    compiler = root.find("mujoco/compiler")
    folder = "" if compiler is None else compiler.get("meshdir") or compiler.get("assetdir") or ""
    if compiler is None or not folder:
        return
    for mesh in root.iter("mesh"):
        name = mesh.get("filename") or ""
        if compiler.get("strippath") != "false":
            name = name.rpartition("/")[2]
        if 0 < len(name) <= MAX_NAME and (path := file.parent / folder / name).is_file():
            mesh.set("filename", str(path.resolve()))


def _replace_meshes(link: Element, meshes: Meshes) -> None:
    """Replace each mesh by a <collision> element for each of its convex solids."""
    for collision in link.findall("collision"):
        mesh = collision.find("geometry/mesh")
        if mesh is None:
            continue
        link.remove(collision)
        for solid in meshes.solids(mesh, str(link.get("name"))):
            part = SubElement(link, "collision")
            if (origin := collision.find("origin")) is not None:
                part.append(origin)
            SubElement(SubElement(part, "geometry"), "mesh", filename=str(solid))


def _set_compiler(root: Element) -> None:
    extension = root.find("mujoco")
    extension = SubElement(root, "mujoco") if extension is None else extension
    compiler = extension.find("compiler")
    compiler = SubElement(extension, "compiler") if compiler is None else compiler
    for option in DIRECTORIES:
        compiler.attrib.pop(option, None)
    compiler.set("strippath", "false")
    compiler.set("fusestatic", "false")


def _check_joint(file: Path, joint: Element, still: Container[str]) -> None:
    name, kind = joint.get("name"), joint.get("type")
    if kind in ("floating", "planar"):
        if name not in still:
            raise ConfigError(
                f"{where(file, joint)}: joint {name!r} is {kind}: the base must be fixed; make it "
                f"fixed, or keep it where it is with {typed('--without', str(name))}"
            )
        joint.set("type", "fixed")
