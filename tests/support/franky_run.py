"""`cobot run` whose arm is a Franka: franky-sim in a process of its own, or a stand-in within rtloop."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any, Self

import yaml
from cobot_run import (
    BRIEF_RECORDING,
    HELPER_ENVIRONMENT,
    PATIENT,
    PATIENT_PLANNING,
    WAIT_S,
    Run,
    unique_name,
    until,
)
from franka_settings import FR3

from app.routes import ENDPOINTS

ADDRESS = f"127.{1 + os.getpid() % 200}.{1 + os.getpid() // 200 % 250}.7"
"""Its port is always the same: an address of its own."""
TRACKING_RAD = 0.4
"""It lags behind its commands by up to 0.07 s."""


class FrankySimulator:
    """`franky_simulator` for a client on this computer."""

    backend, address = "franka", ADDRESS

    def __init__(self) -> None:
        command = [sys.executable, str(Path(__file__).with_name("franky_simulator.py")), ADDRESS]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=HELPER_ENVIRONMENT
        )
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line == "ready\n", line

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.communicate(timeout=WAIT_S)

    def ask(self, fault: str = "") -> dict[str, Any]:
        """Have a fault last, or none; how the arm is."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps({"fault": fault}) + "\n")
        self.process.stdin.flush()
        found: dict[str, Any] = json.loads(self.process.stdout.readline())
        return found


class StandInArm:
    """`franka_in_service`, wherever rtloop has it."""

    backend = "franka_in_service:StandIn"

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(0.5)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            self._place = free.getsockname()
        self.address = "{}:{}".format(*self._place)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def ask(self, fault: str = "") -> dict[str, Any]:
        """Have a fault last, or none; how the arm is."""

        def asked() -> dict[str, Any] | None:
            try:
                self._socket.sendto(json.dumps({"fault": fault}).encode(), self._place)
                found: dict[str, Any] = json.loads(self._socket.recv(10_000))
            except OSError:  # it is too busy
                return None
            return found

        answer: dict[str, Any] = until(asked)
        return answer


class RunOfFranka(Run):
    """The FR3 with another backend: one changed line, and patience. The arm waits for a busy computer, and
    who moves it waits for the arm.
    """

    def __init__(self, folder: Path, arm: FrankySimulator | StandInArm) -> None:
        self.name = unique_name()
        self.asking = {}
        content = yaml.safe_load(FR3.read_text(encoding="utf-8"))
        content["robot"] |= {
            "name": self.name,
            "backend": {"type": arm.backend, "address": arm.address, "realtime": "ignore"},
        }
        content["rt"] = yaml.safe_load(f"{{{PATIENT}, tracking_error_rad: {TRACKING_RAD}}}")
        content["web"] |= {"port": 0, "endpoints": "endpoints.yaml"}
        content["sequences"] = {"recordings": "recordings", "programs": "programs"}
        content |= {"logs": "logs", "ros": {"enabled": False}, "planning": {"workers": 1}}
        content["planning"] |= yaml.safe_load(f"{{{PATIENT_PLANNING}}}")
        content |= yaml.safe_load(BRIEF_RECORDING)
        patient = {name: {"timeout_s": WAIT_S} for name in ENDPOINTS}
        (folder / "endpoints.yaml").write_text(yaml.safe_dump({"endpoints": patient}), encoding="utf-8")
        self.config = folder / "fr3.yaml"
        self.config.write_text(yaml.safe_dump(content), encoding="utf-8")
        self.lines: list[str] = []
        self.start()

    def start(self) -> subprocess.Popen[str]:
        """With the stand-in's module within reach."""
        before = os.environ.get("PYTHONPATH")
        os.environ["PYTHONPATH"] = HELPER_ENVIRONMENT["PYTHONPATH"]
        try:
            return super().start()
        finally:
            if before is None:
                del os.environ["PYTHONPATH"]
            else:
                os.environ["PYTHONPATH"] = before
