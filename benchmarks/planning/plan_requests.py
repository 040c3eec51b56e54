"""The time of a plan request over the REST API, from the client's call to the parsed answer.

One connection is kept. The requests of all kinds alternate with two floors: a plan from a position to itself,
which passes through the service and the planning process but has no motion, and a read of the joint states.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import httpx2
import numpy as np

from benchmarks.planning.lines import LINE_M
from benchmarks.planning.scenes import problems
from benchmarks.service import service
from benchmarks.table import Row, row
from cobot.config import load_settings
from cobot.robot.description import RobotDescription, load_robot
from cobot.types import Array

COLUMNS = ("p50", "p95", "max")
CLUTTER, SEED = "shelf", 1
FLOOR, READ = "a plan without a motion", "GET /robot/joint_states"
JOINTS, POSE = "/robot/plan/joints", "/robot/plan/pose"
Body = dict[str, Any]


def plan_requests(count: int) -> Iterator[Row]:
    """This number of requests of each kind, in free space and next to shelves."""
    robot = load_robot(load_settings(None))
    took_ms: dict[str, list[float]] = defaultdict(list)
    with service() as run, httpx2.Client(base_url=run.url, timeout=60.0) as client:
        for planner, path, body in _free(robot, count):
            _measure(client, f"{planner}, free space", path, body, took_ms)
        for problem in problems(robot, CLUTTER, count):
            scene = {"clear": True, "objects": boxes_of(problem.robot)}
            client.post("/scene", json=scene).raise_for_status()
            body = {"start": problem.start.tolist(), "joints": problem.goal.tolist(), "planner": "ompl"}
            _measure(client, "ompl, shelves", JOINTS, body, took_ms)
    floor = _three(took_ms.pop(FLOOR))
    yield row(READ, "ms", _three(took_ms.pop(READ)), FLOOR, floor, columns=COLUMNS)
    for kind, found in took_ms.items():
        yield row(
            f"POST /robot/plan, {kind}, {len(found)} answers",
            "ms",
            _three(found),
            FLOOR,
            floor,
            columns=COLUMNS,
            aim="12 ms at p50",
        )


def boxes_of(robot: RobotDescription) -> Body:
    """The boxes around an arm of `scenes`, as objects of a scene."""
    model = robot.model.mj
    geoms = [model.geom(index) for index in range(model.ngeom)]
    return {
        geom.name: {"shape": "box", "size": (2.0 * geom.size).tolist()}
        | dict(zip("xyz", geom.pos.tolist(), strict=True))
        for geom in geoms
        if geom.name.startswith("box")
    }


def _free(robot: RobotDescription, count: int) -> Iterator[tuple[str, str, Body]]:
    """Requests in free space; the lines lead 0.3 m away, and some of them are rejected."""
    random, limits = np.random.default_rng(SEED), robot.limits

    def free() -> Array:
        while True:
            joints = random.uniform(limits.min_position, limits.max_position)
            if robot.collision.is_free(joints):
                return np.asarray(joints)

    for _ in range(count):
        start, goal = free(), free()
        for planner in ("ptp", "ompl"):
            yield planner, JOINTS, {"start": start.tolist(), "joints": goal.tolist(), "planner": planner}
        here, across = robot.model.forward(start), random.normal(size=3)
        away = here.position + LINE_M * across / np.linalg.norm(across)
        a, b, c = here.abc
        pose = dict(zip("xyz", away.tolist(), strict=True)) | {"a": a, "b": b, "c": c}
        line = {"start": start.tolist(), "planner": "lin"} | pose
        yield "lin", POSE, line
        yield "lin without suggestions", POSE, line | {"explain": False}


def _measure(
    client: httpx2.Client, kind: str, path: str, body: Body, took_ms: dict[str, list[float]]
) -> None:
    """Measure a request, the same one without a motion, and a read."""
    took, answer = _send(client, path, body)
    took_ms[kind if "plan_id" in answer else f"{kind}: rejected"].append(took)
    took_ms[FLOOR].append(_send(client, JOINTS, {"start": body["start"], "joints": body["start"]})[0])
    begun_s = time.perf_counter()
    client.get("/robot/joint_states").json()
    took_ms[READ].append(1e3 * (time.perf_counter() - begun_s))


def _send(client: httpx2.Client, path: str, body: Body) -> tuple[float, Body]:
    """The time until the answer, ms, and the answer."""
    begun_s = time.perf_counter()
    answer = client.post(path, json=body).json()
    return 1e3 * (time.perf_counter() - begun_s), answer


def _three(values: list[float]) -> tuple[float, ...]:
    return tuple(map(float, np.percentile(values, (50.0, 95.0, 100.0))))
