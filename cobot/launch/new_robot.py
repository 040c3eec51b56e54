"""`cobot new-robot`: from a URDF or MJCF file to a folder that `cobot run --config` takes.

The folder has model.xml (MJCF), meshes, joint_limits.yaml, robot.srdf and cobot-setting.yaml. It is made
beside its final place and checked there, so it is complete or it is not there.
"""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np
import yaml

from cobot.config import load_settings
from cobot.errors import ConfigError
from cobot.robot.collision import CollisionChecker
from cobot.robot.description import load_robot
from cobot.robot.limits import load_joint_limits
from cobot.robot.model import RobotModel
from cobot.types import Array

SETTINGS = "cobot-setting.yaml"
GROUP = "arm"
SAMPLES = 500
"""Random positions at which self-collision is looked at."""
TCP_NAMES = ("tcp", "tool0", "attachment_site", "ee_link", "flange")
VELOCITY = {False: 1.0, True: 0.25}
"""Guessed for a hinge, rad/s, and a slide, m/s."""
ACCELERATION_PER_VELOCITY, JERK_PER_ACCELERATION = 4.0, 10.0
"""Full speed in a quarter of a second, full acceleration in a tenth."""
EXACT = {
    "body": {"pos": "pos", "quat": "quat"},
    "joint": {"pos": "pos", "axis": "axis", "range": "range"},
    "site": {"pos": "pos", "quat": "quat"},
}
INERTIAL = {"pos": "ipos", "quat": "iquat", "mass": "mass", "diaginertia": "inertia"}
"""Attributes of the file that are written with all digits, and what MuJoCo calls them."""
EFFORT_RESERVE = 2.5
"""Guessed effort, of what gravity and the guessed acceleration need at the most of the samples."""


