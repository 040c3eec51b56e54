"""`cobot run` whose arm is behind KUKA's FRI: a simulated cabinet in a process of its own."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any, Self

import yaml
from cobot_run import HELPER_ENVIRONMENT, WAIT_S, Run

PATIENCE_S = 30.0
"""The cabinet stands still for so long for an answer that is late: a busy computer is none of its faults."""
PERIOD_MS = 5


def free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


class CabinetProcess:
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
        client = f"127.0.0.1:{self.port}"
        command = [sys.executable, "-m", "cobot", "simulate", self.device, "--client", client]
        command += ["--patience", str(patience_s), *options]
        command += ["--period", str(period_ms)] if period_ms is not None else []
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=HELPER_ENVIRONMENT
        )
        assert self.process.stdout is not None
        self.line = self.process.stdout.readline()
        found = re.search(r"control on 127.0.0.1:(\d+)", self.line)
        if found is None:
            raise AssertionError(self.line + self.process.communicate(timeout=WAIT_S)[1])
        self._control = socket.create_connection(("127.0.0.1", int(found.group(1))), WAIT_S)
        self._answers = self._control.makefile("r")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def ask(self, **request: Any) -> dict[str, Any]:
        """Have something be so, and get its state."""
        self._control.sendall(json.dumps(request).encode() + b"\n")
        found: dict[str, Any] = json.loads(self._answers.readline())
        assert "error" not in found, found
        return found

    def end(self) -> int:
        self._answers.close()
        self._control.close()
        self.process.terminate()
        code = self.process.wait(WAIT_S)
        for stream in (self.process.stdout, self.process.stderr):
            if stream is not None:
                stream.close()
        return code


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
