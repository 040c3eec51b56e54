"""`cobot new-robot`: converts a URDF, xacro or MJCF file to a folder for `cobot run --config`.

The folder contains model.xml (MJCF), meshes, joint_limits.yaml, robot.srdf and cobot-setting.yaml. It is
built and checked next to its final location. So the final folder is either complete or does not exist.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import mujoco
import yaml

from cobot.config import SETTINGS_FILE, load_settings
from cobot.errors import ConfigError
from cobot.ipc.shm import MAX_DOF
from cobot.launch.new_robot import efforts, guesses, home_posture, masses
from cobot.launch.new_robot.inertials import Stated, set_aside
from cobot.launch.new_robot.kept_fingers import Fingers, kept_fingers
from cobot.launch.new_robot.srdf_import import GROUP, Semantics, Tree, read_srdf
from cobot.launch.robot_file.arm import find_arm, guess_tcp, named_arm
from cobot.launch.robot_file.joints import keep_joints, remove_shapes
from cobot.launch.robot_file.meshes import Meshes, collect_meshes
from cobot.launch.robot_file.mjcf import add_motor, mjcf_rates, read_mjcf
from cobot.launch.robot_file.mjcf_checks import check_mjcf
from cobot.launch.robot_file.passive import remove_passive_forces
from cobot.launch.robot_file.saving import compiled, save
from cobot.launch.robot_file.telescope import find_telescopes
from cobot.launch.robot_file.tree import JointTree, MovingJoint
from cobot.launch.robot_file.urdf import read_joints, read_urdf
from cobot.launch.robot_file.urdf_checks import check_urdf, drop_points
from cobot.launch.robot_file.urdf_limits import check_driven, check_supported, soft_limits
from cobot.launch.robot_file.visuals import Visuals
from cobot.launch.robot_file.worker import Worker
from cobot.launch.robot_file.xml_file import read_xml
from cobot.robot.collision import CollisionChecker
from cobot.robot.description import load_robot
from cobot.robot.file_limits import VELOCITY_OF, urdf_rates
from cobot.robot.holding import examine
from cobot.robot.model import RobotModel
from cobot.robot.srdf import write_srdf
from cobot.types import JointLimits

FROZEN = "gripper found; its joints stay where they are, with mass and shapes"


@dataclass(frozen=True, slots=True)
class _Source:
    """A robot that has been read from its file.

    Attributes:
        rates: the joints' velocity and effort limits; 0 if unknown.
        names: all joint names.
        stated: inertials of a URDF that were removed; None for MJCF.
    """

    spec: mujoco.MjSpec
    rates: dict[str, tuple[float, float]]
    names: list[str]
    stated: dict[str, Stated] | None
    tree: Tree


@dataclass(slots=True)
class NewRobot:
    """A robot configuration that is made from a file.

    Attributes:
        actuators: the driven joints; empty means the joints of the arm. All others are fixed at their
            position.
        without: joints that are not part of the arm.
        wishes: masses that the user specifies.
        srdf, group: an SRDF, and the group in it that contains the driven joints.
        packages: folders in which package://NAME/... is searched. They are package folders, or contain
            package folders.
        hulls: whether each mesh is replaced by its convex hull for collisions, even if the hull fills free
            space.
        skip_missing_meshes: whether shapes whose mesh does not exist are left out.
        xacro: values of the arguments of a xacro file.
        guessed: messages about guessed values, filled in by `write`.
    """

    file: Path
    actuators: Sequence[str] = ()
    without: Sequence[str] = ()
    packages: Sequence[Path] = ()
    base: str | None = None
    tcp: str | None = None
    wishes: masses.Wishes = field(default_factory=masses.Wishes)
    srdf: Path | None = None
    group: str | None = None
    hulls: bool = False
    skip_missing_meshes: bool = False
    xacro: Mapping[str, str] = field(default_factory=dict)
    guessed: list[str] = field(default_factory=list)
    _last_link: str = ""
    _soft_limits: dict[str, str] = field(default_factory=dict)

    def write(self, folder: Path) -> None:
        """Make the folder.

        Raises:
            ConfigError: the file, a mesh or the folder is invalid; nothing has been written.
        """
        try:
            if folder.exists():
                raise ConfigError(f"{folder}: already exists; choose another --output, or remove it")
            if not folder.parent.is_dir():
                raise ConfigError(
                    f"{folder}: cannot be written: there is no folder {folder.parent}; create it, or choose "
                    "another --output"
                )
            with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".new-robot-") as made:
                inside = Path(made) / "robot"
                inside.mkdir()
                name = re.sub(r"[^A-Za-z0-9_-]", "_", folder.resolve().name)[:48]
                with Worker() as worker:
                    root, self.file = read_xml(self.file, worker, self.xacro, self.packages)
                    visuals = Visuals(self.file, root, self.packages, self.guessed)
                    self._fill(inside, name, root, worker)
                    visuals.write(inside, worker)
                inside.rename(folder)
        except OSError as exc:
            reason = exc.strerror or exc
            raise ConfigError(f"{folder}: cannot be written: {reason}; choose another --output") from exc

    def _fill(self, folder: Path, name: str, root: Element, worker: Worker) -> None:
        source = self._read(root, folder, worker)
        spec = source.spec
        own_state = home_posture.keyframe(spec) or {}
        semantics, tree, chain = self._chain(root, spec, source.names, source.tree)
        joints, tcp, fingers, resting = self._reduce_to_arm(source, tree, chain, semantics, own_state)
        check_driven(self.file, root, joints, self.without)
        said, assumed = masses.settle(self.file, spec, self.wishes, source.stated)
        self.guessed += said
        gripper, tcp = self._configure_gripper(spec, fingers, resting, tcp)
        self.guessed += remove_passive_forces(spec)
        base, tcp = guesses.base_and_tcp(spec, joints, self.base or semantics.base, tcp, self.guessed)
        for joint in joints:
            add_motor(spec, joint)
            if (velocity := source.rates.get(joint, (0.0, 0.0))[0]) > 0.0:
                spec.add_numeric(name=f"{VELOCITY_OF}{joint}", data=[velocity], size=1)
        mj = compiled(self.file, spec)
        save(spec, folder)
        limits = guesses.limits(self.file, mj, source.rates, self.guessed)
        robot = self._load(folder, limits, base, tcp)
        limits = replace(robot.limits, max_effort=guesses.efforts(robot, self.guessed))
        check_supported(self.file, root, limits, self.without)
        self.guessed += [self._soft_limits[name] for name in limits.names if name in self._soft_limits]
        guesses.write_limits(limits, folder / "joint_limits.yaml")
        guesses.report_without_shape(robot, self.guessed)
        guesses.report_odd_world(mj, self.guessed)
        touching = guesses.pairs_that_touch(robot, semantics.pairs, self.guessed)
        pairs = [*semantics.pairs, *touching]
        links = {body.name for body in spec.bodies}
        for first, second in pairs:
            if {first, second} <= links:  # not for solids of the surroundings, which are no bodies
                spec.add_exclude(bodyname1=first, bodyname2=second)
        collision = CollisionChecker(robot, guesses.MARGIN_M, map(frozenset, pairs))
        holding = examine(robot, collision, limits)
        self.guessed += efforts.reduce_friction(spec, robot, limits, holding)
        save(spec, folder)
        robot = self._load(folder, limits, base, tcp)
        max_payload_kg, sentence = efforts.payload_left(robot, collision)
        self.guessed += [efforts.total_mass(robot.mj), sentence, *efforts.report_holding(holding, assumed)]
        positions = home_posture.positions(
            self.file, robot, collision, base, semantics.states_of(limits.names, own_state), self.guessed
        )
        self.guessed += semantics.said
        usual_m = load_settings().streaming.collision_margin_m
        margin_m = guesses.stream_margin(robot, collision, usual_m, self.guessed)
        write_srdf(folder / "robot.srdf", semantics.group, limits.names, positions, pairs)
        settings: dict[str, dict[str, Any]] = {
            "robot": {
                "name": name, "model": "model.xml", "srdf": "robot.srdf", "group": semantics.group,
                "base_frame": base, "tcp": tcp, "start_position": home_posture.start_name(positions),
                "max_payload_kg": max_payload_kg,
            },
            "planning": {"default_frame": base},
            "web": {"joint_limits": "joint_limits.yaml"},
        }  # fmt: skip
        if gripper:
            settings["robot"]["gripper"] = gripper
        if margin_m < usual_m:
            settings["streaming"] = {"collision_margin_m": margin_m}
        (folder / SETTINGS_FILE).write_text(yaml.safe_dump(settings, sort_keys=False))
        with self._errors_name_file(folder):
            load_robot(load_settings(folder / SETTINGS_FILE))

    def _read(self, root: Element, folder: Path, worker: Worker) -> _Source:
        """Read the file, and put its meshes into the folder."""
        if root.tag == "mujoco":
            check_mjcf(self.file, root)
            spec = read_mjcf(self.file, worker)
            collect_meshes(self.file, spec, folder)
            names = [joint.name for joint in spec.joints]
            return _Source(spec, mjcf_rates(spec), names, None, Tree.of_mjcf(spec))
        self.guessed += drop_points(self.file, root)
        check_urdf(self.file, root)
        self._soft_limits = soft_limits(self.file, root)
        rates = urdf_rates(self.file, root)
        still = {
            str(joint.get("name"))
            for joint in root.findall("joint")
            if joint.get("name") in self.without
            or (self.actuators and joint.get("name") not in self.actuators)
        }
        names = [str(joint.get("name")) for joint in root.findall("joint")]
        tree, stated = Tree.of_urdf(root), set_aside(self.file, root)
        meshes = Meshes(
            self.file,
            self.packages,
            folder,
            worker,
            self.guessed,
            split=not self.hulls,
            skip_missing=self.skip_missing_meshes,
        )
        self._chain(root, read_joints(self.file, root, still), names, tree)
        spec = read_urdf(self.file, root, meshes)
        return _Source(spec, rates, names, stated, tree)

    def _chain(
        self, root: Element, spec: mujoco.MjSpec, in_file: Sequence[str], files: Tree
    ) -> tuple[Semantics, JointTree, list[MovingJoint]]:
        """The arm that the SRDF describes, and the arm's joints in the tree of all joints."""
        names = [joint.name for joint in spec.joints]
        for given, valid in ((self.actuators, names), (self.without, in_file)):
            if name := next((name for name in given if name not in valid), ""):
                raise ConfigError(f"{self.file}: has no joint {name!r}; valid names: {', '.join(names)}")
        tree = JointTree(spec, self.without)
        semantics = self._semantics(root, spec, tree, files)
        if semantics.joints:
            return semantics, tree, named_arm(self.file, root, spec, tree, semantics.joints)
        return semantics, tree, find_arm(self.file, root, spec, tree, self.tcp)

    def _semantics(self, root: Element, spec: mujoco.MjSpec, tree: JointTree, files: Tree) -> Semantics:
        """The data in the SRDF. If no SRDF is given, they contain only the joints that the user has named."""
        if self.srdf is None:
            if self.group is not None:
                raise ConfigError("--group chooses a group of an SRDF; also give the SRDF, with --srdf FILE")
            return Semantics(GROUP, list(self.actuators))
        arm = self.actuators
        if not arm:
            with suppress(ConfigError):  # The group names the joints.
                chain = find_arm(self.file, root, spec, tree, self.tcp)
                arm = [node.name for node in chain]
        return read_srdf(self.srdf, files, self.group, arm, bool(self.actuators))

    def _reduce_to_arm(
        self,
        source: _Source,
        tree: JointTree,
        chain: list[MovingJoint],
        semantics: Semantics,
        own_state: dict[str, float],
    ) -> tuple[list[str], str | None, Fingers | None, dict[str, float]]:
        """Keep only the joints of the arm. The links of the other joints stay.

        Returns the joints of the arm, its TCP if that is known, its fingers if they can be simulated, and the
        positions at which all other joints are fixed.
        """
        spec = source.spec
        for telescope in find_telescopes(spec, chain):
            chain = [node for node in chain if node not in telescope.others]
            self.guessed.append(telescope.merge(spec, source.rates))
            telescope.rescale([own_state, *semantics.states.values()])
        tcp = self._tcp(chain[-1].joint.parent, semantics.tcp)
        fingers = [node for child in chain[-1].children for node in child.subtree]
        kept = kept_fingers(fingers, source.rates, bool(spec.compiler.degree))
        rods = tree.linkages(chain)
        remove_shapes(rods)
        joints = [node.name for node in chain]
        if len(joints) > MAX_DOF:
            raise ConfigError(
                f"{self.file}: the arm has {len(joints)} joints, allowed: up to {MAX_DOF}; use "
                f"--actuators to name the driven joints, or --without to leave out joints"
            )
        resting = self._leave_out(
            spec,
            joints,
            [node.name for node in (fingers if isinstance(kept, str) else kept.joints)],
            [node.name for rod in rods for node in rod.subtree],
            kept if isinstance(kept, str) else "",
        )
        self._last_link = guess_tcp(chain[-1].joint.parent)[0]
        return joints, tcp, None if isinstance(kept, str) else kept, resting

    def _configure_gripper(
        self, spec: mujoco.MjSpec, fingers: Fingers | None, resting: dict[str, float], tcp: str | None
    ) -> tuple[dict[str, Any], str]:
        """Return the setting robot.gripper and the TCP. The setting is empty if no fingers can be
        simulated.
        """
        gripper: dict[str, Any] = {}
        if fingers is not None:
            found = fingers.open(spec, compiled(self.file, spec), resting)
            if isinstance(found, str):
                places = ", ".join(f"{each.name} at {resting[each.name]:.4g}" for each in fingers.joints)
                self.guessed.append(f"{FROZEN} ({found}): {places}")
            else:
                hand, sentence = found
                self.guessed.append(sentence)
                gripper = {"type": "simulated", "hand": hand.model_dump(mode="json")}
                if tcp is None and (tcp := fingers.add_tcp(spec, compiled(self.file, spec))):
                    self.guessed.append(f"tcp {tcp}: a new site between the fingertips (--tcp)")
        if tcp is None:
            tcp = self._last_link
            self.guessed.append(f"tcp {tcp}: the last link (--tcp)")
        return gripper, tcp

    def _tcp(self, last_link: mujoco.MjsBody, of_srdf: str | None = None) -> str | None:
        if given := self.tcp or of_srdf:
            return given
        tcp, known = guess_tcp(last_link)
        if not known:
            return None
        self.guessed.append(f"tcp {tcp}: by its name (--tcp)")
        return tcp

    def _leave_out(
        self,
        spec: mujoco.MjSpec,
        arm: list[str],
        fingers: Sequence[str],
        linkage: Sequence[str],
        why_fixed: str,
    ) -> dict[str, float]:
        """Fix all joints except those of the arm. Returns and reports the positions at which they are fixed.

        Args:
            why_fixed: the reason why the fingers are fixed; "" if they may move.
        """
        nodes = JointTree(spec).nodes
        slides = {name for name, node in nodes.items() if node.joint.type == mujoco.mjtJoint.mjJNT_SLIDE}
        resting = keep_joints(spec, arm)
        parts = {
            f"{FROZEN} ({why_fixed})": fingers if why_fixed else (),
            "linkage found; its joints stay where they are, with mass and without shapes": linkage,
            "joints that stay where they are": [n for n in resting if n not in {*fingers, *linkage}],
        }
        for what, names in parts.items():
            places = {
                name: f"{resting[name]:.4g} {'m' if name in slides else 'rad'}" if resting[name] else "0"
                for name in names
            }
            if places:
                told = (f"{name} at {place}" for name, place in places.items())
                self.guessed.append(f"{what}: {', '.join(told)}")
        return resting

    def _load(self, folder: Path, limits: JointLimits, base: str, tcp: str) -> RobotModel:
        with self._errors_name_file(folder):
            return RobotModel.load(folder / "model.xml", limits, base, tcp)

    @contextmanager
    def _errors_name_file(self, folder: Path) -> Iterator[None]:
        """Context manager that makes errors name the user's file instead of the folder under construction."""
        try:
            yield
        except ConfigError as exc:
            raise ConfigError(f"{self.file}: {str(exc).replace(f'{folder}/', '')}") from exc
