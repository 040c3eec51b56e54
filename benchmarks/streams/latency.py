"""The time from a command to the first cycle that it changes, through shared memory and through the
WebSocket.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator

import numpy as np
from websockets.sync.client import connect

from benchmarks.loop import bare_echo
from benchmarks.loop.cycle import stopped
from benchmarks.loop.modes import go_home
from benchmarks.service import background, reader, service
from benchmarks.table import Row, percentiles, row
from benchmarks.web.answers import address
from cobot import Mode, Robot
from cobot.errors import UnavailableError
from cobot.ipc.memory_file import FOLDER
from cobot.ipc.shm import RobotMemory

STEP_RAD = 1e-8
"""So little that it is reached within one cycle: what changes after a command has changed through it."""
POLL_S = 1e-4
PAUSE_S = (0.004, 0.006)
"""Between commands: they come at any time of a cycle, and never in the same one."""
MAX_WAIT_S = 1.0


def commands(repetitions: int, slices: int) -> Iterator[Row]:
    """Joint targets from a client, in slices that alternate with those of a bare echo."""
    random = np.random.default_rng(4)
    near, far, near_floor, far_floor = [], [], [], []
    count = repetitions // slices
    with service() as run, background("benchmarks.web.bare") as bare:
        memory = reader(run)
        bare_url = address(bare)
        for _ in range(slices):
            go_home(run)
            near += _session(run.memory.name.removeprefix("cobot-"), memory, count, random)
            far += _session(run.url, memory, count, random)
            with stopped(run):
                near_floor += echoed(count, random)
                far_floor += _round_trips(bare_url, count, random)
    yield row(
        "target in shared memory to the first commanded position that it changes",
        "ms",
        percentiles(near),
        "bare loop at 1 kHz that answers a block",
        percentiles(near_floor),
    )
    yield row(
        "target through the WebSocket to the first commanded position that it changes",
        "ms",
        percentiles(far),
        "round trip to a bare FastAPI WebSocket",
        percentiles(far_floor),
    )


def _session(robot_or_url: str, memory: RobotMemory, count: int, random: np.random.Generator) -> list[float]:
    """Milliseconds from each call of `set_target_joints` to the publication of the first changed cycle."""
    delays = []
    with Robot(robot_or_url, verbose=False) as robot:
        robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
        with robot.start_joint_impedance_control(1000) as control:
            home = np.array(control.get_state().q)
            for number in range(1, count + 1):
                time.sleep(random.uniform(*PAUSE_S))
                before = float(memory.state.read()["commanded_position"][0])
                home[0] += STEP_RAD if number % 2 else -STEP_RAD
                begun_ns = time.monotonic_ns()
                control.set_target_joints(home)
                delays.append((changed_ns(memory, before) - begun_ns) / 1e6)
    return delays


def changed_ns(memory: RobotMemory, before: float) -> int:
    """The publication time of the first state with a different commanded position. If that state was missed,
    the next one counts.
    """
    deadline_s = time.monotonic() + MAX_WAIT_S
    while time.monotonic() < deadline_s:
        state = memory.state.read()
        if float(state["commanded_position"][0]) != before:
            return int(state["monotonic_ns"])
        time.sleep(POLL_S)
    raise UnavailableError(f"no target has changed the command within {MAX_WAIT_S:g} s")


def echoed(count: int, random: np.random.Generator) -> list[float]:
    delays: list[float] = []
    with tempfile.NamedTemporaryFile(dir=FOLDER, prefix="bench-echo-") as file:
        question, answer = bare_echo.mapped(file.name)
        with background("benchmarks.loop.bare_echo", file.name):
            for number in range(count + 1):
                time.sleep(random.uniform(*PAUSE_S))
                question.data["number"] = number + 1
                begun_ns = time.monotonic_ns()
                question.publish()
                while not (answer.try_read() and answer.data["number"] == number + 1):
                    time.sleep(POLL_S)
                delays.append((int(answer.data["monotonic_ns"]) - begun_ns) / 1e6)
    return delays[1:]  # the first one has waited for the loop's beginning


def _round_trips(url: str, count: int, random: np.random.Generator) -> list[float]:
    delays = []
    with connect(f"ws{url.removeprefix('http')}/echo", proxy=None, compression=None) as socket:
        for _ in range(count):
            time.sleep(random.uniform(*PAUSE_S))
            begun_ns = time.monotonic_ns()
            socket.send(bytes(512))
            socket.recv()
            delays.append((time.monotonic_ns() - begun_ns) / 1e6)
    return delays
