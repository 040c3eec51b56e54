"""RRT-Connect of roboplan (MIT), which checks samples of its path with exact shapes and keeps no margin."""

from __future__ import annotations

import time
from itertools import combinations
from pathlib import Path

import numpy as np

from benchmarks.planning.motion_bench_maker import ARMS, TIMEOUT_S, Problem
from benchmarks.planning.peers.searches import MissingPeer, Search, Unsolved
from cobot.types import Array, Pose

SEED = 1
MAX_NODES = 100_000
STEP_RAD = 0.05
"""Distance of the configurations that are checked on an edge: its default."""
COLOUR = np.array([0.5, 0.5, 0.5, 1.0])


def search_of(arm: str, resources: Path) -> Search:
    """
    Raises:
        MissingPeer: the package is not installed.
    """
    try:
        from roboplan import core, rrt
    except ImportError as exc:
        raise MissingPeer("not installed (pip install .[bench])") from exc
    srdf = (resources / f"{arm}.srdf").read_text()

    def search(problem: Problem) -> tuple[float, ...] | Unsolved:
        model = core.loadUrdfSceneDescription(str(resources / f"{arm}.urdf"), [str(resources)])
        scene = core.Scene("scene", model)
        scene.importSrdf(srdf)
        for name, each in problem.scene.objects.items():
            place = _matrix(Pose.from_numbers(each.pose))
            if each.shape == "box":
                scene.addBoxGeometry(name, "universe", core.Box(*each.size), place, COLOUR)
            else:
                scene.addCylinderGeometry(name, "universe", core.Cylinder(*each.size), place, COLOUR)
        scene.setCollisions(list(combinations(problem.scene.objects, 2)), False)
        ends = (problem.start, problem.goal)
        if any(scene.hasCollisions(scene.toFullJointPositions(ARMS[arm], end)) for end in ends):
            return Unsolved.ENDS
        names = scene.getJointGroupInfo(ARMS[arm]).joint_names
        planner = rrt.RRT(
            scene,
            rrt.RRTOptions(
                group_name=ARMS[arm],
                rrt_connect=True,
                max_nodes=MAX_NODES,
                max_planning_time=TIMEOUT_S,
                collision_check_step_size=STEP_RAD,
            ),
        )
        planner.setRngSeed(SEED)
        begun_ns = time.process_time_ns()
        try:
            planner.plan(*(core.JointConfiguration(names, end) for end in ends))
        except RuntimeError:
            return Unsolved.SEARCH
        return ((time.process_time_ns() - begun_ns) / 1e6,)

    return search


def _matrix(pose: Pose) -> Array:
    """Shape (4, 4)."""
    found = np.eye(4, order="F")
    found[:3, :3], found[:3, 3] = pose.rotation, pose.position
    return found
