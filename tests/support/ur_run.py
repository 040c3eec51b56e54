"""`cobot run` whose arm is behind RTDE: a simulated controller in a process of its own."""

from __future__ import annotations

import itertools
import os
import subprocess
from pathlib import Path
from typing import Any

import yaml
from cobot_run import Run
from simulator_process import PATIENCE_S, SimulatorProcess

PERIOD_MS = 8
_numbers = itertools.count(1)


def own_address() -> str:
    """A loopback address of this computer that no other test uses: the ports of a controller are fixed."""
    pid = os.getpid()
    return f"127.{20 + pid % 200}.{pid // 200 % 250}.{next(_numbers)}"


class ControllerProcess(SimulatorProcess):
    """`cobot simulate ur` on a loopback address of its own.

    Attributes:
        address: of the controller.
    """

    def __init__(self, config: Path, *options: str, patience_s: float = PATIENCE_S) -> None:
        """config: settings of the arm."""
        self.address = own_address()
        where = ("--config", str(config), "--address", self.address)
        super().__init__("ur", *where, *options, patience_s=patience_s)


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
