"""The amount of code that a request passes, and the time until it moves the arm: `POST /robot/move/pose` with
lin.

`python -m benchmarks.request_path` lists the functions in the order of their first calls.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from cobot_run import Run
from folders import ROOT, SUPPORT

from benchmarks.call_recorder import CALLS, PHASE
from benchmarks.service import reader, service
from benchmarks.table import Row, percentiles, row
from cobot.config import load_settings
from cobot.errors import UnavailableError
from cobot.ipc.shm import RobotMemory
from cobot.motions.requests import MotionRequest
from cobot.planners import plan
from cobot.robot.description import RobotDescription, load_robot
from cobot.types import PlannerName, Pose, Scaling

NOTHING, AT_REST, ANY_REQUEST, MOTION = range(4)
"""The phases of the recording."""
SETTLE_S, AT_REST_S = 0.5, 4.0
"""Time that the last request may take to end after its answer, and time of recording at rest, s."""
REPETITIONS = 3
LINE_M = 0.02
"""Length of the line, straight up from the position home."""
MAX_FUNCTIONS, MAX_FILES = 170, 40
"""The aim of what a motion adds to any request that changes something."""
NOT_NAMED = ("<module>", "<listcomp>", "<setcomp>", "<dictcomp>", "<genexpr>")
"""Code that is a part of the function around it, or the import of a module."""
WARM_UP = 4
POLL_S = 1e-4
TIMEOUT_S = 60.0
Body = dict[str, Any]


def passed(repetitions: int) -> Iterator[Row]:
    """The functions and files that a line passes, and its latency."""
    own, shared = recorded()
    yield row(
        "POST /robot/move/pose with lin: what it passes of app/ and cobot/, in addition to any request",
        "",
        (len(own), len(_files(own))),
        "aim",
        (MAX_FUNCTIONS, MAX_FILES),
        columns=("functions", "files"),
        aim=f"{MAX_FUNCTIONS} and {MAX_FILES}",
    )
    yield row(
        "POST /robot/acknowledge: what any request passes that changes something",
        "",
        (len(shared), len(_files(shared))),
        "with a line in addition",
        (len(own) + len(shared), len(_files(own + shared))),
        columns=("functions", "files"),
    )
    yield from _latency(repetitions)


def recorded() -> tuple[list[str], list[str]]:
    """The functions that only a line calls, and those that every request calls, in the order of their first
    calls.

    Left out are tasks that also run while nothing is requested, and threads that write files later.
    """
    with tempfile.TemporaryDirectory(prefix="cobot-bench-") as name:
        folder = Path(name)
        (folder / PHASE).write_bytes(bytes([NOTHING]))
        (folder / "sitecustomize.py").write_text(
            f"from benchmarks.call_recorder import record\nrecord({name!r})\n", encoding="utf-8"
        )
        run = _Recorded(folder, "realtime")
        try:
            run.until(run.healthy)
            app = run.child("app")
            assert app is not None
            processes = {str(each.pid) for each in (app, *app.children())}
            lines = _lines(load_robot(load_settings(None)))

            def go_up_and_back() -> None:
                for _, body in lines:
                    _post(client, "/robot/move/pose", body)

            with httpx.Client(base_url=run.url, timeout=TIMEOUT_S) as client:
                _post(client, "/robot/move/named", {"name": "home", "speed": 1.0})
                go_up_and_back()  # imports, and the first use of everything
                time.sleep(SETTLE_S)
                _record(folder, AT_REST, lambda: time.sleep(AT_REST_S))
                _record(folder, ANY_REQUEST, lambda: _post(client, "/robot/acknowledge", {}))
                _record(folder, MOTION, go_up_and_back)
            calls = [line.split("\t") for line in (folder / CALLS).read_text(encoding="utf-8").splitlines()]
        finally:
            run.end()
    calls = [call for call in calls if call[0] in processes and not call[3].endswith(NOT_NAMED)]
    background = {root for _, phase, root, _ in calls if int(phase) == AT_REST}
    ways = {
        number: dict.fromkeys(
            function
            for _, phase, root, function in calls
            if int(phase) == number and root not in background and not root.startswith("cobot/logs/outlet.py")
        )
        for number in (ANY_REQUEST, MOTION)
    }
    shared = ways[ANY_REQUEST]
    return [function for function in ways[MOTION] if function not in shared], list(shared)


class _Recorded(Run):
    """A service whose processes record their calls in its folder."""

    def start(self) -> None:
        path = os.pathsep.join(map(str, (self.config.parent, ROOT, SUPPORT)))
        self.environment = os.environ | {"PYTHONPATH": path}
        super().start()


def _record(folder: Path, phase: int, do: Callable[[], object]) -> None:
    with (folder / PHASE).open("r+b", 0) as file:
        for number in (phase, NOTHING):
            file.seek(0)
            file.write(bytes([number]))
            if number:
                for _ in range(REPETITIONS):
                    do()


def _lines(robot: RobotDescription) -> tuple[tuple[MotionRequest, Body], tuple[MotionRequest, Body]]:
    """The line upwards from home and the line back, each as a request for the planner and as a request
    body.
    """
    home = np.array(robot.positions["home"].joints)
    below = robot.model.forward(home)
    above = Pose(below.position + np.array([0.0, 0.0, LINE_M]), below.quaternion)
    up = MotionRequest(home, above, PlannerName.LIN, Scaling(1.0))
    motion = plan(robot, up)
    assert motion is not None
    return (up, _body(above)), (replace(up, start=motion.end, goal=below), _body(below))


def _body(goal: Pose) -> Body:
    numbers = (*goal.position.tolist(), *goal.abc)
    return {**dict(zip("xyzabc", numbers, strict=True)), "planner": "lin", "speed": 1.0}


def _post(client: httpx.Client, path: str, body: Body) -> None:
    answer = client.post(path, json=body)
    assert answer.json().get("success", answer.is_success), answer.text


def _latency(repetitions: int) -> Iterator[Row]:
    """The time until a plan is answered, and until the arm moves. The service plans the line in both
    cases.
    """
    robot = load_robot(load_settings(None))
    lines = _lines(robot)
    planned, moving, alone = [], [], []
    with (
        service() as run,
        httpx.Client(base_url=run.url, timeout=TIMEOUT_S) as client,
        ThreadPoolExecutor(1) as other,
    ):
        memory = reader(run)
        _post(client, "/robot/move/named", {"name": "home", "speed": 1.0})
        for number in range(-WARM_UP, repetitions):
            request, body = lines[number % 2]
            samples = [
                _ms(lambda request=request: plan(robot, request)),
                _ms(lambda body=body: _post(client, "/robot/plan/pose", body)),
            ]
            begun_ns = time.monotonic_ns()
            motion = other.submit(_post, client, "/robot/move/pose", body)
            samples.append((_moving_ns(memory, begun_ns) - begun_ns) / 1e6)
            motion.result()
            if number >= 0:
                for sample, kept in zip(samples, (alone, planned, moving), strict=True):
                    kept.append(sample)
    for name, samples in (
        ("plan/pose with lin, answered", planned),
        ("move/pose with lin, until the arm moves", moving),
    ):
        yield row(
            f"POST /robot/{name}",
            "ms",
            percentiles(samples),
            "planning that line in the client's process",
            percentiles(alone),
        )


def _ms(do: Callable[[], object]) -> float:
    begun_ns = time.monotonic_ns()
    do()
    return (time.monotonic_ns() - begun_ns) / 1e6


def _moving_ns(memory: RobotMemory, since_ns: int) -> int:
    """The time of the first published state in which the arm is on its path."""
    while time.monotonic_ns() < since_ns + TIMEOUT_S * 1e9:
        state = memory.state.read()
        if int(state["motion_result"]) == 1 and float(state["path_time_s"]) > 0.0:
            return int(state["monotonic_ns"])
        time.sleep(POLL_S)
    raise UnavailableError(f"the line has not begun within {TIMEOUT_S:g} s")


def _files(functions: list[str]) -> list[str]:
    return list(dict.fromkeys(function.partition(":")[0] for function in functions))


def main() -> None:
    for what, functions in zip(("a line alone", "any request"), recorded(), strict=True):
        print(f"{what}: {len(functions)} functions in {len(_files(functions))} files")
        print(*functions, sep="\n")


if __name__ == "__main__":
    main()
