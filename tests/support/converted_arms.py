"""The arms of `arm_kinds` as `cobot new-robot` makes them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from arm_kinds import KINDS, file_of, judged
from scipy.spatial.transform import Rotation

from benchmarks.arms import SLIDE, Arm, loaded_from
from benchmarks.stress.judge import Judge
from cobot.config import Settings, load_settings
from cobot.launch.cli import main
from cobot.types import Array, Pose


@dataclass(frozen=True, slots=True)
class Made:
    """A robot of a folder, and where its arm is bent."""

    arm: Arm
    settings: Settings
    ready: Array

    @property
    def slides(self) -> Array:
        return np.array([kind == SLIDE for kind, *_ in KINDS[self.arm.name].joints])

    def moved(self, angle_rad: float, way_m: float) -> Array:
        """Every joint from where it is ready."""
        return self.ready + np.where(self.slides, way_m, angle_rad)

    def pose(self, x: float, y: float, z: float, turn_rad: float = 0.0) -> Pose:
        """So far (m) from that of the bent arm, and turned about an oblique axis; by pinocchio."""
        position, rotation = Judge(self.arm, self.arm.robot).tcp(self.ready)
        turned = Rotation.from_rotvec(turn_rad * np.array([0.6, 0.0, 0.8])) * Rotation.from_matrix(rotation)
        return Pose(position + np.array([x, y, z]), turned.as_quat(scalar_first=True))

    def lowered(self, share: float) -> Pose:
        """Inwards and down by a share of the arm's reach, without a turn: any kind of arm gets there."""
        position, _ = Judge(self.arm, self.arm.robot).tcp(self.ready)
        inwards = -position[:2] / np.linalg.norm(position[:2])
        way = share * float(np.linalg.norm(KINDS[self.arm.name].tip))
        return self.pose(*(0.7 * way * inwards), -0.7 * way)


def robot_of(folder: Path, name: str) -> Made:
    """Made by the command, once."""
    kind, (text, suffix) = KINDS[name], file_of(name)
    if not (folder / name).exists():
        new_robot(folder / f"{name}{suffix}", text, folder / name, *kind.options)
    settings = load_settings(folder / name / "cobot-setting.yaml")
    arm = loaded_from(name, folder / name, judged(name), kind.tcp)
    return Made(arm, settings, np.array(kind.ready))


def new_robot(file: Path, text: str, folder: Path, *options: str) -> None:
    file.write_text(text, encoding="utf-8")
    assert main(["new-robot", str(file), "--output", str(folder), *options]) == 0
