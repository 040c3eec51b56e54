"""A local streaming client that hangs, on virtual time; it is a real process that is really stopped."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from cobot_run import until
from virtual_time import VirtualLoop

from app.services.streaming.hung_clients import PERIOD_S, watching_clients
from cobot.launch.process import is_stopped

TIMEOUT_S = 10.0


@pytest.fixture
def process() -> Iterator[subprocess.Popen[bytes]]:
    made = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    yield made
    made.kill()
    made.communicate()


def watched(process_of_session: Callable[[], int | None], seconds: float) -> list[float]:
    """When stops were asked for in so much time, s."""
    loop = VirtualLoop()
    begin_s, stops_s = loop.time(), []
    link: Any = SimpleNamespace(
        label="",
        streaming_process=process_of_session,
        request_stop=lambda: stops_s.append(loop.time() - begin_s),
    )

    async def check() -> None:
        async with watching_clients(link, TIMEOUT_S):
            await asyncio.sleep(seconds)

    loop.run_until_complete(check())
    loop.run_until_complete(asyncio.sleep(0))
    loop.close()
    return stops_s


def stop(process: subprocess.Popen[bytes]) -> None:
    process.send_signal(signal.SIGSTOP)
    until(lambda: is_stopped(process.pid))


def test_a_client_that_is_stopped_loses_its_session_after_its_time(process: subprocess.Popen[bytes]) -> None:
    stop(process)
    (stop_s,) = watched(lambda: process.pid, 1.5 * TIMEOUT_S)
    assert TIMEOUT_S <= stop_s <= TIMEOUT_S + PERIOD_S


def test_a_client_that_lives_is_not_looked_after(process: subprocess.Popen[bytes]) -> None:
    assert watched(lambda: process.pid, 100.0 * TIMEOUT_S) == []


@pytest.mark.parametrize("pid", [None, 0, 2**22 + 1])
def test_no_session_and_a_process_that_nobody_knows_are_nothing(pid: int | None) -> None:
    assert watched(lambda: pid, 3.0 * TIMEOUT_S) == []


def test_a_session_that_has_ended_meanwhile_starts_the_time_anew(process: subprocess.Popen[bytes]) -> None:
    stop(process)
    looks = iter(range(1000))
    found = watched(lambda: None if next(looks) % 15 == 14 else process.pid, 3.0 * TIMEOUT_S)
    assert found == []
