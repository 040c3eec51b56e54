"""The time that the service needs to lead a running motion around an object that appears in its path.

From the client's call that adds the object until it has the answer, and until the real-time loop has accepted
the new path. `planning.replan_within_s` is 0.2 here, ten times the usual time, so that slow cases are
measured too.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event

import numpy as np
from cobot_run import Run

from benchmarks.service import reader
from benchmarks.table import Row, row
from cobot.client import Client
from cobot.config import load_settings
from cobot.ipc.shm import RobotMemory
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.scene import Scene, SceneObject
from cobot.types import Array

COLUMNS = ("p50", "p95", "max")
SPEED, BALL_M = 0.2, 0.05
POLL_S = 3e-4
SHARES = 0.55, 0.85
"""The object appears at a place of the path between these shares of the way."""


def around(motions: int) -> Iterator[Row]:
    """Motions between random positions. In each motion a ball appears in the path, but not at the goal."""
    robot = load_robot(load_settings(None))
    with tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder:
        run = Run(Path(folder), "realtime", planning="replan_within_s: 0.2")
        try:
            run.until(run.healthy)
            with Client(run.url, motion_timeout_s=60.0) as client:
                found, stopped = measure(client, robot, reader(run), motions)
        finally:
            run.end()
    answered, accepted = np.percentile(found, (50.0, 95.0, 100.0), axis=0).T
    yield row(
        f"a way around an object that appears, {len(found)} motions, {stopped} stopped instead: from the "
        "client's call until the real-time loop has the new path",
        "ms",
        tuple(map(float, accepted)),
        "until the client has the answer",
        tuple(map(float, answered)),
        columns=COLUMNS,
        aim="30 ms at p95",
    )


def measure(
    client: Client, robot: RobotDescription, memory: RobotMemory, motions: int
) -> tuple[list[tuple[float, float]], int]:
    """For each motion that was led around, the times until the answer and until the new path, ms; and the
    number of those that were stopped.
    """
    random, home = np.random.default_rng(5), np.array(robot.positions["home"].joints)
    bounds = 0.95 * robot.limits.min_position, 0.95 * robot.limits.max_position
    found: list[tuple[float, float]] = []
    stopped = 0
    while len(found) + stopped < motions:
        start, goal = home + random.uniform(-0.6, 0.6, (2, len(home)))
        start[0], goal[0] = sorted((start[0] - 0.7, goal[0] + 0.7))
        start, goal = (np.clip(each, *bounds) for each in (start, goal))
        if not (robot.collision.is_free(start) and robot.collision.is_free(goal)):
            continue
        client.change_scene(clear=True)
        client.move_joints(start.tolist(), speed=1.0, planner="auto")
        plan = client.plan("joints", joints=goal.tolist(), speed=SPEED)
        rows = np.array([each["joints"] for each in plan["path"]])
        place = place_of(robot, rows, random.uniform(*SHARES))
        if not leaves_free(robot, place, goal):
            continue
        job = client.move_joints(goal.tolist(), speed=SPEED, wait=False)
        while job.read()["progress"] < 0.1:
            time.sleep(0.01)
        ball = {"shape": "sphere", "radius": BALL_M, "x": place[0], "y": place[1], "z": place[2]}
        answered = Event()
        with ThreadPoolExecutor(1) as other:
            watch = other.submit(accepted_at, memory, answered)
            begun_s = time.perf_counter()
            answer = client.change_scene(objects={"ball": ball})
            took_s = time.perf_counter() - begun_s
            answered.set()
        if answer["stopped"]:
            stopped += 1
        else:
            found.append((1e3 * took_s, 1e3 * (watch.result() - begun_s)))
        client.stop()
    return found, stopped


def accepted_at(memory: RobotMemory, answered: Event) -> float:
    """The time at which the real-time loop takes its path from a different slot, or at which the client has
    its answer.
    """
    slot = int(memory.state.read()["slot"])
    while not answered.is_set() and int(memory.state.read()["slot"]) == slot:
        time.sleep(POLL_S)
    return time.perf_counter()


def leaves_free(robot: RobotDescription, place: list[float], joints: Array) -> bool:
    """Whether a ball at this place would not touch the arm in this position."""
    ball = SceneObject("sphere", (BALL_M,), (place[0], place[1], place[2], 1.0, 0.0, 0.0, 0.0))
    return robot.collision.among(Scene(1, {"ball": ball})).is_free(joints)


def place_of(robot: RobotDescription, rows: Array, share: float) -> list[float]:
    joints = rows[int(share * (len(rows) - 1))]
    return [float(each) for each in robot.model.forward(joints).position]
