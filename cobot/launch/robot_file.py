"""A URDF or MJCF file as MuJoCo's specification, and that as model.xml: what `cobot new-robot` reads and
writes.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Container, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np

from cobot.errors import ConfigError

MESHES = (".stl", ".obj", ".msh")
EXACT = {
    "body": {"pos": "pos", "quat": "quat"},
    "joint": {"pos": "pos", "axis": "axis", "range": "range"},
    "site": {"pos": "pos", "quat": "quat"},
}
INERTIAL = {"pos": "ipos", "quat": "iquat", "mass": "mass", "diaginertia": "inertia"}
"""Attributes of the file that are written with all digits, and what MuJoCo calls them."""


def read_xml(file: Path) -> Element:
    """The root of a URDF or MJCF file.

    Raises:
        ConfigError: there is none, or it is another kind of file; of xacro it says how to expand it.
    """
    if not file.is_file():
        raise ConfigError(f"{file}: {'is no file' if file.exists() else 'no such file'}")
    try:
        text = file.read_text(encoding="utf-8")
        if file.suffix == ".xacro" or "ros.org/wiki/xacro" in text or "<xacro:" in text:
            stem = file.name.split(".")[0] + ("" if file.suffix == ".xacro" else "_expanded")
            raise ConfigError(f"{file}: is xacro; expand it first: xacro {file.name} > {stem}.urdf")
        if "<!DOCTYPE" in text:
            raise ConfigError(f"{file}: must not have a DOCTYPE")
        root = ElementTree.fromstring(text)
    except (OSError, UnicodeDecodeError, ElementTree.ParseError) as exc:
        raise ConfigError(f"{file}: is neither a readable URDF nor MJCF: {exc}") from exc
    if root.tag not in ("robot", "mujoco"):
        raise ConfigError(f"{file}: begins with <{root.tag}>, must be <robot> (URDF) or <mujoco> (MJCF)")
    return root


def read_urdf(file: Path, root: Element, still: Container[str], packages: Sequence[Path]) -> mujoco.MjSpec:
    """Its root link would become the world and lose its name, so it gets a parent.

    Args:
        still: the joints that stay at 0, and may mimic others.
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
        mesh.set("filename", str(_mesh(file, mesh.get("filename") or "", packages)))
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


def read_mjcf(file: Path, named: Path | None = None) -> mujoco.MjSpec:
    """Args:
        named: what messages call it.

    Raises:
        ConfigError: MuJoCo's reason.
    """
    try:
        return mujoco.MjSpec.from_file(str(file))
    except ValueError as exc:
        raise ConfigError(f"{named or file}: MuJoCo cannot read it: {' '.join(str(exc).split())}") from exc


def mjcf_rates(spec: mujoco.MjSpec) -> dict[str, tuple[float, float]]:
    """What `urdf_rates` is, by a MJCF file's actuators, which know no velocity: what the strongest of a joint
    can do, by its range of forces, or of a motor's commands.
    """
    rates: dict[str, tuple[float, float]] = {}
    for actuator in spec.actuators:
        if actuator.trntype not in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
            continue
        effort = 0.0
        if _limited(actuator.forcelimited, actuator.forcerange):
            effort = float(np.abs(actuator.forcerange).min())
        elif actuator.biastype == mujoco.mjtBias.mjBIAS_NONE and _limited(
            actuator.ctrllimited, actuator.ctrlrange
        ):
            effort = float(np.abs(actuator.ctrlrange).min() * abs(actuator.gainprm[0]))
        effort *= abs(float(actuator.gear[0]))
        rates[actuator.target] = (0.0, max(effort, rates.get(actuator.target, (0.0, 0.0))[1]))
    return rates


def keep_joints(file: Path, spec: mujoco.MjSpec, kept: Container[str]) -> list[str]:
    """Take away all other joints, and what names them; returns their names. Actuators, sensors and keys go
    altogether.

    Raises:
        ConfigError: a joint that stays is no hinge or slide, or has no name.
    """
    for element in (*spec.actuators, *spec.sensors, *spec.keys):
        spec.delete(element)
    gone = [joint.name for joint in spec.joints if joint.name not in kept]
    for joint in list(spec.joints):
        if joint.name in gone:
            spec.delete(joint)
        elif joint.type not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
            raise ConfigError(
                f"{file}: joint {joint.name!r} is a free or ball joint: an arm has a base that "
                "stands, and hinges and slides; take the joint out of the file, or name the arm's with "
                "--actuators: all others then stay at 0"
            )
        elif not joint.name:
            raise ConfigError(f"{file}: a joint has no name of its own; each needs one")
    lost = set(gone)
    for tendon in list(spec.tendons):
        if any(wrap.target is None or wrap.target.name in gone for wrap in tendon.path):
            lost.add(tendon.name)
            spec.delete(tendon)
    for equality in list(spec.equalities):
        if {equality.name1, equality.name2} & lost:
            spec.delete(equality)
    return gone


