"""Simulated controllers that number their joint states, lose datagrams and simulate faults.

python -m benchmarks.ros.controllers DOMAIN RATE_HZ: a line of its input is a JSON object with what changes,
`loss` (share of the datagrams, in each direction), `silent`, `nan`, `active`, `forward` or `is_numbered`;
each is answered with its state.
"""

from __future__ import annotations

import asyncio
import json
import os
import random
import signal
import subprocess
import sys
import time
from types import TracebackType
from typing import Any, Self

import numpy as np

from benchmarks.backends.driven import PRIORITY
from cobot.config import load_settings
from cobot.dds.controller_simulator import COMMANDS, SimulatedControllers
from cobot.dds.names import ENCLAVE, NodeName
from cobot.dds.node import DdsNode, Message
from cobot.dds.rtps import Participant
from cobot.robot.description import load_robot
from cobot.ros.messages import Messages
from rtloop.realtime import prepare

ECHO = "/echo/commands"
TRAJECTORIES, FORWARD = "joint_trajectory_controller", "forward_position_controller"
STEP_RAD = 1e-7
"""Change of the last joint with each joint state, by which a command names the state that it answers."""


class Controllers(SimulatedControllers):
    """Attributes:
    is_numbered: whether the joint states are numbered and the commands timed.
    """

    def __init__(self, node: DdsNode, joints: list[str], position: np.ndarray) -> None:
        super().__init__(node, joints, position, "", TRAJECTORIES, FORWARD, {"data": ""}, [])
        self.is_numbered = self.silent = self.nan = False
        self._number, self._base = 0, float(position[-1])
        self._sent_s: dict[int, float] = {}
        self.took_s: dict[str, list[float]] = {"backend": [], "echo": []}
        node.subscription(ECHO, COMMANDS, lambda message: self._time("echo", message), reliable=False)

    def _tell_states(self) -> None:
        if self.silent:
            return
        rows = self.controller.rows
        here = rows[0, -1]
        if self.nan:
            rows[0, -1] = np.nan
        elif self.is_numbered:
            self._number += 1
            rows[0, -1] = self._base + STEP_RAD * self._number
            self._sent_s[self._number] = time.monotonic()
            self._sent_s.pop(self._number - 1000, None)
        super()._tell_states()
        rows[0, -1] = here

    def _command(self, message: Message) -> None:
        if self.is_numbered:
            self._time("backend", message)
        else:
            super()._command(message)

    def _time(self, whose: str, message: Message) -> None:
        number = round((message["data"][-1] - self._base) / STEP_RAD)
        if number in self._sent_s:
            self.took_s[whose].append(time.monotonic() - self._sent_s[number])

    def state(self) -> dict[str, Any]:
        counts = {f"{whose}_answers": len(took) for whose, took in self.took_s.items()}
        times = {
            whose: (1e6 * np.percentile(took, (50.0, 99.0, 99.9))).tolist()
            for whose, took in self.took_s.items()
            if took
        }
        return {**counts, "us": times, "sent": self._number}


async def _serve(domain: int, rate_hz: float) -> None:
    robot = load_robot(load_settings())
    chance, share = random.Random(1), [0.0]

    def lost() -> bool:
        return chance.random() < share[0]

    name = NodeName("controller_manager", "/")
    participant = Participant(domain, localhost_only=True, name=name.full, user_data=ENCLAVE, loss=lost)
    wire = participant._wire
    take = wire._on_datagram
    wire._on_datagram = lambda view, sender: None if lost() else take(view, sender)
    loop = asyncio.get_running_loop()
    node = DdsNode(participant, name, Messages(), None, loop)
    made = Controllers(node, list(robot.limits.names), np.array(robot.positions["home"].joints))
    running = asyncio.create_task(made.run(rate_hz))
    reader = asyncio.StreamReader()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    print("ready", flush=True)
    while line := await reader.readline():
        request = json.loads(line)
        share[0] = request.get("loss", share[0])
        made.silent, made.nan = request.get("silent", made.silent), request.get("nan", made.nan)
        made.is_numbered = request.get("is_numbered", made.is_numbered)
        if "forward" in request:
            pair = ({FORWARD}, {TRAJECTORIES}) if request["forward"] else ({TRAJECTORIES}, {FORWARD})
            made.switch(activate=pair[0], deactivate=pair[1])
        if "active" in request:
            on, off = ({TRAJECTORIES}, set()) if request["active"] else (set(), {TRAJECTORIES})
            made.switch(activate=on, deactivate=off)
        print(json.dumps(made.state()), flush=True)
    running.cancel()
    node.close()
    participant.close()


class ControllersProcess:
    """The controllers in a process that runs while the context is open."""

    def __init__(self, domain: int, rate_hz: float) -> None:
        self.domain = domain
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.ros.controllers", str(domain), str(rate_hz)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._line()

    def ask(self, *, hangs: bool | None = None, **request: Any) -> dict[str, Any]:
        """Change the controllers' behaviour, and read their state. `hangs` suspends or continues the
        process.
        """
        if hangs:
            os.kill(self._process.pid, signal.SIGSTOP)
            return {}
        if hangs is False:
            os.kill(self._process.pid, signal.SIGCONT)
        assert self._process.stdin is not None
        print(json.dumps(request), file=self._process.stdin, flush=True)
        found: dict[str, Any] = json.loads(self._line())
        return found

    def _line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, at: TracebackType | None
    ) -> None:
        with self._process:
            self._process.kill()


if __name__ == "__main__":
    prepare(PRIORITY, None, None)
    asyncio.run(_serve(int(sys.argv[1]), float(sys.argv[2])))
