"""The controllers of an arm with real ROS 2 (rclpy) in a process of their own, and robots behind them."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import yaml
from cobot_run import WAIT_S, Run
from folders import TESTS
from real_ros import PYTHON, environment

from cobot.config import Settings, load_settings
from cobot.robot.description import load_robot
from cobot.trajectory import Trajectory, from_hermite
from cobot.types import Array
from rtloop.backends.ros2_control import Ros2ControlArm

PEERS = TESTS / "cobot" / "dds"
JOINTS = [f"ur_joint{number}" for number in range(1, 8)]
NAMESPACE = "/left"
ACTION = f"{NAMESPACE}/joint_trajectory_controller/follow_joint_trajectory"
OPTIONS: dict[str, Any] = {
    "namespace": NAMESPACE,
    "prefix": "ur_",
    "state_timeout_s": 4.0,
    "answer_timeout_s": 10.0,
    "min_rate_hz": 4.0,
}
"""With patience: on a busy computer rclpy's executor stands still for seconds."""


class Double:
    """The controllers' process."""

    def __init__(self, domain: int, prefix: Path) -> None:
        self.domain, self.prefix = domain, prefix
        self.start()

    def start(self) -> None:
        self.process = subprocess.Popen(
            [str(PYTHON), str(PEERS / "jazzy_controller.py"), NAMESPACE, *JOINTS],
            env=environment(self.prefix, domain=self.domain),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self._line() == "ready"

    def be(self, mode: str) -> str:
        assert self.process.stdin is not None
        print(mode, file=self.process.stdin, flush=True)
        return self._line()

    def seen(self) -> dict[str, Any]:
        """What it has seen of the newest goal."""
        found: dict[str, Any] = json.loads(self.be("seen"))
        return found

    def _line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def kill(self) -> None:
        with self.process:
            self.process.kill()

    def settings(self, **options: Any) -> Settings:
        """Settings of a robot behind it."""
        settings = load_settings()
        ros = settings.ros.model_copy(update={"domain_id": self.domain, "localhost_only": True})
        chosen = {"type": "ros2_control", "options": {**OPTIONS, **options}}
        backend = settings.robot.backend.model_copy(update=chosen)
        robot = settings.robot.model_copy(update={"backend": backend})
        return settings.model_copy(update={"ros": ros, "robot": robot})

    def arm(self, **options: Any) -> Ros2ControlArm:
        """A backend at it, not open yet."""
        settings = self.settings(**options)
        return Ros2ControlArm(settings, load_robot(settings).limits)


def motion(start: Array, change: float, duration_s: float) -> tuple[Trajectory, Array, Array]:
    """A motion of all joints with its points."""
    still = np.zeros((2, 7))
    made = from_hermite(np.array([0.0, duration_s]), np.array([start, start + change]), still, still)
    times_s = np.linspace(0.0, duration_s, 2 + int(duration_s / 0.02))
    return made, times_s, np.array([made.sample(times_s, order) for order in range(3)])


class RunAtDouble(Run):
    """The shipped iiwa with one other line."""

    def __init__(self, folder: Path, double: Double, kind: str = "ros2_control") -> None:
        self._options = {"type": kind, **OPTIONS, "connect_s": 20.0, "state_timeout_s": 2.0}
        super().__init__(folder, clock="realtime", ros_domain=double.domain)

    def start(self) -> subprocess.Popen[str]:
        settings = yaml.safe_load(self.config.read_text(encoding="utf-8"))
        settings["robot"]["backend"] = self._options
        slow = {
            "frozen_after_s": 1.0,
            "tracking_error_rad": 0.5,
        }  # a busy computer delays rclpy's controllers
        settings["rt"] |= {"period_s": 0.004, **slow}
        self.config.write_text(yaml.safe_dump(settings), encoding="utf-8")
        return super().start()


def acknowledge(run: Run) -> None:
    """Let the arm move as fast as it may, as a person who has examined it."""
    (robot,) = httpx.get(f"{run.url}/robots", timeout=WAIT_S).json()
    if robot["device"]["unacknowledged"]:
        checked = {"payload_checked": True}
        httpx.post(f"{run.url}/robot/acknowledge", json=checked, timeout=WAIT_S).raise_for_status()


def rclpy_follows(double: Double, action: str, goals: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """What rclpy's action client tells of each goal."""
    command = [str(PYTHON), str(PEERS / "jazzy_follower.py"), action, json.dumps(goals)]
    ended = subprocess.run(
        command,
        env=environment(double.prefix, domain=double.domain),
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr[-2000:]
    told = [json.loads(line) for line in ended.stdout.splitlines()]
    return [each for each in told if "took_s" in each]