def collect_meshes(file: Path, spec: mujoco.MjSpec, folder: Path) -> None:
    """Copy them and the height fields into the folder, so that it may be moved. Textures go: nobody looks.

    Raises:
        ConfigError: one is not there or cannot be copied.
    """
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)
    source = Path(spec.modelfiledir or file.parent) / (spec.compiler.meshdir or "")
    for index, shape in enumerate((*spec.meshes, *spec.hfields)):
        if not shape.file:
            continue
        path = source / shape.file
        if not path.is_file():
            raise ConfigError(f"{file}: there is no mesh {path}")
        shape.name = shape.name or path.stem
        shape.file = f"{index}_{path.name}"
        try:
            (folder / "meshes").mkdir(exist_ok=True)
            shutil.copyfile(path, folder / "meshes" / shape.file)
        except OSError as exc:
            raise ConfigError(f"{file}: mesh {path} cannot be copied: {exc.strerror}") from exc
    spec.modelfiledir, spec.compiler.meshdir = str(folder), "meshes"


def compiled(file: Path, spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Raises:
    ConfigError: MuJoCo's reason, and what to do about links without inertia.
    """
    try:
        return spec.compile()
    except ValueError as exc:
        said = " ".join(str(exc).split())
        advice = "; each link that moves needs an <inertial>" if "inertia" in said else ""
        raise ConfigError(f"{file}: MuJoCo cannot load it: {said}{advice}") from exc


def save(spec: mujoco.MjSpec, folder: Path) -> None:
    """With names of meshes relative to the file, and all digits: MuJoCo writes six, some micrometres."""
    mj, root = spec.compile(), ElementTree.fromstring(spec.to_xml().replace(f"{folder}/", ""))
    for tag, fields in EXACT.items():
        for element in root.iter(tag):
            if name := element.get("name"):
                _refine(element, getattr(mj, tag)(name), fields)
    for body in root.iter("body"):
        if body.get("name") and (inertial := body.find("inertial")) is not None:
            _refine(inertial, mj.body(body.get("name")), INERTIAL)
    ElementTree.ElementTree(root).write(folder / "model.xml", encoding="utf-8")


def _check_joint(file: Path, joint: Element, still: Container[str]) -> None:
    name, kind = joint.get("name"), joint.get("type")
    if kind in ("floating", "planar"):
        raise ConfigError(f"{file}: joint {name!r} is {kind}: the base must stand; make it fixed")
    if (mimic := joint.find("mimic")) is not None:
        if name not in still:
            raise ConfigError(
                f"{file}: joint {name!r} mimics another one, and cobot moves each joint by "
                f"itself; leave it out with --without {name}"
            )
        joint.remove(mimic)


def _mesh(file: Path, name: str, packages: Sequence[Path]) -> Path:
    path = _located(file, name, packages)
    if path.suffix.lower() not in MESHES:
        raise ConfigError(
            f"{file}: the shape of a link for collisions is {name}, which MuJoCo cannot read; convert it to "
            f"one of: {', '.join(MESHES)}"
        )
    return path.resolve()


def _located(file: Path, name: str, packages: Sequence[Path]) -> Path:
    if not name.startswith("package://"):
        path = file.parent / name.removeprefix("file://")
        if not path.is_file():
            raise ConfigError(f"{file}: there is no mesh {path}")
        return path
    package, _, inner = name.removeprefix("package://").partition("/")
    for folder in packages:
        for place in (folder / package / inner, folder / inner):
            if place.is_file() and (place != folder / inner or folder.resolve().name == package):
                return place
    looked = f" ({', '.join(map(str, packages))})" if packages else ""
    raise ConfigError(
        f"{file}: {name} is in none of the packages given{looked}; add --package FOLDER, the folder "
        f"{package} or the one above it"
    )


def _limited(flag: int, bounds: np.ndarray) -> bool:
    """Whether a range counts: with `auto`, if there is one."""
    return flag == mujoco.mjtLimited.mjLIMITED_TRUE or (
        flag == mujoco.mjtLimited.mjLIMITED_AUTO and bool(bounds[0] < bounds[1])
    )


def _refine(element: Element, compiled: object, fields: dict[str, str]) -> None:
    """Write the numbers that stand there rounded with all their digits."""
    for attribute, field_name in fields.items():
        if (text := element.get(attribute)) is not None:
            rounded, exact = np.array(text.split(), dtype=float), np.ravel(getattr(compiled, field_name))
            if rounded.shape == exact.shape and np.allclose(rounded, exact, rtol=1e-5, atol=1e-9):
                element.set(attribute, " ".join(repr(float(value)) for value in exact))
