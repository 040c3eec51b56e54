"""KUKA's RSI: how soon a controller has its answer; what losses and faults cost; what the arm is sent."""

from __future__ import annotations

import contextlib
import math
import os
import socket
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from cobot_run import WAIT_S
from rsi_run import HOME, WORK, RsiProcess, RunOverRsi, free_udp_port, kr10

from benchmarks.backends.derivatives import commands_row
from benchmarks.backends.driven import PRIORITY, SPOILED, Faults, driven
from benchmarks.service import background
from benchmarks.table import Row, percentiles, row
from cobot.config import load_settings
from cobot.robot.description import load_robot
from rtloop.backends.rsi.simulator.controller import RsiController
from rtloop.backends.rsi.simulator.lockstep import controller_for
from rtloop.backends.rsi.simulator.options import ControllerOptions

SPEED = 0.3
"""Of the moves under loss: a lost packet is 12 ms, in which this arm moves by 0.07 rad at full speed."""
PERIOD_MS = 4
WARM = 500
ANSWER_S = 0.02
"""A packet that gets no answer for so long is lost."""
FAULTS: Faults = {
    "an emergency stop": ({"estop": True}, {"estop": False}),
    "a change of the operation mode": ({"mode": "T2"}, {"mode": "AUT"}),
    "the end of its program": ({"off": True}, {}),
    "90 % of loss": ({"loss": 0.9}, {"loss": 0.0}),
    "answers three periods late": ({"delay": 3}, {"delay": 0}),
    "a pulled cable": ({"loss": 1.0}, {"loss": 0.0}),
    **SPOILED,
}
"""Each in the middle of a motion, with what ends it."""


def rsi(answers: int, moves: int, repetitions: int) -> Iterator[Row]:
    """Answer times at the controller's largest rate; then moves with lost packets, recoveries, and
    derivatives.
    """
    with tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder:
        yield from _answer_rows(Path(folder), answers)
        config = Path(folder) / "kr10" / "cobot-setting.yaml"
        yield commands_row("RSI: corrections that the controller is sent", load_settings(config), "rsi")
    with tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder:
        port = free_udp_port()
        made = kr10(Path(folder), port)
        with (
            RsiProcess(made, port, "--in-a-row") as controller,
            driven("RSI", controller, RunOverRsi(made), (WORK, HOME), speed=SPEED, fault_speed=0.1) as arm,
        ):
            yield arm.moves_row(moves)
            yield from arm.recovery_rows(
                FAULTS,
                repetitions,
                "until the controller has ten answers",
                lambda ended: arm.controller.ask()["answered"] > ended["answered"] + 10,
            )


def _answer_rows(folder: Path, answers: int) -> Iterator[Row]:
    port = free_udp_port()
    made = kr10(folder, port, PERIOD_MS, inputs={}, outputs={}) / "cobot-setting.yaml"
    controller = _controller(made)
    with background("benchmarks.backends.bare_rsi", str(port)):
        floor = _answer_times(controller, port, answers)
    controller = _controller(made)
    with background("benchmarks.backends.bare_rsi", str(port), str(made)):
        ours = _answer_times(controller, port, answers)
    yield row(
        f"RSI: a telegram to its answer, {answers} of them, as fast as the controller sends",
        "µs",
        percentiles(ours),
        "a client that only echoes",
        percentiles(floor),
    )
    late, late_floor = ((1e5 * float(np.mean(np.array(each) > 1e3 * PERIOD_MS)),) for each in (ours, floor))
    yield row(
        f"RSI: of these telegrams, not answered within the {PERIOD_MS} ms of IPO_FAST",
        "",
        late,
        "a client that only echoes",
        late_floor,
        columns=("of 100,000",),
        aim="0",
    )


def _controller(config: Path) -> RsiController:
    """A controller that sends one telegram per period. An arm without dynamics would not answer faster."""
    settings = load_settings(config)
    robot = load_robot(settings)
    start = np.array(robot.positions[settings.robot.start_position].joints)
    return controller_for(settings, robot.limits, ControllerOptions(in_a_row=True, timeout=10_000), start)


def _answer_times(controller: RsiController, port: int, answers: int) -> list[float]:
    """Times from sending a telegram to the arrival of its answer, µs; infinite for a lost telegram."""
    took: list[float] = []
    deadline_s = time.monotonic() + WAIT_S
    with _priority(), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.bind(("127.0.0.1", 0))
        peer.connect(("127.0.0.1", port))
        peer.settimeout(ANSWER_S)
        while len(took) < answers + WARM:
            packet = controller.packet()
            if not packet:
                continue
            begun = time.perf_counter_ns()
            found = math.inf
            try:
                peer.send(packet)
                while controller.waits_for_answer:  # an answer to a lost telegram may come before it
                    answer = peer.recv(8192)
                    found = 1e-3 * (time.perf_counter_ns() - begun)
                    controller.answer(answer)
            except OSError:  # it starts, or the telegram is lost
                if not took:
                    if time.monotonic() > deadline_s:
                        raise
                    continue
                found = math.inf
            took.append(found)
    return took[WARM:]


@contextlib.contextmanager
def _priority() -> Iterator[None]:
    """Give this process, which simulates the controller, a higher priority than its client. Its children keep
    their own priority.
    """
    os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
    try:
        yield
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
