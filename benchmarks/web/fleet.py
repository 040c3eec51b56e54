"""A hub with many cells: its share of a core, the age of states, a stop of all cells, and its recovery after
a kill and after a network failure.

The cells run the fleet's own code and publish at the largest rate. Several of them share a process, to which
the figures of the hub do not belong.
"""

from __future__ import annotations

import contextlib
import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import httpx
import psutil

from benchmarks.table import Row, percentiles, row
from benchmarks.web.fleet_cells import FLEET

PER_PROCESS = 10
WAIT_S = 120.0
CUTS_S = 5.0, 60.0
"""How long the hub is frozen: its cells lose it, as by a cut of the network."""


def fleet(cells: int, seconds: float, stops: int) -> Iterator[Row]:
    """A hub with all cells, next to the same hub with one cell."""
    one = _measured(1, seconds, stops)
    many = _measured(cells, seconds, stops)
    beside = "the same with one cell"
    name = f"hub with {cells} cells at 10 Hz"
    yield row(f"{name}: processor", "% of a core", [many["cpu"]], beside, [one["cpu"]], columns=("mean",))
    yield row(f"{name}: memory", "MB", [many["memory"]], beside, [one["memory"]], columns=("at the end",))
    yield row(f"{name}: state from a cell to a client", "ms", many["ages"], beside, one["ages"])
    yield row(f"{name}: stop to all of them, until all answer", "ms", many["stops"], beside, one["stops"])
    columns = ("until all are there",)
    yield row(f"{name}: killed and started", "s", [many["back"]], beside, [one["back"]], columns=columns)
    for cut_s in CUTS_S:
        key = f"cut {cut_s:g}"
        yield row(f"{name}: frozen for {cut_s:g} s", "s", [many[key]], beside, [one[key]], columns=columns)


def _measured(cells: int, seconds: float, stops: int) -> dict[str, Any]:
    with ExitStack() as stack:
        zenoh_port, port = _free_port(), _free_port()
        hub = _Hub(zenoh_port, port)
        stack.callback(hub.end)
        for first in range(0, cells, PER_PROCESS):
            number = min(PER_PROCESS, cells - first)
            stack.enter_context(_cells(zenoh_port, first, number))
        hub.wait_for(cells)
        time.sleep(2.0)
        process = psutil.Process(hub.process.pid)
        process.cpu_percent()
        ages = _ages(zenoh_port, seconds)
        found: dict[str, Any] = {"cpu": process.cpu_percent(), "ages": percentiles(ages)}
        found["stops"] = percentiles([hub.stop_ms(cells) for _ in range(stops)])
        found["memory"] = process.memory_info().rss / 1e6
        hub.process.send_signal(signal.SIGKILL)
        hub.process.wait()
        begin = time.monotonic()
        hub.start()
        hub.wait_for(cells)
        found["back"] = time.monotonic() - begin
        for cut_s in CUTS_S:
            found[f"cut {cut_s:g}"] = hub.return_s(cells, cut_s)
        return found


class _Hub:
    def __init__(self, zenoh_port: int, port: int) -> None:
        self._options = ["--name", FLEET, "--listen", f"tcp/127.0.0.1:{zenoh_port}", "--port", str(port)]
        self._http = httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=30.0, trust_env=False)
        self.start()

    def start(self) -> None:
        command = [sys.executable, "-P", "-m", "cobot", "fleet", "serve", *self._options]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def end(self) -> None:
        self.process.terminate()
        self.process.wait()
        self._http.close()

    def wait_for(self, cells: int) -> None:
        end_s = time.monotonic() + WAIT_S
        while time.monotonic() < end_s:
            with contextlib.suppress(httpx.TransportError):
                if self._http.get("/health").json()["alive"] == cells:
                    return
            time.sleep(0.05)
        raise TimeoutError(f"{cells} cells are not there after {WAIT_S:g} s")

    def stop_ms(self, cells: int) -> float:
        begin = time.monotonic()
        answer = self._http.post("/stop").json()
        assert answer["at_rest"], answer
        assert len(answer["robots"]) == cells
        return 1e3 * (time.monotonic() - begin)

    def return_s(self, cells: int, cut_s: float) -> float:
        """Freeze the hub for a time. Returns the time that it then takes until all cells are connected."""
        self.process.send_signal(signal.SIGSTOP)
        time.sleep(cut_s)
        self.process.send_signal(signal.SIGCONT)
        begin = time.monotonic()
        time.sleep(0.1)  # it has noticed by then what it has lost
        self.wait_for(cells)
        return time.monotonic() - begin


@contextmanager
def _cells(zenoh_port: int, first: int, number: int) -> Iterator[None]:
    hub = f"tcp/127.0.0.1:{zenoh_port}"
    command = [sys.executable, "-m", "benchmarks.web.fleet_cells", hub, str(first), str(number)]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.terminate()
        process.wait()


def _ages(zenoh_port: int, seconds: float) -> list[float]:
    """The age of each state when a client of the router receives it, ms."""
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([f"tcp/127.0.0.1:{zenoh_port}"]))
    config.insert_json5("scouting/multicast/enabled", "false")
    found: list[float] = []

    def take(sample: zenoh.Sample) -> None:
        now = time.time()
        found.append(1e3 * (now - float(json.loads(bytes(sample.payload))["reason"])))

    with zenoh.open(config) as session:
        session.declare_subscriber(f"cobot/{FLEET}/*/*/state", take)
        time.sleep(seconds)
    return found


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])
