"""The memory of each process over an hour of ordinary work: motions, jobs, plans, refusals, who listens to
events, panels that come and go, agents, recordings.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import Any

import httpx
import numpy as np
import psutil
from mcp.client.client import Client as AgentClient
from mcp.client.streamable_http import streamable_http_client
from running import Run
from websockets.sync.client import connect

from benchmarks.service import service
from benchmarks.table import Row, row
from cobot.client import Client
from cobot.errors import CobotError

LOOK_S = 10.0
LEFT_OUT = 1.0 / 6.0
"""Of the time, at first: caches fill and the ring of the recorder is written for the first time."""
HOUR_S = 3600.0
STATES_HZ = 25.0
SESSION_S = 60.0
"""So long a panel and a listener stay before they come again."""
AGENT_PAUSE_S, OPERATOR_PAUSE_S = 1.0, 0.2
BEGAN, ENDED = "10 minutes on", "at the end"


def steady(duration_s: float) -> Iterator[Row]:
    """One row for each process, with what its memory grows by in an hour.

    Args:
        duration_s: in all; its first sixth does not count.
    """
    with service() as run, contextlib.ExitStack() as working:
        counts: dict[str, int] = defaultdict(int)
        for work in (_operator, _panel, _listener, _agent, _recordings):
            working.enter_context(_again(work, run.url, counts))
        sizes = _sizes(run, duration_s)
        done = ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))
    for name, seen in sizes.items():
        times_s, bytes_ = np.array(seen).T
        late = times_s >= LEFT_OUT * duration_s
        if late.sum() < 2:
            continue
        slope = np.polyfit(times_s[late], bytes_[late], 1)[0]
        third = max(int(late.sum()) // 3, 1)
        first, last = np.median(bytes_[late][:third]), np.median(bytes_[late][-third:])
        yield row(
            f"resident memory of {name} over {duration_s / 60:.0f} min of {done}",
            "MB",
            (last / 1e6, slope * HOUR_S / 1e6),
            "the first third",
            (first / 1e6, 0.0),
            columns=("the last third", "growth in an hour"),
            aim="flat",
        )


def _sizes(run: Run, duration_s: float) -> dict[str, list[tuple[float, float]]]:
    """When and how much, for each process of the run, by what it is and its number."""
    sizes: dict[str, list[tuple[float, float]]] = defaultdict(list)
    root = psutil.Process(run.process.pid)
    begun_s = time.monotonic()
    while (now_s := time.monotonic() - begun_s) < duration_s:
        for each in (root, *root.children(recursive=True)):
            with contextlib.suppress(psutil.Error):
                found = each.memory_full_info()
                name = f"{_name(each)} ({each.pid})"
                sizes[name].append((now_s, float(found.rss)))
                print(f"{now_s:.0f} {name} {found.rss} {found.uss} {each.num_fds()} {each.num_threads()}",
                      file=sys.stderr, flush=True)
        time.sleep(LOOK_S)
    return sizes


def _name(process: psutil.Process) -> str:
    words = process.cmdline()
    return next((word for word in words[words.index("-m") + 1 :]), "cobot") if "-m" in words else process.name()


@contextlib.contextmanager
def _again(work: Callable[[str, dict[str, int]], None], url: str, counts: dict[str, int]) -> Iterator[None]:
    """The work, again and again in a thread of its own, until the context ends."""
    ended = threading.Event()

    def go() -> None:
        while not ended.is_set():
            try:
                work(url, counts)
            except (CobotError, httpx.HTTPError, OSError) as exc:
                print(work.__name__, repr(exc), file=sys.stderr, flush=True)
                time.sleep(1.0)
            except Exception as exc:
                print(work.__name__, "!!", repr(exc), file=sys.stderr, flush=True)
                time.sleep(1.0)

    thread = threading.Thread(target=go, daemon=True)
    thread.start()
    yield
    ended.set()


def _operator(url: str, counts: dict[str, int]) -> None:
    """Motions that are waited for, as jobs, and those that are refused; plans; reads."""
    with Client(url, motion_timeout_s=60.0) as robot, httpx.Client(base_url=url, timeout=60.0) as web:
        robot.move_named("work", speed=1.0)
        job = web.post(
            "/robot/move/named", params={"wait": "false"}, json={"name": "home", "speed": 1.0}
        ).json()
        while web.get(f"/jobs/{job['id']}").json()["state"] not in ("finished", "failed", "cancelled"):
            time.sleep(OPERATOR_PAUSE_S)
        number = counts["motions"]
        job = web.post("/robot/move/named", params={"wait": "false"}, json={"name": "work", "speed": 0.3}).json()
        time.sleep(0.5)
        web.post("/robot/move/named", json={"name": "home"})  # refused
        web.post(f"/jobs/{job['id']}/cancel")
        web.post("/robot/plan/named", json={"name": "home", "speed": 0.5 + 0.4 * (number % 100) / 100})
        web.post("/robot/move/joints", json={"joints": [9.0] * 7})
        web.post("/robot/move/named", json={"name": f"nowhere-{number}"})
        for path in ("/robot/joint_states", "/health", "/jobs", "/metrics", "/log", f"/nothing/{number}"):
            web.get(path)
        counts["motions"] += 3
        counts["refused requests"] += 3


def _panel(url: str, counts: dict[str, int]) -> None:
    """What a page of the panel reads."""
    with httpx.Client(base_url=url, timeout=60.0) as web:
        for path in ("/", "/panel/main.js", "/robots", "/robot/scene", "/robot/geometry", "/audit"):
            web.get(path)
    with connect(f"{url.replace('http', 'ws')}/robot/stream") as socket:
        socket.send(json.dumps({"type": "subscribe", "rate_hz": STATES_HZ}))
        end_s = time.monotonic() + SESSION_S
        while time.monotonic() < end_s:
            socket.recv(timeout=10.0)
            counts["states"] += 1


def _listener(url: str, counts: dict[str, int]) -> None:
    end_s = time.monotonic() + SESSION_S
    with Client(url) as robot:
        for _ in robot.events(state_hz=10.0):
            counts["events"] += 1
            if time.monotonic() > end_s:
                return


def _agent(url: str, counts: dict[str, int]) -> None:
    """An agent that looks and plans; to execute is not permitted."""
    asyncio.run(_asked(url, counts))


async def _asked(url: str, counts: dict[str, int]) -> None:
    async with AgentClient(streamable_http_client(f"{url}/mcp/mcp")) as agent:
        for number in itertools.count():
            if number == 30:
                return
            planned = await agent.call_tool("plan_to_position", {"name": ("home", "work")[number % 2]})
            calls: list[tuple[str, dict[str, Any]]] = [
                ("get_state", {}), ("list_positions", {}), ("why_did_it_stop", {}), ("get_log", {})]
            if not planned.is_error:
                plan = json.loads(planned.content[0].text).get("plan_id")  # type: ignore[union-attr]
                calls += [("preview", {"plan_id": plan}), ("execute", {"plan_id": plan})]
            for tool, arguments in calls:
                await agent.call_tool(tool, arguments)
            counts["MCP calls"] += 1 + len(calls)
            await asyncio.sleep(AGENT_PAUSE_S)


def _recordings(url: str, counts: dict[str, int]) -> None:
    """The ring runs all the time; now and then somebody wants it as a file."""
    with Client(url, timeout_s=120.0) as robot:
        time.sleep(SESSION_S)
        robot.record("dump")
        counts["recordings"] += 1
