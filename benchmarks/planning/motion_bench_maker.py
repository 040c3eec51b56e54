"""The problems of MotionBenchMaker, from the source archive of `vamp-planner`, which `make bench` downloads.

C. Chamzas et al., "MotionBenchMaker", 2022, doi 10.1109/LRA.2021.3133603. Robots and scenes are those of the
archive: `cobot new-robot` makes the Panda and the UR5 from their URDFs.
"""

from __future__ import annotations

import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cobot.config import SETTINGS_FILE, load_settings
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.scene import Scene, SceneObject
from cobot.types import Array

ARCHIVES = Path("build", "peers")
SCENES = (
    "bookshelf_small",
    "bookshelf_tall",
    "bookshelf_thin",
    "box",
    "cage",
    "table_pick",
    "table_under_pick",
)
ARMS = {"panda": "panda_arm", "ur5": "manipulator"}
"""The groups of joints in the SRDFs."""
TIMEOUT_S = 10.0


@dataclass(frozen=True, slots=True)
class Problem:
    """A motion between two configurations, shape (dof,), rad, among the objects of a scene.

    Attributes:
        name: the kind of scene, a space, and the problem's number.
    """

    name: str
    scene: Scene
    start: Array
    goal: Array


@dataclass(frozen=True, slots=True)
class ProblemSet:
    """An arm, its description from the archive, and its problems."""

    arm: str
    resources: Path
    robot: RobotDescription
    problems: list[Problem]


def archive() -> Path | None:
    """The source archive with the problems."""
    return next(iter(sorted(ARCHIVES.glob("vamp_planner-*.tar.gz"))), None)


def unpacked(part: str, arms: list[str], every: int) -> Iterator[ProblemSet]:
    """Each of these arms with every so-manyth problem of each scene; nothing, with a message, if the archive
    is missing."""
    source = archive()
    if source is None:
        print(f"{part}: no vamp_planner-*.tar.gz in {ARCHIVES}; `make bench` downloads it", file=sys.stderr)
    for arm in () if source is None else arms:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            robot = _robot_of(source, folder, arm)
            yield ProblemSet(arm, _resources(folder, arm), robot, list(_problems(folder, arm, every)))


def _resources(folder: Path, arm: str) -> Path:
    return next(folder.glob(f"*/resources/{arm}"))


def _robot_of(packed_file: Path, folder: Path, arm: str) -> RobotDescription:
    """An arm from the archive. Its problems are unpacked, too."""
    with tarfile.open(packed_file) as packed:
        wanted = [each for each in packed.getmembers() if f"/resources/{arm}/" in each.name]
        packed.extractall(folder, wanted, filter="data")
    source = _resources(folder, arm)
    with tarfile.open(source / "problems.tar.bz2") as packed:
        packed.extractall(folder, filter="data")
    made = [sys.executable, "-m", "cobot", "new-robot", str(source / f"{arm}.urdf")]
    options = ["--srdf", str(source / f"{arm}.srdf"), "--group", ARMS[arm], "--package", str(source)]
    subprocess.run(
        [*made, *options, "--output", str(folder / "robot")], check=True, stdout=subprocess.DEVNULL
    )
    robot = load_robot(load_settings(folder / "robot" / SETTINGS_FILE))
    robot.collision.clearance.enclose()  # as a planning process does when it starts
    return robot


def _problems(folder: Path, arm: str, every: int) -> Iterator[Problem]:
    for kind in SCENES:
        place = folder / "problems" / f"{kind}_{arm}"
        for request in sorted(place.glob("request*.yaml"))[::every]:
            scene = request.with_name(request.name.replace("request", "scene"))
            asked = yaml.load(request.read_text(), yaml.CSafeLoader)
            begin = asked["start_state"]["joint_state"]
            first = dict(zip(begin["name"], begin["position"], strict=True))
            last = {
                each["joint_name"]: each["position"]
                for each in asked["goal_constraints"][0]["joint_constraints"]
            }
            yield Problem(
                f"{kind} {request.stem[-4:]}",
                _scene(yaml.load(scene.read_text(), yaml.CSafeLoader)),
                np.array([first[name] for name in last]),
                np.array(list(last.values())),
            )


def _scene(document: dict[str, Any]) -> Scene:
    objects = {}
    for each in document["world"]["collision_objects"]:
        (solid,), (pose,) = each["primitives"], each["primitive_poses"]
        x, y, z, w = pose["orientation"]
        size = solid["dimensions"] if solid["type"] == "box" else solid["dimensions"][::-1]
        objects[each["id"]] = SceneObject(solid["type"], tuple(size), (*pose["position"], w, x, y, z))
    return Scene(version=1, objects=objects)
