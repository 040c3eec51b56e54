"""What systemd is told. Oracle: a datagram socket, as sd_notify(3) describes it."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from cobot.launch.supervisor.systemd import Systemd


@pytest.fixture
def manager(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "notify"))
        listener.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        yield listener


def heard(manager: socket.socket) -> list[str]:
    messages = []
    while True:
        try:
            messages.append(manager.recv(4096).decode())
        except BlockingIOError:
            return messages


def test_ready_is_told_once_even_if_nobody_listened_at_first(manager: socket.socket) -> None:
    systemd = Systemd()
    while systemd._tell("WATCHDOG=1"):  # until its queue is full
        pass
    systemd.report_ready("http://localhost:8007")
    heard(manager)
    for _ in range(3):
        systemd.report_ready("http://localhost:8007")
    systemd.report_stopping()
    assert heard(manager) == ["READY=1\nSTATUS=http://localhost:8007", "STOPPING=1"]


def test_signs_of_life_come_at_least_twice_as_often_as_they_are_waited_for(
    manager: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WATCHDOG_USEC", "1000000")
    now_s = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    systemd = Systemd()
    told = 0
    for _ in range(100):
        systemd.send_heartbeat()
        told += len(heard(manager))
        now_s += 0.1
    assert 20 <= told <= 34


@pytest.mark.parametrize(
    "environment",
    [{}, {"WATCHDOG_USEC": "1000000", "WATCHDOG_PID": str(os.getpid() + 1)}, {"WATCHDOG_USEC": "soon"}],
)
def test_who_is_not_watched_says_nothing(
    manager: socket.socket, monkeypatch: pytest.MonkeyPatch, environment: dict[str, str]
) -> None:
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    Systemd().send_heartbeat()
    assert heard(manager) == []


def test_children_do_not_inherit_the_address(manager: socket.socket) -> None:
    Systemd()
    assert "NOTIFY_SOCKET" not in os.environ


def test_without_systemd_everything_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    systemd = Systemd()
    systemd.report_ready("")
    systemd.send_heartbeat()
    systemd.report_stopping()


def test_a_manager_that_has_gone_stops_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "gone"))
    systemd = Systemd()
    systemd.report_ready("")
    systemd.report_stopping()
