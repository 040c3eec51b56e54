"""Four arms as `cobot new-robot` makes them: S-R-S, UR-like, spherical wrist, and a gantry with an arm on it
(eight joints, two of them prismatic).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.arms import JOINTS, SLIDE, Arm, loaded, urdf
from benchmarks.judge import Judge
from cobot.config import Settings, load_settings
from cobot.launch.cli import main
from cobot.types import Array, Pose

BENT = [0.3, 0.2, 0.3, 0.4, 0.9, 0.2]
READY = {
    "srs": [0.3, 0.5, 0.2, -1.2, 0.1, 0.8, 0.2],
    "ur": [0.3, -1.3, 1.5, -1.7, -1.4, 0.2],
    "spherical": BENT,
    "gantry": [0.1, 0.05, *BENT],
}
"""Bent arms, away from singularities and limits."""


@dataclass(frozen=True, slots=True)
class Made:
    """A robot of a folder, and where its arm is bent."""

    arm: Arm
    settings: Settings
    ready: Array

    @property
    def slides(self) -> Array:
        return np.array([kind == SLIDE for kind, *_ in JOINTS[self.arm.name]])

    def moved(self, angle_rad: float, way_m: float) -> Array:
        """Every joint from where it is ready."""
        return self.ready + np.where(self.slides, way_m, angle_rad)

    def pose(self, x: float, y: float, z: float, turn_rad: float = 0.0) -> Pose:
        """So far (m) from that of the bent arm, and turned about an oblique axis; by pinocchio."""
        position, rotation = Judge(self.arm, self.arm.robot).tcp(self.ready)
        turned = Rotation.from_rotvec(turn_rad * np.array([0.6, 0.0, 0.8])) * Rotation.from_matrix(rotation)
        return Pose(position + np.array([x, y, z]), turned.as_quat(scalar_first=True))


def robot_of(folder: Path, name: str) -> Made:
    """Made by the command, once."""
    if not (folder / name).exists():
        new_robot(folder / f"{name}.urdf", urdf(name), folder / name)
    settings = load_settings(folder / name / "cobot-setting.yaml")
    return Made(loaded(name, folder / name), settings, np.array(READY[name]))


def new_robot(file: Path, text: str, folder: Path) -> None:
    file.write_text(text, encoding="utf-8")
    assert main(["new-robot", str(file), "--output", str(folder)]) == 0