@dataclass(slots=True)
class NewRobot:
    """What to make of a file.

    Attributes:
        actuators: the joints that drives move; empty for all. Others stay where they are at 0.
        without: joints that stay so, such as fingers.
        packages: folders, in which or as which the packages of package://NAME/... are looked for.
        guessed: sentences, filled in by `write`.
    """

    file: Path
    actuators: Sequence[str] = ()
    without: Sequence[str] = ()
    packages: Sequence[Path] = ()
    base: str | None = None
    tcp: str | None = None
    guessed: list[str] = field(default_factory=list)

    def write(self, folder: Path) -> None:
        """Make the folder.

        Raises:
            ConfigError: the file, a mesh or the folder is not as it must be; nothing has been written.
        """
        if folder.exists():
            raise ConfigError(f"{folder}: is there already; choose another --output, or remove it")
        try:
            with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".new-robot-") as made:
                inside = Path(made) / "robot"
                inside.mkdir()
                self._fill(inside, re.sub(r"[^A-Za-z0-9_-]", "_", folder.resolve().name)[:48])
                inside.rename(folder)
        except OSError as exc:
            raise ConfigError(f"{folder}: cannot be written: {exc.strerror or exc}") from exc

    def _fill(self, folder: Path, name: str) -> None:
        root = _read(self.file)
        urdf = root.tag == "robot"
        spec = self._urdf(root) if urdf else _mujoco(self.file)
        joints = self._driven(spec)
        self._collect_meshes(spec, folder)
        base, tcp = self._frames(spec, joints)
        for actuator in list(spec.actuators):
            spec.delete(actuator)
        for joint in joints:
            motor = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            motor.set_to_motor()
        mj = _compiled(spec, self.file)
        _save(spec, folder)
        limits = self._limits(mj, joints, _urdf_limits(root) if urdf else {})
        write_limits = {"joint_limits": limits}
        (folder / "joint_limits.yaml").write_text(yaml.safe_dump(write_limits, sort_keys=False))
        self._efforts(folder, limits, base, tcp)
        (folder / "joint_limits.yaml").write_text(yaml.safe_dump(write_limits, sort_keys=False))
        self._positions(spec, folder, base, tcp)
        settings = {
            "robot": {
                "name": name, "model": "model.xml", "srdf": "robot.srdf", "group": GROUP,
                "base_frame": base, "tcp": tcp, "start_position": "home",
            },
            "planning": {"default_frame": base},
            "web": {"joint_limits": "joint_limits.yaml"},
        }  # fmt: skip
        (folder / SETTINGS).write_text(yaml.safe_dump(settings, sort_keys=False))
        load_robot(load_settings(folder / SETTINGS))

    def _urdf(self, root: Element) -> mujoco.MjSpec:
        """A URDF's root link would become the world and lose its name: it gets a parent."""
        stays = set(self.without)
        children = {child.get("link") for child in root.iter("child")}
        first = [link.get("name") for link in root.iter("link") if link.get("name") not in children]
        for joint in root.iter("joint"):
            name, kind = joint.get("name"), joint.get("type")
            if kind in ("floating", "planar"):
                raise ConfigError(
                    f"{self.file}: joint {name!r} is {kind}: the base must stand; make it fixed"
                )
            if joint.find("mimic") is not None:
                if name not in stays and (not self.actuators or name in self.actuators):
                    raise ConfigError(
                        f"{self.file}: joint {name!r} mimics another one, and cobot moves each joint by "
                        f"itself; leave it out with --without {name}"
                    )
                joint.remove(next(joint.iter("mimic")))
        if len(first) != 1:
            raise ConfigError(f"{self.file}: needs one root link, has {', '.join(map(str, first)) or 'none'}")
        SubElement(root, "link", name="cobot_world")
        stand = SubElement(root, "joint", name="cobot_stand", type="fixed")
        SubElement(stand, "parent", link="cobot_world")
        SubElement(stand, "child", link=str(first[0]))
        for mesh in root.iter("mesh"):
            mesh.set("filename", str(self._mesh(mesh.get("filename") or "")))
        extension = root.find("mujoco")
        extension = SubElement(root, "mujoco") if extension is None else extension
        compiler = extension.find("compiler")
        compiler = SubElement(extension, "compiler") if compiler is None else compiler
        compiler.attrib.pop("meshdir", None)
        compiler.set("strippath", "false")
        compiler.set("fusestatic", "false")
        with tempfile.TemporaryDirectory() as place:
            file = Path(place) / "robot.urdf"
            ElementTree.ElementTree(root).write(file)
            spec = _mujoco(file, self.file)
        spec.compiler.fusestatic = False
        return spec

    def _mesh(self, name: str) -> Path:
        if not name.startswith("package://"):
            path = self.file.parent / name.removeprefix("file://")
            if not path.is_file():
                raise ConfigError(f"{self.file}: there is no mesh {path}")
            return path.resolve()
        package, _, inner = name.removeprefix("package://").partition("/")
        for folder in self.packages:
            for place in (folder / package / inner, folder / inner):
                if place.is_file() and (place != folder / inner or folder.resolve().name == package):
                    return place.resolve()
        raise ConfigError(f"{self.file}: {name} is in none of the packages given; add --package FOLDER")

    def _driven(self, spec: mujoco.MjSpec) -> list[str]:
        names = [joint.name for joint in spec.joints]
        for name in (*self.actuators, *self.without):
            if name not in names:
                raise ConfigError(f"{self.file}: has no joint {name!r}; valid are: {', '.join(names)}")
        kept = [name for name in names if name not in self.without and name in (self.actuators or names)]
        gone = [name for name in names if name not in kept]
        for joint in list(spec.joints):
            if joint.name in gone:
                spec.delete(joint)
            elif joint.type not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
                raise ConfigError(
                    f"{self.file}: joint {joint.name!r} is a free or ball joint: an arm has a base that "
                    "stands, and hinges and slides; take the joint out of the file"
                )
            elif not joint.name:
                raise ConfigError(f"{self.file}: a joint has no name; each needs one")
        if not kept:
            raise ConfigError(f"{self.file}: has no joint that moves")
        if gone:
            self.guessed.append(f"joints that stay at 0: {', '.join(gone)}")
            for equality in list(spec.equalities):
                if {equality.name1, equality.name2} & set(gone):
                    spec.delete(equality)
        for key in list(spec.keys):
            spec.delete(key)
        return kept

    def _collect_meshes(self, spec: mujoco.MjSpec, folder: Path) -> None:
        """Copies, so that the folder may be moved."""
        source = Path(spec.modelfiledir or self.file.parent) / (spec.compiler.meshdir or "")
        for index, mesh in enumerate(spec.meshes):
            if not mesh.file:
                continue
            path = source / mesh.file
            if not path.is_file():
                raise ConfigError(f"{self.file}: there is no mesh {path}")
            mesh.name = mesh.name or path.stem
            mesh.file = f"{index}_{path.name}"
            (folder / "meshes").mkdir(exist_ok=True)
            shutil.copyfile(path, folder / "meshes" / mesh.file)
        spec.modelfiledir, spec.compiler.meshdir = str(folder), "meshes"

    def _frames(self, spec: mujoco.MjSpec, joints: list[str]) -> tuple[str, str]:
        base = self.base or spec.joint(joints[0]).parent.parent.name
        last = spec.joint(joints[-1]).parent
        names = [site.name for site in spec.sites] + [body.name for body in spec.bodies]
        below = last
        while below.bodies:
            below = below.bodies[0]
        known = [name for name in TCP_NAMES if name in names]
        tcp = self.tcp or (known[0] if known else below.name)
        if self.base is None:
            self.guessed.append(f"base_frame {base}: what the first joint stands on (--base)")
        if self.tcp is None:
            self.guessed.append(f"tcp {tcp}: {'by its name' if known else 'the last link'} (--tcp)")
        if spec.site(tcp) is None and spec.body(tcp) is not None:
            spec.body(tcp).add_site(name=tcp)
        return base, tcp

    def _limits(
        self, mj: mujoco.MjModel, joints: list[str], said: dict[str, tuple[float, float]]
    ) -> dict[str, dict[str, float | bool]]:
        entries: dict[str, dict[str, float | bool]] = {}
        for index, name in enumerate(joints):
            slides = bool(mj.jnt_type[index] == mujoco.mjtJoint.mjJNT_SLIDE)
            low, high = map(float, mj.jnt_range[index])
            if not mj.jnt_limited[index]:
                if slides:
                    raise ConfigError(f"{self.file}: the slide {name!r} has no range; give it one, in m")
                low, high = -2.0 * np.pi, 2.0 * np.pi
                self.guessed.append(f"{name}: position ±6.28319 rad, the file has no range")
            velocity, effort = said.get(name, (0.0, 0.0))
            if mj.jnt_actfrclimited[index]:
                effort = float(np.abs(mj.jnt_actfrcrange[index]).min())
            if velocity <= 0.0:
                velocity = VELOCITY[slides]
                self.guessed.append(f"{name}: velocity {velocity:g} {'m' if slides else 'rad'}/s")
            acceleration = ACCELERATION_PER_VELOCITY * velocity
            entry: dict[str, float | bool] = {
                "has_position_limits": True, "min_position": low, "max_position": high
            }  # fmt: skip
            rates = (velocity, acceleration, JERK_PER_ACCELERATION * acceleration, effort or 1e5)
            for rate, value in zip(("velocity", "acceleration", "jerk", "effort"), rates, strict=True):
                entry |= {f"has_{rate}_limits": True, f"max_{rate}": value}
            entries[name] = entry
        self.guessed.append("acceleration: 4 times the velocity per second; jerk: 10 times the acceleration")
        return entries

    def _efforts(
        self, folder: Path, entries: dict[str, dict[str, float | bool]], base: str, tcp: str
    ) -> None:
        """Where the file has none: what the arm needs, and a reserve."""
        limits = load_joint_limits(folder / "joint_limits.yaml")
        robot = RobotModel.load(folder / "model.xml", limits, base, tcp)
        needed = np.zeros(limits.dof)
        for joints in _samples(limits.min_position, limits.max_position)[:100]:
            accelerating = np.abs(robot.mass_matrix(joints)) @ limits.max_acceleration
            needed = np.maximum(needed, np.abs(robot.gravity_torques(joints)) + accelerating)
        for index, (name, entry) in enumerate(entries.items()):
            if entry["max_effort"] == 1e5:
                entry["max_effort"] = float(max(1.0, np.ceil(EFFORT_RESERVE * needed[index])))
                self.guessed.append(
                    f"{name}: effort {entry['max_effort']:g}, {EFFORT_RESERVE:g} times the need"
                )

    def _positions(self, spec: mujoco.MjSpec, folder: Path, base: str, tcp: str) -> None:
        """Leaves out pairs that touch at every sample; home is the position nearest to 0 that is free."""
        limits = load_joint_limits(folder / "joint_limits.yaml")
        robot = RobotModel.load(folder / "model.xml", limits, base, tcp)
        checker = CollisionChecker(robot, 0.005)
        samples = _samples(limits.min_position, limits.max_position)
        touching = checker.clearance.distances(samples, 0.005) < 0.005
        bodies = robot.mj.geom_bodyid
        always = sorted(
            {
                tuple(sorted(int(bodies[geom]) for geom in checker.pairs[pair]))
                for pair in np.flatnonzero(touching.all(axis=0))
            }
        )
        names = [(robot.mj.body(first).name, robot.mj.body(second).name) for first, second in always]
        for first, second in names:
            spec.add_exclude(bodyname1=first, bodyname2=second)
            self.guessed.append(f"{first} and {second} may touch: they do in each of {SAMPLES} positions")
        if names:
            _compiled(spec, self.file)
            _save(spec, folder)
            robot = RobotModel.load(folder / "model.xml", limits, base, tcp)
            checker = CollisionChecker(robot, 0.005)
        zero = np.clip(np.zeros(limits.dof), limits.min_position, limits.max_position)
        order = np.argsort(np.abs(samples - zero).max(axis=1))
        free = [q for q in (zero, *samples[order]) if checker.is_free(q)]
        if not free:
            raise ConfigError(f"{self.file}: it touches itself in each of {SAMPLES} positions")
        self.guessed.append(f"home: {np.round(free[0], 3).tolist()}, the free position nearest to 0")
        root = Element("robot", name=GROUP)
        group = SubElement(root, "group", name=GROUP)
        for name in limits.names:
            SubElement(group, "joint", name=name)
        state = SubElement(root, "group_state", name="home", group=GROUP)
        for name, value in zip(limits.names, free[0], strict=True):
            SubElement(state, "joint", name=name, value=repr(float(value)))
        for first, second in names:
            SubElement(root, "disable_collisions", link1=first, link2=second, reason="Always")
        ElementTree.indent(root)
        ElementTree.ElementTree(root).write(folder / "robot.srdf", encoding="utf-8", xml_declaration=True)


