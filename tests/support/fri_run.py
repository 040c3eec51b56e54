"""`cobot run` whose arm is behind KUKA's FRI: a simulated cabinet in a process of its own."""

from __future__ import annotations

import socket
import subprocess
from pathlib import Path
from typing import Any

import yaml
from cobot_run import Run
from simulator_process import PATIENCE_S, SimulatorProcess

PERIOD_MS = 5


def free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


class CabinetProcess(SimulatorProcess):
    """`cobot simulate fri` for a client on this computer.

    Attributes:
        port: where the client listens.
    """

    device = "fri"

    def __init__(
        self,
        *options: str,
        period_ms: int | None = PERIOD_MS,
        patience_s: float = PATIENCE_S,
        port: int | None = None,
    ) -> None:
        """
        Args:
            period_ms: None for what it is by itself.
            port: where the client listens; None for a free one.
        """
        self.port = port or free_udp_port()
        period = ("--period", str(period_ms)) if period_ms is not None else ()
        client = ("--client", f"127.0.0.1:{self.port}")
        super().__init__(self.device, *client, *period, *options, patience_s=patience_s)


class RunOverFri(Run):
    """The shipped iiwa with another backend: one changed line, the period that goes with it, and patience."""

    def __init__(
        self, folder: Path, cabinet: CabinetProcess, *, period_ms: int = PERIOD_MS, **options: Any
    ) -> None:
        """options: of the backend."""
        self._period_s = period_ms * 1e-3
        self._backend = {
            "type": "fri",
            "port": cabinet.port,
            "silence_s": 30.0,
            "enable_s": 5.0,
            **options,
        }
        super().__init__(folder, clock="realtime")

    def start(self) -> subprocess.Popen[str]:
        settings = yaml.safe_load(self.config.read_text())
        settings["robot"]["backend"] = self._backend
        settings["rt"]["period_s"] = self._period_s
        self.config.write_text(yaml.safe_dump(settings))
        return super().start()
