"""The memory of a service that has been used, before and after each flood and each attack.

Used: it has had ordinary traffic and all of these once. What is imported, cached and kept for the next time
at the first use would count as growth for ever; that it is no more than that is seen by what the same adds at
its second time, each compared with what there was just before it, and all of them at the end with what there
was before the first. The service has 256 descriptors.
"""

from __future__ import annotations

import json
import random
import time
from collections.abc import Callable, Iterator

import httpx
import psutil
from cobot_run import Run
from floods import FLOODS

from benchmarks.service import service
from benchmarks.table import Row, row
from benchmarks.web.floods import flooding

BACK = 1.1
PAUSE_S = 30.0
"""So long after each memory is looked at, or as soon as it has come back: what has been freed is given back
to the system every 15 s at the latest."""
REQUESTS = 500
TIMEOUT_S = 120.0


def memory(lasts_s: float) -> Iterator[Row]:
    """Run each flood and attack in turn for this time at the same service.

    Args:
        lasts_s: so long a flood goes on, and for so long an attack is repeated.
    """
    with service(narrow=True) as run:
        process = run.child("app")
        assert process is not None
        _ordinary(run)
        for kind in (*FLOODS, *ATTACKS):
            _during(run, process, kind, min(lasts_s, 2.0))
        time.sleep(PAUSE_S)
        before = process.memory_info().rss
        for kind in (*FLOODS, *ATTACKS):
            begun = process.memory_info().rss
            during = _during(run, process, kind, lasts_s)
            calm_s = time.monotonic() + PAUSE_S
            while (after := process.memory_info().rss) > BACK * begun and time.monotonic() < calm_s:
                time.sleep(1.0)
            assert run.child("app") == process, "the service has died"
            yield _row(f"memory of a used service, {kind}", during, after, begun, "just before it")
        _ordinary(run)
        time.sleep(PAUSE_S)
        after = process.memory_info().rss
        yield _row("memory of a used service, at the end", during, after, before, "before them all")


def _row(name: str, during: float, after: float, before: float, when: str) -> Row:
    return row(
        name,
        "MB",
        (during / 1e6, after / 1e6),
        when,
        (before / 1e6, before / 1e6),
        columns=("during", "after"),
        ratio_of="after",
        aim="1.1 or less after",
    )


def _during(run: Run, process: psutil.Process, kind: str, lasts_s: float) -> int:
    """The largest memory use during the call, bytes."""
    most = 0
    if kind in FLOODS:
        with flooding(run.url, kind):  # which has begun then
            end_s = time.monotonic() + lasts_s
            while time.monotonic() < end_s:
                most = max(most, process.memory_info().rss)
                time.sleep(0.05)
        return most
    end_s = time.monotonic() + lasts_s
    with httpx.Client(base_url=run.url, timeout=TIMEOUT_S) as client:
        while not most or time.monotonic() < end_s:
            ATTACKS[kind](client)
            most = max(most, process.memory_info().rss)
    return most


def _ordinary(run: Run) -> None:
    """The requests that clients make all day."""
    with httpx.Client(base_url=run.url, timeout=TIMEOUT_S) as client:
        for name in ("work", "home"):
            client.post("/robot/plan/named", json={"name": name})
            client.post("/robot/move/named", json={"name": name, "speed": 1.0})
        for path in ("/robot/joint_states", "/robot/pose", "/health", "/jobs", "/metrics", "/openapi.json"):
            for _ in range(REQUESTS // 10):
                client.get(path)


def _json(path: str, text: bytes) -> Callable[[httpx.Client], object]:
    return lambda client: client.post(path, content=text, headers={"Content-Type": "application/json"})


def _file(path: str, field: str, name: str, content: bytes) -> Callable[[httpx.Client], object]:
    return lambda client: client.post(path, files={field: (name, content)})


def _names(client: httpx.Client) -> None:
    """Send requests that are rejected, each with a different name."""
    for _ in range(REQUESTS // 10):
        name = f"{random.getrandbits(64):x}"
        client.get(f"/{name}", headers={"Authorization": f"Bearer {name}", "X-Request-Id": name})
        client.get(f"/jobs/{name}")
        client.post("/robot/move/named", json={"name": name})


_POINTS = [{"positions": [0.1] * 7, "time_from_start": 0.01 * n} for n in range(20_000)]
ATTACKS: dict[str, Callable[[httpx.Client], object]] = {
    "deep JSON": _json("/robot/move/joints", b"[" * 1_900_000),
    "a huge array": _json("/robot/move/joints", b'{"joints":[' + b"0," * 900_000 + b"0]}"),
    "a trajectory with a mistake": _json("/trajectory/send", json.dumps({"points": _POINTS}).encode()),
    "a CSV file of line ends": _file("/trajectory/send_csv", "file", "a.csv", b"\n" * 20_000_000),
    "a CSV file with a mistake": _file(
        "/trajectory/send_csv", "file", "a.csv", b"0,0,0,0,0,0,0,0.1\n" * 200_000
    ),
    "a program that is none": _file("/sequences/start", "config", "a.lua", b"x = (" * 200_000),
    "names that are not there": _names,
}
