"""RSIPI's double of a controller, a packet at a time and on loopback: its own thread, beat and port 50000 are
left out. It reads the Ethernet configuration that cobot writes."""

from __future__ import annotations

import importlib
import os
import socket
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from cobot.config import Settings
from cobot.types import JointLimits
from rtloop.backends.rsi.files import ETHERNET_FILE, files_for


class LoopbackSocket(socket.socket):
    """Any free port of this computer alone, whatever is asked for."""

    def bind(self, address: Any, /) -> None:
        super().bind(("127.0.0.1", 0))


def rsipi(folder: Path) -> ModuleType:
    """The module of the double. It makes a folder for its logs where it is imported."""
    pytest.importorskip("RSIPI", reason="rsipi is not installed: see requirements/peers.lock")
    before = Path.cwd()
    os.chdir(folder)
    try:
        return importlib.import_module("RSIPI.rsi_echo_server")
    finally:
        os.chdir(before)


def made_double(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    settings: Settings,
    limits: JointLimits,
    *,
    mode: str = "absolute",
    timeout: int = 100,
) -> Any:
    """An `EchoServer` that is not started: `send_once` and `receive_and_process` are a cycle."""
    module = rsipi(folder)
    file = folder / ETHERNET_FILE
    file.write_text(files_for(settings, limits)[f"SensorInterface/{ETHERNET_FILE}"])
    names = {name: getattr(socket, name) for name in ("AF_INET", "SOCK_DGRAM", "timeout")}
    # Its clock stands still: an answer that is there in time is not late because this computer is busy.
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: 0.0))
    monkeypatch.setattr(module, "socket", SimpleNamespace(socket=LoopbackSocket, **names))
    return module.EchoServer(str(file), round(1e3 * settings.rt.period_s), mode=mode, timeout_packets=timeout)
