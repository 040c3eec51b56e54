"""Rejected requests: whether each rejection is explained, and whether the suggested changes really work.

Over the REST API, on virtual time. The requests are random: joint angles beyond limits or in collision,
starts beyond limits, goals out of reach, lines and arcs that end on their way, among two boxes and a ball.
"""

from __future__ import annotations

import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from virtual_service import VirtualService, virtual_service

from benchmarks.table import Row, percentiles, row
from cobot.robot.description import RobotDescription
from cobot.types import Array

Body = dict[str, Any]
SCENE = {
    "board": {"shape": "box", "size": [0.3, 0.6, 0.02], "x": 0.6, "y": 0.0, "z": 0.5},
    "post": {"shape": "box", "size": [0.1, 0.1, 1.2], "x": -0.3, "y": 0.5, "z": 0.6},
    "ball": {"shape": "sphere", "radius": 0.15, "x": 0.2, "y": -0.6, "z": 0.7},
}
SAME_S = 1e-6
"""A plan that is asked for again takes as long, s."""


@dataclass
class Findings:
    """What has come of refused requests.

    Attributes:
        refused: how many there were.
        helped: how many of them had something that works.
        helpless: what the others were, and what was tried.
        works: so many of each kind of change.
        wrong: what was not explained, or did not work when it was asked for.
        spent_s: on each explanation.
    """

    refused: int = 0
    helped: int = 0
    helpless: list[str] = field(default_factory=list)
    works: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    spent_s: list[float] = field(default_factory=list)


def explanations(requests: int) -> Iterator[Row]:
    """Examine this number of rejections."""
    with tempfile.TemporaryDirectory() as folder, virtual_service(Path(folder)) as service:
        begun_s = time.process_time()
        found = examined(service, requests, 13)
        took_s = time.process_time() - begun_s
    yield row(
        f"{found.refused} refused plans: explained and confirmed, with something that works",
        "%",
        (100.0 - 100.0 * len(found.wrong) / requests, 100.0 * found.helped / requests),
        "aim",
        (100.0, 100.0),
        columns=("confirmed", "helped"),
        aim="100 %",
    )
    yield row("an explanation", "s", percentiles(found.spent_s), "planning.explain_s", (2.0,) * 3)
    yield row("CPU time of all of it", "s", (took_s,), "none", (0.0,), columns=("all",))


def examined(service: VirtualService, requests: int, seed: int) -> Findings:
    """The results for this number of rejections, and for the changes that they suggest."""
    service.post("/scene", json={"clear": True, "objects": SCENE})
    robot = service.app.state.services.robot
    random, found = np.random.default_rng(seed), Findings()
    while found.refused < requests:
        kind, body = _request(robot, random)
        refused = service.post(f"/robot/plan/{kind}", json=body)
        if refused.status_code != 200:
            found.refused += 1
            _examine(service, refused.json(), f"{kind} {body}", found)
    service.post("/scene", json={"clear": True})
    return found


def _examine(service: VirtualService, refusal: Body, what: str, found: Findings) -> None:
    explain = refusal.get("explain")
    if not explain or not explain["checks"]:
        found.wrong.append(f"{what}: not explained: {refusal}")
        return
    found.spent_s.append(explain["spent_s"])
    found.helped += bool(explain["works"])
    if not explain["works"]:
        found.helpless.append(f"{what}: {refusal['detail']}; {explain['tried']}")
    for each in explain["works"]:
        found.works[each["change"]] += 1
        again = service.post(each["endpoint"], json=each["body"])
        content = again.json()
        if again.status_code != 200 or abs(content["duration_s"] - each["duration_s"]) > SAME_S:
            found.wrong.append(f"{what}: {each['says']}: {content.get('detail', content.get('duration_s'))}")


def _request(robot: RobotDescription, random: np.random.Generator) -> tuple[str, Body]:
    """A random request that is probably rejected."""
    start = _free(robot, random)
    body: Body = {"start": start.tolist(), "speed": float(random.choice([0.1, 0.5, 1.0])), "samples": 2}
    match random.integers(6):
        case 0:
            return "joints", body | {"joints": _beyond(robot, random).tolist(), "planner": _any(random)}
        case 1:
            return "joints", body | {
                "joints": _free(robot, random).tolist(),
                "start": _beyond(robot, random).tolist(),
            }
        case 2:
            limits = robot.limits
            joints = random.uniform(limits.min_position, limits.max_position)
            return "joints", body | {"joints": joints.tolist(), "planner": _any(random)}
        case 3:
            place = random.normal(size=3)
            place *= random.uniform(0.8, 2.0) / np.linalg.norm(place)
            return "pose", body | _pose(place, random) | {
                "planner": str(random.choice(["ptp", "lin", "auto"]))
            }
        case 4:
            there = robot.model.forward(_free(robot, random)).position
            return "pose", body | _pose(there, random) | {"planner": "ptp"}
        case _:
            here = robot.model.forward(start)
            away = here.position + random.normal(size=3) * 0.3
            a, b, c = here.abc
            along = {"x": away[0], "y": away[1], "z": away[2], "a": a, "b": b, "c": c}
            via = dict(
                zip("xyz", (0.5 * (here.position + away) + random.normal(size=3) * 0.1).tolist(), strict=True)
            )
            path = {"planner": "circ", "via": via} if random.random() < 0.3 else {"planner": "lin"}
            return "pose", body | along | path


def _any(random: np.random.Generator) -> str:
    return str(random.choice(["ptp", "ptp", "auto", "ompl"]))


def _free(robot: RobotDescription, random: np.random.Generator) -> Array:
    limits = robot.limits
    while True:
        joints = random.uniform(limits.min_position, limits.max_position)
        if robot.collision.is_free(joints):
            return np.asarray(joints)


def _beyond(robot: RobotDescription, random: np.random.Generator) -> Array:
    """Joint angles, one of which is beyond its limit."""
    joints, joint = _free(robot, random), random.integers(robot.limits.dof)
    joints[joint] = robot.limits.max_position[joint] + random.uniform(0.001, 1.0)
    return joints


def _pose(place: Array, random: np.random.Generator) -> Body:
    turn = dict(zip("abc", random.uniform(-1.5, 1.5, 3).tolist(), strict=True))
    return dict(zip("xyz", place.tolist(), strict=True)) | turn
