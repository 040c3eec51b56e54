"""`cobot run` whose arm is behind RTDE: a simulated controller in a process of its own."""

from __future__ import annotations

import itertools
import json
import os
import re
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any, Self

import yaml
from cobot_run import HELPER_ENVIRONMENT, WAIT_S, Run

PATIENCE_S = 30.0
"""Time for which the controller stands still for a late command: a busy computer is none of its faults."""
PERIOD_MS = 8
_numbers = itertools.count(1)


def own_address() -> str:
    """A loopback address of this computer that no other test uses: the ports of a controller are fixed."""
    pid = os.getpid()
    return f"127.{20 + pid % 200}.{pid // 200 % 250}.{next(_numbers)}"


class ControllerProcess:
    """`cobot simulate ur` on a loopback address of its own.

    Attributes:
        address: of the controller.
    """

    def __init__(self, config: Path, *options: str, patience_s: float = PATIENCE_S) -> None:
        """config: settings of the arm."""
        self.address = own_address()
        command = [sys.executable, "-m", "cobot", "simulate", "ur", "--config", str(config)]
        command += ["--address", self.address, "--patience", str(patience_s), *options]
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


class RunOverUr(Run):
    """The arm of a folder of `cobot new-robot` with the backend `ur`: one changed line, and patience."""

    def __init__(
        self, folder: Path, arm: Path, address: str, *, period_ms: int = PERIOD_MS, **options: Any
    ) -> None:
        """arm: the settings file of that folder; options: of the backend."""
        self._arm, self._period_s = arm, period_ms * 1e-3
        self._backend = {"type": "ur", "address": address, "port": 0, "silence_s": 30.0, **options}
        super().__init__(folder, clock="realtime")

    def start(self) -> subprocess.Popen[str]:
        settings = yaml.safe_load(self.config.read_text())
        arm = yaml.safe_load(self._arm.read_text())
        robot = {**arm["robot"], **settings["robot"], "backend": self._backend}
        for name in ("model", "srdf"):
            robot[name] = str(self._arm.parent / arm["robot"][name])
        settings["robot"] = robot
        settings["rt"]["period_s"] = self._period_s
        settings["web"]["joint_limits"] = str(self._arm.parent / arm["web"]["joint_limits"])
        settings["planning"]["default_frame"] = arm["planning"]["default_frame"]
        self.config.write_text(yaml.safe_dump(settings))
        return super().start()
