"""The time from a policy's chunk to the first cycle that it changes, for policies on openpi servers."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from benchmarks.loop.cycle import stopped
from benchmarks.loop.modes import go_home
from benchmarks.service import background, reader, service
from benchmarks.streams.latency import changed_ns, echoed
from benchmarks.table import Row, percentiles, row
from cobot import Mode, Robot
from cobot.ipc.shm import RobotMemory
from cobot.learning.openpi import PolicyConnection
from cobot.learning.policy import PolicyRunner

PERIOD_S = 0.01
STILL_S = 0.02
COMMAND_HZ = 100


class Noted:
    """A policy that records the times of its answers.

    Attributes:
        sent_ns, here_ns: when the last answer was sent by its server, and when it was here, unpacked.
    """

    def __init__(self, connection: PolicyConnection) -> None:
        self._connection = connection
        self.sent_ns = self.here_ns = 0

    def infer(self, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        answer = self._connection.infer(observation)
        self.here_ns = time.monotonic_ns()
        self.sent_ns = int(answer["sent_ns"])
        return answer


def policy(repetitions: int, slices: int) -> Iterator[Row]:
    """Chunks for an arm at rest, in slices that alternate with those of an echo and of a bare client."""
    random = np.random.default_rng(6)
    count = repetitions // slices
    from_server, from_here, bare_way, bare_loop = ([] for _ in range(4))
    with service() as run, background("benchmarks.streams.bare_policy") as server:
        assert server.stdout is not None
        address = f"127.0.0.1:{int(server.stdout.readline())}"
        memory = reader(run)
        for _ in range(slices):
            go_home(run)
            for sent, here in _chunks(run.memory.name.removeprefix("cobot-"), memory, address, count, random):
                from_server.append(sent)
                from_here.append(here)
            with stopped(run):
                bare_way += _listened(address, count, random)
                bare_loop += echoed(count, random)
    yield row(
        "policy chunk, from its server to the first commanded position that it changes",
        "ms",
        percentiles(from_server),
        "from its server to a client that only listens",
        percentiles(bare_way),
    )
    yield row(
        "policy chunk, once it is here, to the first commanded position that it changes",
        "ms",
        percentiles(from_here),
        "bare loop at 1 kHz that answers a block",
        percentiles(bare_loop),
    )


def _chunks(
    robot_name: str, memory: RobotMemory, address: str, count: int, random: np.random.Generator
) -> Iterator[tuple[float, float]]:
    """Times until the first changed cycle, ms: from the moment the server sends, and from the arrival of the
    answer.
    """
    with PolicyConnection(address) as connection, Robot(robot_name, verbose=False) as robot:
        robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
        with robot.start_joint_impedance_control(COMMAND_HZ, interpolation="quintic") as control:
            noted = Noted(connection)
            runner = PolicyRunner(robot, control, noted, PERIOD_S)
            for _ in range(count):
                before = _at_rest(memory)
                time.sleep(random.uniform(0.0, 1e-3))  # at any time of a cycle
                runner.once()
                changed = changed_ns(memory, before)
                yield (changed - noted.sent_ns) / 1e6, (changed - noted.here_ns) / 1e6


def _at_rest(memory: RobotMemory) -> float:
    """The commanded position of the first joint, once it has stayed the same for a while."""
    here, since_s = float("nan"), 0.0
    while True:
        now = float(memory.state.read()["commanded_position"][0])
        if now != here:
            here, since_s = now, time.monotonic()
        elif time.monotonic() - since_s > STILL_S:
            return here
        time.sleep(1e-3)


def _listened(address: str, count: int, random: np.random.Generator) -> list[float]:
    """Times of the same answer, ms, for a client that does nothing with it."""
    delays = []
    with PolicyConnection(address) as connection:
        for _ in range(count):
            time.sleep(random.uniform(0.004, 0.006))
            answer = connection.infer({"observation/state": np.zeros(7, np.float32), "prompt": ""})
            delays.append((time.monotonic_ns() - int(answer["sent_ns"])) / 1e6)
    return delays
