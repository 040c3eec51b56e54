"""The problems of MotionBenchMaker, from the source archive of `vamp-planner`: what is solved, and how fast.

    pip download vamp-planner==0.6.4 --no-deps --no-binary vamp-planner --dest build/peers
    python -m benchmarks problem_sets

C. Chamzas et al., "MotionBenchMaker", 2022, doi 10.1109/LRA.2021.3133603. Robots and scenes are those of the
archive: `cobot new-robot` makes the Panda and the UR5 from their URDFs.
"""

from __future__ import annotations

import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.table import Row, row
from cobot.config import SETTINGS_FILE, load_settings
from cobot.errors import CobotError
from cobot.planners import MotionRequest, plan
from cobot.planners.search.detours import length
from cobot.planners.search.sampling import find_path
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.scene import Scene, SceneObject
from cobot.types import Array, PlannerName, Scaling

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
COLUMNS = ("p50", "p95", "max")


@dataclass(frozen=True, slots=True)
class Problem:
    """A motion between two configurations, shape (dof,), rad, among the objects of a scene."""

    name: str
    scene: Scene
    start: Array
    goal: Array


@dataclass(frozen=True, slots=True)
class Results:
    """Times in ms of each problem, of its whole plan and of the search alone; lengths, rad; durations, s."""

    plan_ms: list[float]
    path_ms: list[float]
    lengths: list[float]
    durations: list[float]
    failures: list[str]


def problem_sets(every: int) -> Iterator[Row]:
    """Every so-manyth problem of each scene."""
    for arm, robot, chosen in unpacked("problem_sets", list(ARMS), every):
        yield from _rows(arm, measure(robot, chosen))


def _rows(arm: str, found: Results) -> Iterator[Row]:
    count = len(found.plan_ms) + len(found.failures)
    yield row(
        f"MotionBenchMaker, {arm}, {count} problems: ompl, from request to checked trajectory",
        "ms",
        _three(found.plan_ms),
        "the polyline alone",
        _three(found.path_ms),
        columns=COLUMNS,
        aim="5 / 50 / 500 ms",
    )
    yield row(
        f"MotionBenchMaker, {arm}: solved",
        "%",
        (100.0 * len(found.plan_ms) / count,),
        "all",
        (100.0,),
        columns=("solved",),
        aim="100 %",
    )


def unpacked(
    part: str, arms: list[str], every: int
) -> Iterator[tuple[str, RobotDescription, Iterator[Problem]]]:
    """Each of these arms with every so-manyth problem of each scene; nothing, with a message, if the archive
    is missing."""
    source = next(iter(sorted(ARCHIVES.glob("vamp_planner-*.tar.gz"))), None)
    if source is None:
        lacking = f"{part}: no vamp_planner-*.tar.gz in {ARCHIVES}"
        print(f"{lacking}; see benchmarks/planning/problem_sets.py", file=sys.stderr)
    for arm in () if source is None else arms:
        with tempfile.TemporaryDirectory() as folder:
            yield arm, _robot_of(source, Path(folder), arm), _problems(Path(folder), arm, every)


def _robot_of(archive: Path, folder: Path, arm: str) -> RobotDescription:
    """An arm of the archive, whose problems are unpacked too."""
    with tarfile.open(archive) as packed:
        wanted = [each for each in packed.getmembers() if f"/resources/{arm}/" in each.name]
        packed.extractall(folder, wanted, filter="data")
    source = next(folder.glob(f"*/resources/{arm}"))
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


def measure(robot: RobotDescription, problems: Iterator[Problem]) -> Results:
    """Plan each problem twice: as a whole, and the polyline alone."""
    found = Results([], [], [], [], [])
    for problem in problems:
        there = replace(robot, collision=robot.collision.among(problem.scene))
        request = MotionRequest(
            problem.start, problem.goal, PlannerName.OMPL, Scaling(1.0), timeout_s=TIMEOUT_S
        )
        begun_ns = time.process_time_ns()
        try:
            motion = plan(there, request)
        except CobotError as exc:
            found.failures.append(f"{problem.name}: {exc}")
            continue
        found.plan_ms.append((time.process_time_ns() - begun_ns) / 1e6)
        found.durations.append(0.0 if motion is None else motion.duration_s)
        if not there.collision.is_free(problem.start):  # the plan leaves the start before it searches
            continue
        begun_ns = time.process_time_ns()
        corners = find_path(there, request, problem.goal[None])
        found.path_ms.append((time.process_time_ns() - begun_ns) / 1e6)
        found.lengths.append(length(corners))
    return found


def _three(values: list[float]) -> tuple[float, ...]:
    return tuple(float(value) for value in np.percentile(values, (50.0, 95.0, 100.0)))
