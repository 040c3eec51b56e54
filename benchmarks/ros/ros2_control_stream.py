"""ros2_control at the rate of its controllers: answers to joint states, lost datagrams and recoveries.

The controllers are cobot's simulated ones, in a process of their own.
"""

from __future__ import annotations

import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml
from cobot_run import WAIT_S, Run
from dds_peers import own_domain

from benchmarks.backends.derivatives import commands_row, goals_row
from benchmarks.backends.driven import Faults, driven
from benchmarks.ros.controllers import ControllersProcess
from benchmarks.service import background
from benchmarks.table import Row, row
from cobot.config import load_settings
from cobot.robot.description import load_robot

RATES_HZ = (250.0, 500.0)
MOVES_HZ = 250.0
TURN_RAD, SPEED = 0.3, 0.3
FAULTS: Faults = {
    "joint states that stop": ({"silent": True}, {"silent": False}),
    "values that are not numbers": ({"nan": True}, {"nan": False}),
    "a deactivated controller": ({"active": False}, {"active": True}),
    "a driver that hangs": ({"hangs": True}, {"hangs": False}),
}
"""Each in the middle of a motion, with what ends it."""


class RunAtControllers(Run):
    """The shipped iiwa behind these controllers."""

    def __init__(self, folder: Path, domain: int, kind: str) -> None:
        self._kind = kind
        super().__init__(folder, clock="realtime", ros_domain=domain)

    def start(self) -> subprocess.Popen[str]:
        settings = yaml.safe_load(self.config.read_text(encoding="utf-8"))
        settings["robot"]["backend"] = {"type": self._kind, "connect_s": 20.0, "state_timeout_s": 0.5}
        settings["rt"] |= {"period_s": 0.004, "frozen_after_s": 0.5}
        self.config.write_text(yaml.safe_dump(settings), encoding="utf-8")
        return super().start()


def answers(rate_hz: float, count: int) -> Iterator[Row]:
    """The time from a joint state to the command that answers it, next to the least client."""
    with own_domain() as domain, ControllersProcess(domain, rate_hz) as controllers:
        controllers.ask(forward=True)
        with (
            background("benchmarks.ros.stream_client", "backend", str(domain)),
            background("benchmarks.ros.stream_client", "echo", str(domain)),
        ):
            time.sleep(5.0)
            first = controllers.ask(is_numbered=True)["sent"]
            until_s = time.monotonic() + WAIT_S + 2.0 * count / rate_hz
            state: dict[str, Any] = {"sent": 0}
            while state["sent"] - first < count and time.monotonic() < until_s:
                time.sleep(0.5)
                state = controllers.ask()
    sent = state["sent"] - first
    yield row(
        f"ros2_control_stream at {rate_hz:g} Hz: a joint state to its command; of {sent} states "
        f"{state['backend_answers']} have one, {state['echo_answers']} of the least client",
        "µs",
        state["us"]["backend"],
        "a node that only echoes",
        state["us"]["echo"],
    )


def faults(kind: str, moves: int, repetitions: int) -> Iterator[Row]:
    """Moves during which 5 % of the datagrams are lost in each direction, and recoveries."""
    settings = load_settings()
    home = list(load_robot(settings).positions["home"].joints)
    goals = ([home[0] + TURN_RAD, *home[1:]], home)
    with (
        own_domain() as domain,
        ControllersProcess(domain, MOVES_HZ) as controllers,
        tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder,
    ):
        streams = kind.endswith("stream")
        controllers.ask(forward=streams)
        run = RunAtControllers(Path(folder), domain, kind)
        with driven(kind, controllers, run, goals, speed=SPEED, fault_speed=0.05) as made:
            yield made.moves_row(moves)
            for name, (fault, end) in FAULTS.items():
                if not (streams and "active" in fault):
                    yield made.recovery_row(name, fault, end, repetitions, "nothing of the controllers", 0.0)


def ros2_control_stream(quick: bool) -> Iterator[Row]:
    """Run all measurements. This takes about twelve minutes, or two minutes with `quick`."""
    yield goals_row(5 if quick else 50)
    kind = "ros2_control_stream"
    yield commands_row(f"{kind}: commands that the controller is sent", load_settings(), kind)
    for rate_hz in RATES_HZ:
        yield from answers(rate_hz, 2000 if quick else 100_000)
    for kind in ("ros2_control", "ros2_control_stream"):
        yield from faults(kind, 4 if quick else 40, 1 if quick else 5)
