"""URDF as a MuJoCo specification.

MuJoCo reads what counts alone: checked links and joints, limits as the format means them, and
meshes as convex solids in metres. So errors of the file are found before, with their lines.
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
"""What counts of a fixed joint: a <mimic> means nothing there."""
MAX_NAME = 250
"""Longer names are no files; the system rejects them."""
DIRECTORIES = ("meshdir", "texturedir", "assetdir", "autolimits")
"""Compiler options that do not fit the copy."""


def read_joints(file: Path, root: Element, still: Container[str]) -> mujoco.MjSpec:
    """The specification of a URDF that `check_urdf` accepts, without shapes and masses; only what counts is
    left in `root`. It is read in no time, so what its joints are refused for needs no wait for the meshes.

    Args:
        still: the joints that stay where they are.

    Raises:
        ConfigError: names the joint and the way out.
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
    """The whole specification, after `read_joints`.

    Raises:
        ConfigError: names the link or the mesh, and the way out.
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
    """Put the root link on another one, as it would become MuJoCo's world and lose its name."""
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
    """Remove what is for other programs, or only to be seen."""
    for parent in list(root.iter()):
        kept = CHILDREN.get(parent.tag)
        if parent.tag == "joint" and parent.get("type") == "fixed":
            kept = FIXED
        for child in list(parent) if kept else []:
            if child.tag not in (kept or ()):
                parent.remove(child)


def _apply_meshdir(file: Path, root: Element) -> None:
    """Name the meshes that are in the compiler's `meshdir` by their path, as MuJoCo finds them: without
    `strippath="false"` only the last part of a name counts.
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
    """Have a <collision> for each convex solid of a mesh."""
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
                f"{where(file, joint)}: joint {name!r} is {kind}: the base must stand; make it "
                f"fixed, or keep it where it is with {typed('--without', str(name))}"
            )
        joint.set("type", "fixed")
