"""`cobot run` whose arm is behind FANUC's Stream Motion: a simulated controller in a process of its own."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path
from typing import Any

import yaml
from cobot_run import Run
from crx_arm import CRX_RT
from simulator_process import PATIENCE_S, SimulatorProcess

PERIOD_MS = 8


class ControllerProcess(SimulatorProcess):
    """`cobot simulate fanuc` on free ports of this computer.

    Attributes:
        stream_port, rmi_port: UDP and TCP.
    """

    def __init__(
        self, config: Path, *options: str, period_ms: int = PERIOD_MS, patience_s: float = PATIENCE_S
    ) -> None:
        """config: settings of the arm."""
        ports = ("--stream-port", "0", "--rmi-port", "0", "--period", str(period_ms))
        super().__init__("fanuc", "--config", str(config), *ports, *options, patience_s=patience_s)
        found = re.search(r"UDP 127.0.0.1:(\d+), .*TCP 127.0.0.1:(\d+)", self.line)
        assert found is not None, self.line
        self.stream_port, self.rmi_port = map(int, found.groups())


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
