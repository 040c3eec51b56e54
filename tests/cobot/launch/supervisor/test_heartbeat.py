"""A process that hangs. Oracle: the clock, the operating system's account of who lives, and what it logs."""

from __future__ import annotations

import logging
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

import pytest
from cobot_run import WAIT_S

from cobot.launch.process import is_traced
from cobot.launch.supervisor import heartbeat
from cobot.launch.supervisor.heartbeat import LAST_WORDS_S, HeartbeatWatch

HANGING = "import faulthandler; faulthandler.enable(2)\nwhile True: print(flush=True)"


class Process:
    """One that lives, and notes which signals it got."""

    pid = 4711

    def __init__(self) -> None:
        self.signals: list[int] = []

    def poll(self) -> None: ...

    def send_signal(self, number: int) -> None:
        self.signals.append(number)

    def kill(self) -> None:
        self.signals.append(signal.SIGKILL)


class Bench:
    """A watch with a clock of its own, of which no second goes by in truth."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, timeout_s: float | None = 10.0) -> None:
        self.now_s, self.beats, self.traced = 1000.0, 7, False
        self.process: Any = Process()
        monkeypatch.setattr(time, "monotonic", lambda: self.now_s)
        monkeypatch.setattr(heartbeat, "is_traced", lambda pid: self.traced)
        self.watch = HeartbeatWatch("service", lambda: self.beats, timeout_s)

    def go_on(self, seconds: float, *, beating: bool = False, step_s: float = 0.1) -> list[int]:
        """Look on for so long; the signals that the process has got until then."""
        for _ in range(round(seconds / step_s)):
            self.beats += beating
            self.watch.look(self.process)
            self.now_s += step_s
        return self.process.signals  # type: ignore[no-any-return]


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(monkeypatch)


def test_who_does_not_beat_for_the_stated_time_is_ended_and_no_sooner(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    assert not bench.go_on(60.0, beating=True)
    assert not bench.go_on(9.8)
    with caplog.at_level(logging.ERROR, "cobot"):
        assert bench.go_on(0.5) == [signal.SIGABRT]
    assert "service (pid 4711) hangs: no heartbeat for 10 s; it is ended" in caplog.text
    assert bench.go_on(LAST_WORDS_S + 0.1)[:2] == [signal.SIGABRT, signal.SIGKILL]


def test_who_beats_again_in_time_is_left_alone(bench: Bench) -> None:
    bench.go_on(1.0, beating=True)
    for _ in range(5):
        bench.go_on(9.0)
        assert not bench.go_on(0.1, beating=True)


def test_who_has_not_begun_is_left_alone_and_its_successor_too(bench: Bench) -> None:
    assert not bench.go_on(100.0)
    bench.go_on(1.0, beating=True)
    bench.process = Process()
    assert not bench.go_on(100.0)
    bench.go_on(1.0, beating=True)
    assert bench.go_on(10.5) == [signal.SIGABRT]


def test_a_time_in_which_nobody_ran_does_not_count(bench: Bench) -> None:
    """As on a virtual machine that its host keeps waiting, or after `docker pause`."""
    bench.go_on(1.0, beating=True)
    for _ in range(5):
        bench.now_s += 3600.0
        assert not bench.go_on(0.5)
    assert bench.go_on(10.0)[:1] == [signal.SIGABRT]


def test_who_is_in_the_hand_of_a_debugger_is_left_alone_until_it_has_been_let_go(bench: Bench) -> None:
    bench.go_on(1.0, beating=True)
    bench.traced = True
    assert not bench.go_on(100.0)
    bench.traced = False
    assert bench.go_on(11.0)[:1] == [signal.SIGABRT]


def test_null_is_never(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, None)
    bench.go_on(1.0, beating=True)
    assert not bench.go_on(1000.0)


@pytest.fixture
def hanging() -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-c", HANGING]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        yield process
        process.kill()


@pytest.mark.parametrize("stopped", [False, True])
def test_a_true_process_says_where_it_hangs_unless_it_is_stopped(
    hanging: subprocess.Popen[bytes], stopped: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not is_traced(hanging.pid)
    if stopped:
        hanging.send_signal(signal.SIGSTOP)
    bench = Bench(monkeypatch)
    monkeypatch.setattr(heartbeat, "is_traced", is_traced)
    bench.process = hanging
    bench.beats += 1
    bench.watch.look(hanging)
    bench.beats += 1
    for _ in range(110 + 15 * stopped):
        bench.watch.look(hanging)
        bench.now_s += 0.1
    assert hanging.wait(WAIT_S) == -(signal.SIGKILL if stopped else signal.SIGABRT)
    assert hanging.stderr is not None
    assert (b'File "<string>", line 2' in hanging.stderr.read()) is not stopped