def _samples(low: Array, high: Array) -> Array:
    return np.random.default_rng(0).uniform(low, high, (SAMPLES, len(low)))


def _read(file: Path) -> Element:
    if not file.is_file():
        raise ConfigError(f"{file}: {'is no file' if file.exists() else 'no such file'}")
    try:
        text = file.read_text(encoding="utf-8")
        if "<!DOCTYPE" in text:
            raise ConfigError(f"{file}: must not have a DOCTYPE")
        root = ElementTree.fromstring(text)
    except (OSError, UnicodeDecodeError, ElementTree.ParseError) as exc:
        raise ConfigError(f"{file}: is neither a readable URDF nor MJCF: {exc}") from exc
    if file.suffix == ".xacro" or "ros.org/wiki/xacro" in text or "<xacro:" in text:
        raise ConfigError(
            f"{file}: is xacro; expand it first: xacro {file.name} > {file.stem.split('.')[0]}.urdf"
        )
    if root.tag not in ("robot", "mujoco"):
        raise ConfigError(f"{file}: begins with <{root.tag}>, must be <robot> (URDF) or <mujoco> (MJCF)")
    return root


def _urdf_limits(root: Element) -> dict[str, tuple[float, float]]:
    """Velocity and effort of each joint that has a limit."""
    return {
        str(joint.get("name")): (float(limit.get("velocity", 0)), float(limit.get("effort", 0)))
        for joint in root.iter("joint")
        if (limit := joint.find("limit")) is not None
    }


def _mujoco(file: Path, named: Path | None = None) -> mujoco.MjSpec:
    try:
        return mujoco.MjSpec.from_file(str(file))
    except ValueError as exc:
        raise ConfigError(f"{named or file}: MuJoCo cannot read it: {' '.join(str(exc).split())}") from exc


def _compiled(spec: mujoco.MjSpec, file: Path) -> mujoco.MjModel:
    try:
        return spec.compile()
    except ValueError as exc:
        said = " ".join(str(exc).split())
        advice = "; each link that moves needs an <inertial>" if "inertia" in said else ""
        raise ConfigError(f"{file}: MuJoCo cannot load it: {said}{advice}") from exc


def _save(spec: mujoco.MjSpec, folder: Path) -> None:
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


def _refine(element: Element, compiled: object, fields: dict[str, str]) -> None:
    """Write the numbers that stand there rounded with all their digits."""
    for attribute, field_name in fields.items():
        if (text := element.get(attribute)) is not None:
            rounded, exact = np.array(text.split(), dtype=float), np.ravel(getattr(compiled, field_name))
            if rounded.shape == exact.shape and np.allclose(rounded, exact, rtol=1e-5, atol=1e-9):
                element.set(attribute, " ".join(repr(float(value)) for value in exact))
