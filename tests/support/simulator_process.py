"""`cobot simulate` in a process of its own."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import sys
from typing import Any, Self

from cobot_run import HELPER_ENVIRONMENT, WAIT_S

PATIENCE_S = 30.0
"""Time for which a controller stands still for a late answer: a busy computer is none of its faults."""


class SimulatorProcess:
    """A simulated controller and its control interface.

    Attributes:
        line: the first line that it has printed.
    """

    def __init__(self, kind: str, *options: str, patience_s: float = PATIENCE_S) -> None:
        command = [sys.executable, "-m", "cobot", "simulate", kind, "--patience", str(patience_s), *options]
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
        """Set these values of the controller, and return its state."""
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
