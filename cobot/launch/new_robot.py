"""`cobot new-robot`: from a URDF or MJCF file to a folder that `cobot run --config` takes.

The folder has model.xml (MJCF), meshes, joint_limits.yaml, robot.srdf and cobot-setting.yaml. It is made
beside its final place and checked there, so it is complete or it is not there.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import yaml

from cobot.config import SETTINGS_FILE, load_settings
from cobot.errors import ConfigError
from cobot.launch import robot_guesses
from cobot.launch.robot_file.joints import keep_joints
from cobot.launch.robot_file.meshes import collect_meshes
from cobot.launch.robot_file.mjcf import mjcf_rates, read_mjcf
from cobot.launch.robot_file.saving import compiled, save
from cobot.launch.robot_file.urdf import read_urdf
from cobot.launch.robot_file.xml_file import read_xml
from cobot.robot.description import load_robot
from cobot.robot.file_limits import VELOCITY_OF, urdf_rates
from cobot.robot.model import RobotModel
from cobot.types import JointLimits

GROUP = "arm"


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
        try:
            if folder.exists():
                raise ConfigError(f"{folder}: is there already; choose another --output, or remove it")
            if not folder.parent.is_dir():
                raise ConfigError(
                    f"{folder}: cannot be written: there is no folder {folder.parent}; make it, or choose "
                    "another --output"
                )
            with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".new-robot-") as made:
                inside = Path(made) / "robot"
                inside.mkdir()
                self._fill(inside, re.sub(r"[^A-Za-z0-9_-]", "_", folder.resolve().name)[:48])
                inside.rename(folder)
        except OSError as exc:
            reason = exc.strerror or exc
            raise ConfigError(f"{folder}: cannot be written: {reason}; choose another --output") from exc

    def _fill(self, folder: Path, name: str) -> None:
        spec, rates = self._read()
        joints = self._driven(spec)
        collect_meshes(self.file, spec, folder)
        base, tcp = robot_guesses.frames(spec, joints, self.base, self.tcp, self.guessed)
        for joint in joints:
            motor = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            motor.set_to_motor()
            if (velocity := rates.get(joint, (0.0, 0.0))[0]) > 0.0:
                spec.add_numeric(name=f"{VELOCITY_OF}{joint}", data=[velocity], size=1)
        mj = compiled(self.file, spec)
        save(spec, folder)
        limits = robot_guesses.limits(self.file, mj, rates, self.guessed)
        robot = self._load(folder, limits, base, tcp)
        limits = replace(limits, max_effort=robot_guesses.efforts(robot, self.guessed))
        robot_guesses.write_limits(limits, folder / "joint_limits.yaml")
        robot_guesses.shapeless(robot, self.guessed)
        if pairs := robot_guesses.pairs_that_touch(robot):
            robot_guesses.exclude(self.file, spec, folder, pairs, self.guessed)
            robot = self._load(folder, limits, base, tcp)
        home = robot_guesses.home(self.file, robot, self.guessed)
        robot_guesses.write_srdf(folder / "robot.srdf", GROUP, limits.names, home, pairs)
        settings = {
            "robot": {
                "name": name, "model": "model.xml", "srdf": "robot.srdf", "group": GROUP,
                "base_frame": base, "tcp": tcp, "start_position": "home",
            },
            "planning": {"default_frame": base},
            "web": {"joint_limits": "joint_limits.yaml"},
        }  # fmt: skip
        (folder / SETTINGS_FILE).write_text(yaml.safe_dump(settings, sort_keys=False))
        with self._naming(folder):
            load_robot(load_settings(folder / SETTINGS_FILE))

    def _read(self) -> tuple[mujoco.MjSpec, dict[str, tuple[float, float]]]:
        """And what the file says of velocity and effort of its joints."""
        root = read_xml(self.file)
        if root.tag == "mujoco":
            spec = read_mjcf(self.file)
            return spec, mjcf_rates(spec)
        still = {
            str(joint.get("name"))
            for joint in root.iter("joint")
            if joint.get("name") in self.without
            or (self.actuators and joint.get("name") not in self.actuators)
        }
        spec = read_urdf(self.file, root, still, self.packages)
        return spec, urdf_rates(self.file, root)

    def _driven(self, spec: mujoco.MjSpec) -> list[str]:
        """The joints that move; nothing else is left of the others."""
        names = [joint.name for joint in spec.joints]
        for name in (*self.actuators, *self.without):
            if name not in names:
                raise ConfigError(f"{self.file}: has no joint {name!r}; valid are: {', '.join(names)}")
        kept = [name for name in names if name not in self.without and name in (self.actuators or names)]
        if gone := keep_joints(self.file, spec, kept):
            self.guessed.append(f"joints that stay at 0: {', '.join(name or '(no name)' for name in gone)}")
        if not kept:
            raise ConfigError(f"{self.file}: has no joint that moves")
        return kept

    def _load(self, folder: Path, limits: JointLimits, base: str, tcp: str) -> RobotModel:
        with self._naming(folder):
            return RobotModel.load(folder / "model.xml", limits, base, tcp)

    @contextmanager
    def _naming(self, folder: Path) -> Iterator[None]:
        """Have errors name the file that was given, and not where the folder is being made."""
        try:
            yield
        except ConfigError as exc:
            raise ConfigError(f"{self.file}: {str(exc).replace(f'{folder}/', '')}") from exc
