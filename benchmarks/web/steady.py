"""The memory of each process during an hour of ordinary work: motions, jobs, plans, rejections, event
listeners, panels that open and close, agents, and recordings.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import httpx
import numpy as np
import psutil
from cobot_run import Run
from mcp.client.client import Client as AgentClient
from mcp.client.streamable_http import streamable_http_client
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from benchmarks.service import service
from benchmarks.table import Row, row
from cobot.client import Client
from cobot.errors import UnavailableError

LOOK_S = 10.0
LEFT_OUT = 1.0 / 6.0
"""Of the time, at first: caches fill, and the ring of the recorder is written for the first time."""
HOUR_S = 3600.0
STATES_HZ = 25.0
SESSION_S = 60.0
"""So long a panel and a listener stay before they come again, and so long there is between two recordings."""
TASKS = 30
"""So many plans an agent makes before it comes again."""
COLUMNS = ("median of the last third", "growth in an hour")
Counts = Counter[str]


def steady(duration_s: float) -> Iterator[Row]:
    """A row for each process, with the growth of its memory per hour.

    Args:
        duration_s: in all; its first sixth does not count.
    """
    counts: Counts = Counter()
    with service() as run, _working(run.url, counts) as works:
        sizes = _sizes(run, duration_s, works)
    done = ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))
    for name, seen in sizes.items():
        times_s, sizes_mb = np.array([each for each in seen if each[0] >= LEFT_OUT * duration_s]).T
        third = len(sizes_mb) // 3
        growth_mb = np.polyfit(times_s, sizes_mb, 1)[0] * HOUR_S
        yield row(
            f"resident memory of {name}, {duration_s / 60.0:.0f} min of work: {done}",
            "MB",
            (float(np.median(sizes_mb[-third:])), float(growth_mb)),
            "the first third",
            (float(np.median(sizes_mb[:third])), 0.0),
            columns=COLUMNS,
            aim="flat",
        )


def _sizes(run: Run, duration_s: float, works: list[Future[None]]) -> dict[str, list[tuple[float, float]]]:
    """Times, s, and the total memory of each kind of process at these times, MB."""
    sizes: dict[str, list[tuple[float, float]]] = defaultdict(list)
    root = psutil.Process(run.process.pid)
    begun_s = time.monotonic()
    while (now_s := time.monotonic() - begun_s) < duration_s:
        together: Counter[str] = Counter()
        for each in (root, *root.children(recursive=True)):
            with contextlib.suppress(psutil.NoSuchProcess, psutil.ZombieProcess):
                together[_name(each)] += each.memory_info().rss
        for name, size in together.items():
            sizes[name].append((now_s, size / 1e6))
        for work in works:
            if work.done():
                work.result()  # which says why it has ended
        time.sleep(LOOK_S)
    return sizes


def _name(process: psutil.Process) -> str:
    words = process.cmdline()
    return words[words.index("-m") + 1] if "-m" in words else process.name()


@contextlib.contextmanager
def _working(url: str, counts: Counts) -> Iterator[list[Future[None]]]:
    """Context manager during which all kinds of work are repeated at the same time."""
    ended = threading.Event()

    def repeat(work: Callable[[str, Counts], None]) -> None:
        while not ended.is_set():
            work(url, counts)

    works = (_operator, _panel, _listener, _agent, _recordings)
    with ThreadPoolExecutor(len(works)) as threads:
        try:
            yield [threads.submit(repeat, work) for work in works]
        finally:
            ended.set()


def _operator(url: str, counts: Counts) -> None:
    """Motions that are awaited, run as jobs, and cancelled; rejected motions; plans; reads."""
    with (
        Client(url, motion_timeout_s=60.0) as robot,
        httpx.Client(base_url=url, timeout=60.0) as web,
        contextlib.suppress(UnavailableError),  # so much load that the service stood still
    ):
        robot.move_named("work", speed=1.0)
        job = robot.move_named("home", speed=1.0, wait=False)
        job.wait()
        job = robot.move_named("work", speed=0.3, wait=False)
        number = counts["motions"]
        for path, body in (
            ("/robot/move/named", {"name": "home"}),
            ("/robot/move/joints", {"joints": [9.0] * 7}),
            ("/robot/move/named", {"name": f"nowhere-{number}"}),
        ):
            assert web.post(path, json=body).status_code in (409, 422, 503)
            counts["refusals"] += 1
        job.cancel()
        web.post("/robot/plan/named", json={"name": "home", "speed": 0.5 + 0.4 * (number % 100) / 100.0})
        for path in ("/robot/joint_states", "/health", "/jobs", "/metrics", f"/nothing/{number}"):
            web.get(path)
        counts["motions"] += 3


def _panel(url: str, counts: Counts) -> None:
    """The reads of a panel page, and its states."""
    with httpx.Client(base_url=url, timeout=60.0) as web:
        for path in ("/", "/panel/main.js", "/robots", "/scene", "/robot/geometry", "/jobs", "/recordings"):
            web.get(path).raise_for_status()
    busy = contextlib.suppress(ConnectionClosed)  # so much load that it takes the connection for lost
    with busy, connect(f"{url.replace('http', 'ws')}/robot/stream") as socket:
        socket.send(json.dumps({"type": "subscribe", "rate_hz": STATES_HZ}))
        end_s = time.monotonic() + SESSION_S
        while time.monotonic() < end_s:
            socket.recv(timeout=SESSION_S)
            counts["states"] += 1


def _listener(url: str, counts: Counts) -> None:
    end_s = time.monotonic() + SESSION_S
    with Client(url) as robot:
        for _ in robot.events(state_hz=10.0):
            counts["events"] += 1
            if time.monotonic() > end_s:
                return


def _agent(url: str, counts: Counts) -> None:
    """An agent that reads, plans, and tries to execute its plans, which it is not permitted to do."""
    asyncio.run(_asked(url, counts))


async def _asked(url: str, counts: Counts) -> None:
    async with AgentClient(streamable_http_client(f"{url}/mcp/mcp")) as agent:
        for number in range(TASKS):
            planned = await agent.call_tool("plan_to_position", {"name": ("home", "work")[number % 2]})
            calls: list[tuple[str, dict[str, Any]]] = [
                (tool, {}) for tool in ("get_state", "list_positions", "why_did_it_stop", "get_log")
            ]
            if not planned.is_error:
                plan = json.loads(planned.content[0].text)["plan_id"]  # type: ignore[union-attr]
                calls += [("preview", {"plan_id": plan}), ("execute", {"plan_id": plan})]
            for tool, arguments in calls:
                await agent.call_tool(tool, arguments)
            counts["calls of MCP"] += 1 + len(calls)
            await asyncio.sleep(1.0)


def _recordings(url: str, counts: Counts) -> None:
    """The ring buffer always records. From time to time a client requests it as a file."""
    with Client(url, motion_timeout_s=120.0) as robot:
        time.sleep(SESSION_S)
        robot.record("dump")
        counts["recordings"] += 1
