"""The time until a gripper's device has a command, and the cost of a cycle while arm and gripper work.

A command is measured from the request over HTTP until the device takes it.
What comes then is the device's own time: the fingers of both simulated grippers begin to move, or to brake,
at once. For the simulated hand, the device is the plant behind rtloop; for Robotiq's gripper, a simulated
one on a pseudo terminal, through the driver's serial line.
"""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from cobot_run import Run, until
from folders import ROOT

from benchmarks.loop.cycle import WARM_UP_S, Moving
from benchmarks.service import background, from_histogram, histograms, reader
from benchmarks.table import EACH, Row, percentiles, row
from benchmarks.web.answers import address
from cobot.cell.cell import HAND
from cobot.client import Client
from cobot.client.connection import Connection
from cobot.grippers.robotiq.registers import Request
from cobot.grippers.robotiq.simulator import run_simulator
from cobot.ipc.io_record import report_of
from cobot.ipc.layout import HISTOGRAM_BUCKETS, Phase
from cobot.ipc.shm import RobotMemory

CELL = ROOT / "examples" / "pick_and_place" / "cell.yaml"
SIMULATED_HAND = f"mujoco, cell: {CELL}, gripper: {{type: simulated}}"
WORK = {
    "actions": [
        {"at": {"fraction": 0.2}, "set": {"output": "lamp", "value": True}},
        {"at": {"fraction": 0.4}, "gripper": {"command": "move", "width": 0.03}},
        {"at": {"fraction": 0.6}, "gripper": {"command": "release"}},
        {"at": {"fraction": 0.8}, "set": {"output": "lamp", "value": False}},
    ],
    "start_when": {"input": "gate.count", "below": 1000.0},
    "pause_while": {"input": "gate", "is": True},
    "until": {"force": {"threshold": 100.0}, "if_not_met": "success"},
}
"""What each motion does besides."""
WIDTHS_M = (0.01, 0.07)
SPEED_M_S = 0.03
"""So slow that the fingers still move when they are stopped."""
UNDER_WAY_S = (0.15, 0.25)
POLL_S = 2e-4
MAX_WAIT_S = 2.0
AIM_MS = 20.0

Told = Callable[[], object]
"""Returns what the device was told last; a command changes it."""


def gripper(commands: int) -> Iterator[Row]:
    """Moves and stops of both grippers, and the round trips of a bare service next to them."""
    with tempfile.TemporaryDirectory() as folder, background("benchmarks.web.bare") as bare:
        with Connection(address(bare)) as peer:
            floor = percentiles([_round_trip_ms(peer) for _ in range(10 * commands)])
        for name, measured in (
            ("simulated hand", _of_hand(Path(folder), commands)),
            ("Robotiq 2F-85 on a serial line", _of_robotiq(Path(folder), commands)),
        ):
            for what, found in measured.items():
                yield row(
                    f"{name}: {what}, until the device has it",
                    "ms",
                    percentiles(found),
                    "round trip to a bare FastAPI route",
                    floor,
                    aim=f"p99 ≤ {AIM_MS:g} ms",
                )


def cycle(slices: int, slice_s: float) -> Iterator[Row]:
    """Compute time of a cycle while the arm works: outputs and gripper commands on the path, and three
    conditions, in slices that alternate with bare motions of the same simulation with a hand and parts.
    """
    phases = (Phase.UPDATE, Phase.TOTAL)
    working, plain = (np.zeros((len(Phase), HISTOGRAM_BUCKETS), np.int64) for _ in range(2))
    with tempfile.TemporaryDirectory() as folder:
        run = Run(Path(folder), "realtime", backend=SIMULATED_HAND)
        try:
            run.until(run.healthy)
            memory = reader(run)
            for _ in range(slices):
                for counts, how in ((working, WORK), (plain, {})):
                    with Moving(run, **how):
                        time.sleep(WARM_UP_S)
                        before = histograms(memory)
                        time.sleep(slice_s)
                        counts += histograms(memory) - before
        finally:
            run.end()
    for phase in phases:
        yield row(
            f"{phase.name.lower()} of a cycle with actions and conditions, hand and parts",
            "µs",
            from_histogram(working[phase]),
            "the same simulation in a bare motion",
            from_histogram(plain[phase]),
            ratio_of=EACH,
            aim="p50 ≤ 1.2" if phase is Phase.TOTAL else "",
        )


def _of_hand(folder: Path, commands: int) -> dict[str, list[float]]:
    run = Run(folder, "realtime", backend=SIMULATED_HAND)
    try:
        run.until(run.healthy)
        memory = reader(run)
        return _measured(run, lambda: _width_output(memory), commands)
    finally:
        run.end()


def _width_output(memory: RobotMemory) -> float:
    """The width that the plant has received, m."""
    while not memory.io.try_read():
        time.sleep(POLL_S)
    return next(each.value for each in report_of(memory.io.data).points if each.name == f"{HAND}.width")


def _of_robotiq(folder: Path, commands: int) -> dict[str, list[float]]:
    with run_simulator() as simulator:
        fingers, requests = simulator.slave.fingers, [Request(False, False)]
        fingers.activation_s = 0.1
        take = fingers.take

        def take_and_note(request: Request) -> None:
            take(request)
            requests[0] = request

        fingers.take = take_and_note  # type: ignore[method-assign]
        run = Run(
            folder, "realtime", backend=f"mujoco, gripper: {{type: robotiq, device: {simulator.device}}}"
        )
        try:
            run.until(run.health)
            with Client(run.url) as client:
                run.until(lambda: client.gripper.state()["connected"])
                client.gripper.home()
            return _measured(run, lambda: requests[0], commands)
        finally:
            run.end()


def _measured(run: Run, told: Told, commands: int) -> dict[str, list[float]]:
    random = np.random.default_rng(28)
    found: dict[str, list[float]] = {"move": [], "stop": []}
    with Client(run.url) as client:
        until(lambda: client.gripper.state()["connected"])
        for number in range(commands):
            width = WIDTHS_M[number % 2]
            client.gripper.move(0.5 * sum(WIDTHS_M), 0.1)
            found["move"].append(_delay_ms(told, partial(client.gripper.move, width, SPEED_M_S, wait=False)))
            time.sleep(random.uniform(*UNDER_WAY_S))
            found["stop"].append(_delay_ms(told, client.gripper.stop))
    return found


def _delay_ms(told: Told, command: Callable[[], object]) -> float:
    """Time from the beginning of a command until the device has it, ms. The command is answered later."""
    before = told()
    begin_s = time.monotonic()
    sent = threading.Thread(target=command)
    sent.start()
    while told() == before:
        if time.monotonic() - begin_s > MAX_WAIT_S:
            raise AssertionError(f"the device has got no command within {MAX_WAIT_S:g} s")
        time.sleep(POLL_S)
    took_s = time.monotonic() - begin_s
    sent.join()
    return 1e3 * took_s


def _round_trip_ms(peer: Connection) -> float:
    begin_s = time.monotonic()
    peer._json("POST", "/stop")
    return 1e3 * (time.monotonic() - begin_s)
