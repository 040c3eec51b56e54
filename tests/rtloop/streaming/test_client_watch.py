"""Whether a client still lives. Oracle: a real child process, which is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from rtloop.results import ACCEPTED, Rejected
from rtloop.streaming.client_watch import ClientWatch

LIMIT_S = 60.0


@pytest.fixture
def child() -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    yield process
    process.kill()
    process.wait()


def gone_in_time(watch: ClientWatch) -> bool:
    begun_s = time.monotonic()
    while not watch.gone() and time.monotonic() - begun_s < LIMIT_S:
        time.sleep(0.001)
    return watch.gone()


def descriptors() -> int:
    return len(os.listdir("/proc/self/fd"))


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_a_client_that_is_killed_is_gone_although_nobody_has_waited_for_it(
    child: subprocess.Popen[bytes], how: signal.Signals
) -> None:
    watch, before = ClientWatch(), descriptors()
    assert watch.begin(child.pid) == ACCEPTED
    assert not any(watch.gone() for _ in range(1000))
    child.send_signal(how)
    assert gone_in_time(watch)
    child.wait()
    assert watch.gone()
    watch.end()
    assert descriptors() == before


def test_a_client_that_is_stopped_still_lives(child: subprocess.Popen[bytes]) -> None:
    watch = ClientWatch()
    assert watch.begin(child.pid) == ACCEPTED
    child.send_signal(signal.SIGSTOP)
    time.sleep(0.05)
    assert not watch.gone()
    watch.end()


def test_one_client_after_the_other_is_watched(child: subprocess.Popen[bytes]) -> None:
    watch, before = ClientWatch(), descriptors()
    with subprocess.Popen([sys.executable, "-c", ""]) as other:
        assert watch.begin(other.pid) == ACCEPTED
        assert gone_in_time(watch)
    watch.end()
    assert watch.begin(child.pid) == ACCEPTED
    assert not watch.gone()
    watch.end()
    watch.end()
    assert descriptors() == before


def test_a_process_that_there_is_none_of_cannot_be_watched(child: subprocess.Popen[bytes]) -> None:
    watch = ClientWatch()
    child.kill()
    child.wait()
    for pid in (child.pid, 0, 2**63):
        result = watch.begin(pid)
        assert isinstance(result, Rejected)
        assert result.reason.startswith(f"the streaming client, process {pid}, cannot be watched: ")
    assert not watch.gone()
    watch.end()
