"""Events over a network: clients of several kinds at a running service, stuck ones among them.

Oracles: `websockets` and plain sockets as clients; psutil for the memory.
"""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from urllib.parse import urlsplit

import httpx
import psutil
import pytest
from cobot_run import WAIT_S, Run
from websockets.sync.client import connect

from cobot.client import Client

STUCK = 100
"""Of each of two kinds."""
MAX_GROWTH = 60 * 2**20
"""100 WebSockets cost 20 MB as such; what piled up for them would be a hundred times that."""


def listeners(run: Run) -> int:
    text = httpx.get(f"{run.url}/metrics", timeout=WAIT_S).text
    return int(float(text.partition("\ncobot_events_listeners ")[2].split("\n")[0]))


def service_bytes(run: Run) -> int:
    process = run.child("app")
    assert process is not None
    return int(process.memory_info().rss)


@contextmanager
def stuck(url: str, path: str, upgrade: bool) -> Iterator[socket.socket]:
    """A connection that asks for all there is and never reads."""
    where = urlsplit(url)
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.connect((where.hostname, where.port))
        more = (
            "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n"
        )
        connection.sendall(
            f"GET {path} HTTP/1.1\r\nHost: {where.netloc}\r\n{more if upgrade else ''}\r\n".encode()
        )
        yield connection


def test_a_client_in_python_and_a_websocket_hear_the_same(shared: Run) -> None:
    shared.go_home()
    url = f"ws{shared.url.removeprefix('http')}/events?types=motion"
    with Client(shared.url) as client, connect(url, proxy=None) as websocket:
        assert json.loads(websocket.recv(WAIT_S))["type"] == "hello"
        events = client.events(["motion"], state_hz=20.0)
        assert next(events)["type"] == "state"
        client.move_named("work", speed=1.0)
        heard = []
        while len(heard) < 2:
            event = next(events)
            heard += [event] if event["type"] == "motion" else []
        assert [each["data"]["what"] for each in heard] == ["begun", "finished"]
        assert [json.loads(websocket.recv(WAIT_S)) for _ in range(2)] == heard
        events.close()
        again = client.events(["motion"], after=f"{heard[0]['epoch']}-{heard[0]['id']}")
        assert next(again) == heard[1]
        again.close()
    shared.until(lambda: listeners(shared) == 0)


def test_a_sequence_is_told_from_its_start_to_its_end(shared: Run) -> None:
    shared.go_home()
    joints = {"joints": [0.1, 0, 0, -1.57, 0, 1.57, 0], "speed": 1.0}
    steps = {"waypoints": [{**joints, "label": "near"}, {"named": "home", "speed": 1.0}]}
    files = {"config": ("two.json", json.dumps(steps), "application/json")}
    with Client(shared.url) as client:
        events = client.events(["sequence"], state_hz=20.0)
        assert next(events)["type"] == "state"  # it listens
        form = {"n_iterations": 2, "delay_between_iterations": 0}
        url = f"{shared.url}/sequences/start"
        assert httpx.post(url, files=files, data=form, timeout=WAIT_S).is_success
        heard: list[dict[str, Any]] = []
        while not heard or heard[-1]["data"]["what"] != "ended":
            event = next(events)
            heard += [event] if event["type"] == "sequence" else []
        events.close()
    started, *waypoints, ended = [each["data"] for each in heard]
    assert (started["what"], started["name"], started["iterations"]) == ("started", "two.json", 2)
    assert [(each["what"], each["iteration"], each["waypoint"]) for each in waypoints] == [
        ("waypoint", iteration, waypoint) for iteration in (1, 2) for waypoint in (1, 2)
    ]
    assert {each["n_waypoints"] for each in waypoints} == {2}
    assert ended["returncode"] == 0
    assert {each["data"]["sequence"] for each in heard} == {started["sequence"]}
    assert {each["robot"] for each in heard} == {shared.name}


@pytest.mark.thorough
def test_clients_that_never_read_cost_little_delay_nobody_and_are_let_go(shared: Run) -> None:
    """Endless states for 200 clients that read nothing: who reads hears all, and a stop comes in."""
    shared.go_home()
    before = service_bytes(shared)
    with ExitStack() as stack, Client(shared.url) as client:
        for number in range(2 * STUCK):
            stack.enter_context(stuck(shared.url, "/events?after=0&state_hz=100", upgrade=number % 2 == 0))
        shared.until(lambda: listeners(shared) > STUCK)
        events = client.events(["stop", "service"], state_hz=20.0)
        assert next(events)["type"] == "state"
        for _ in range(20):
            assert client.stop()["success"]
        heard = 0
        while heard < 20:
            heard += next(events)["type"] == "stop"
        assert service_bytes(shared) - before < MAX_GROWTH
        events.close()
        shared.until(lambda: listeners(shared) == 0)  # though none of them has closed anything


def test_who_listens_does_not_keep_the_service_from_ending(run: Run) -> None:
    """Neither who reads, what comes seldom or often, nor who does not."""
    heard: dict[str, list[str]] = {"/events": [], "/events?state_hz=100": []}

    def listen(path: str) -> None:
        with httpx.stream("GET", f"{run.url}{path}", timeout=WAIT_S) as answer:
            heard[path].extend(answer.iter_lines())

    listening = [threading.Thread(target=listen, args=(path,)) for path in heard]
    for each in listening:
        each.start()
    with stuck(run.url, "/events?state_hz=100", upgrade=False):
        run.until(lambda: listeners(run) == 3)
        assert psutil.pid_exists(run.process.pid)
        run.process.terminate()
        assert run.process.wait(WAIT_S) == 0
        for each in listening:
            each.join(WAIT_S)
            assert not each.is_alive()
    for path, lines in heard.items():
        (last,) = [line for line in lines if line.startswith("data: ") and '"ends"' in line]
        assert json.loads(last.removeprefix("data: "))["type"] == "service", path
    assert "graceful shutdown exceeded" not in run.output
