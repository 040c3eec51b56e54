"""`cobot run` whose arm is behind FANUC's Stream Motion: a simulated controller in a process of its own."""

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
from crx_arm import CRX_RT

PATIENCE_S = 30.0
"""Time for which the controller stands still for a late answer: a busy computer is none of its faults."""
PERIOD_MS = 8


class ControllerProcess:
    """`cobot simulate fanuc` on free ports of this computer.

    Attributes:
        stream_port, rmi_port: UDP and TCP.
    """

    def __init__(
        self, config: Path, *options: str, period_ms: int = PERIOD_MS, patience_s: float = PATIENCE_S
    ) -> None:
        """config: settings of the arm."""
        command = [sys.executable, "-m", "cobot", "simulate", "fanuc", "--config", str(config)]
        command += ["--stream-port", "0", "--rmi-port", "0", "--period", str(period_ms)]
        command += ["--patience", str(patience_s), *options]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=HELPER_ENVIRONMENT
        )
        assert self.process.stdout is not None
        self.line = self.process.stdout.readline()
        found = re.search(
            r"UDP 127.0.0.1:(\d+), .*TCP 127.0.0.1:(\d+), control on 127.0.0.1:(\d+)", self.line
        )
        if found is None:
            raise AssertionError(self.line + self.process.communicate(timeout=WAIT_S)[1])
        self.stream_port, self.rmi_port, control = map(int, found.groups())
        self._control = socket.create_connection(("127.0.0.1", control), WAIT_S)
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


class RunOverFanuc(Run):
    """The arm of a folder of `cobot new-robot` with the backend `fanuc`: one changed line, and patience."""

    def __init__(
        self,
        folder: Path,
        arm: Path,
        stream_port: int,
        rmi_port: int,
        *,
        period_ms: int = PERIOD_MS,
        **options: Any,
    ) -> None:
        """arm: the settings file of that folder; options: of the backend."""
        self._arm, self._period_s = arm, period_ms * 1e-3
        self._backend = {
            "type": "fanuc",
            "address": "127.0.0.1",
            "stream_port": stream_port,
            "rmi_port": rmi_port,
            "silence_s": 30.0,
            **options,
        }
        super().__init__(folder, clock="realtime")

    def start(self) -> subprocess.Popen[str]:
        settings = yaml.safe_load(self.config.read_text())
        arm = yaml.safe_load(self._arm.read_text())
        robot = {**arm["robot"], **settings["robot"], "backend": self._backend}
        for name in ("model", "srdf"):
            robot[name] = str(self._arm.parent / arm["robot"][name])
        settings["robot"] = robot
        settings["rt"] |= {"period_s": self._period_s, **CRX_RT}
        settings["web"]["joint_limits"] = str(self._arm.parent / arm["web"]["joint_limits"])
        settings["planning"]["default_frame"] = arm["planning"]["default_frame"]
        self.config.write_text(yaml.safe_dump(settings))
        return super().start()
