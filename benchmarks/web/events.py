"""Events: the time until a client learns of a change in rtloop, and the effect of many observers on other
clients.
"""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Iterator
from urllib.parse import urlsplit

from benchmarks.service import background, reader, service
from benchmarks.table import EACH, Row, percentiles, row
from benchmarks.web.answers import motion, until_cruising
from cobot import Mode, Robot
from cobot.client import Client
from cobot.ipc.layout import Intervention
from cobot.ipc.shm import RobotMemory
from cobot.launch.process import Niceness, set_niceness
from cobot.types import LoopMode

OBSERVERS, OBSERVED_HZ = 200, 20
CONTROL_HZ = 100
COLUMNS = ("p99 between targets, ms", "longest, ms", "held for want of a target")


def events(repetitions: int, duration_s: float) -> Iterator[Row]:
    """Latency from a change of mode in rtloop to a client of server-sent events; then a controller at 100 Hz,
    with and without 200 observers.
    """
    with service() as run:
        set_niceness(Niceness.PROMPT)  # this client, and the observers, stand for other computers
        yield row(
            "a mode that changes in rtloop to a client of GET /events",
            "ms",
            percentiles(_latencies(run.url, reader(run), repetitions)),
            "half of how often the service looks, and all of it",
            (5.0, 10.0, 10.0),
            ratio_of="p99",
        )
        alone = _controlled(run.url, reader(run), duration_s / 3)
        observers = (run.url, str(OBSERVERS), str(OBSERVED_HZ), str(duration_s + 30.0))
        with background("benchmarks.web.observers", *observers) as crowd:
            assert crowd.stdout is not None
            assert crowd.stdout.readline().strip() == "all there"
            observed = _controlled(run.url, reader(run), duration_s)
            crowd.terminate()
            heard = json.loads(crowd.stdout.readline())
        set_niceness(Niceness.ORDINARY)
    yield row(
        f"a controller at {CONTROL_HZ} Hz beside {OBSERVERS} observers at {OBSERVED_HZ} Hz, "
        f"who hear {heard['hz']:.1f} states a second each",
        "",
        observed,
        "the same without observers",
        alone,
        columns=COLUMNS,
        ratio_of=EACH if all(alone) else COLUMNS[0],
        aim="nothing held",
    )


def _latencies(url: str, memory: RobotMemory, repetitions: int) -> list[float]:
    """Times from the publication of each mode to its event, ms: the beginnings, stops and rests of two
    motions.
    """
    seen: list[tuple[str, int]] = []
    heard: list[tuple[str, int]] = []
    ended = threading.Event()

    def look() -> None:
        mode = int(memory.state.read()["mode"])
        while not ended.wait(2e-4):
            state = memory.state.read()
            if int(state["mode"]) != mode:
                mode = int(state["mode"])
                seen.append((LoopMode(mode).name, int(state["monotonic_ns"])))

    def listen() -> None:
        where = urlsplit(url)
        with socket.create_connection((where.hostname, where.port)) as connection:
            connection.sendall(f"GET /events?types=mode HTTP/1.1\r\nHost: {where.netloc}\r\n\r\n".encode())
            for line in connection.makefile("r", encoding="utf-8"):
                if line.startswith('data: {"id"') and '"type": "mode"' in line:
                    mode = json.loads(line.removeprefix("data: "))["data"]["mode"]
                    heard.append((mode, time.monotonic_ns()))
                if ended.is_set():
                    return

    threads = [threading.Thread(target=each, daemon=True) for each in (look, listen)]
    for each in threads:
        each.start()
    with Client(url, motion_timeout_s=30.0) as mover, Client(url) as stopper:
        for repetition in range(repetitions):
            with motion(mover, ("work", "home")[repetition % 2]):
                until_cruising(memory)
                stopper.stop()
    time.sleep(0.5)
    ended.set()
    assert [mode for mode, _ in seen] == [mode for mode, _ in heard], "none is missed, none comes twice"
    return [(later - now) / 1e6 for (_, now), (_, later) in zip(seen, heard, strict=True)]


def _controlled(url: str, memory: RobotMemory, duration_s: float) -> tuple[float, float, float]:
    """Times between targets as rtloop received them, and the number of times that it held the arm because a
    target was missing.
    """
    gaps: list[float] = []
    ended = threading.Event()

    def look() -> None:
        state = memory.state.read()
        number, since_ns = int(state["setpoint_seen"]), 0
        while not ended.wait(5e-4):
            state = memory.state.read()
            if int(state["setpoint_seen"]) != number:
                now_ns = int(state["monotonic_ns"])
                gaps.extend([(now_ns - since_ns) / 1e6] if since_ns else [])
                number, since_ns = int(state["setpoint_seen"]), now_ns

    def held() -> int:
        return int(memory.state.read()["interventions"][Intervention.COMMAND_TIMEOUT])

    looking = threading.Thread(target=look, daemon=True)
    with Robot(url) as robot:
        robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
        with robot.start_joint_impedance_control(inner_control_hz=CONTROL_HZ) as control:
            home = list(control.get_state().q)
            before = held()
            looking.start()
            begun_s = time.monotonic()
            for tick in range(round(duration_s * CONTROL_HZ)):
                control.set_target_joints([home[0] + 1e-4 * (tick % 100), *home[1:]])
                time.sleep(max(0.0, begun_s + (tick + 1) / CONTROL_HZ - time.monotonic()))
            ended.set()
            looking.join()
            timeouts = held() - before
    _, p99, _ = percentiles(gaps)
    return p99, max(gaps), float(timeouts)
