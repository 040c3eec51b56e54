"""What the arm of a running service does by way of the service, in addition to arm_activities.py: servo
points, a goal of FollowJointTrajectory, a sequence, a Lua program. Each goes on by itself until it is
ended, whatever dies, and has `error`: what its client was told of a failure, "" for nothing yet.
"""

from __future__ import annotations

import contextlib
import json
import math
import threading
from collections.abc import Iterator
from typing import Any

import httpx
from arm_activities import BUSY, HOME, Motion, robot_health
from cobot_run import WAIT_S, Run
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect

PERIOD_S = 0.02
WATCHDOG_S = 10.0
"""So long that a test whose client is kept waiting for the processor sees the service fall silent first."""
ABORTED = 6
"""The status of a goal, in action_msgs."""
AWAY = [0.8, 0.3, -0.3, -1.2, 0.3, 1.2, 0.5]


class OverRosbridge:
    """A client of rosbridge, in a thread.

    Attributes:
        answers: what has come back.
        lost: set when its connection has gone.
    """

    def __init__(self, run: Run) -> None:
        self._run = run
        self._over = threading.Event()
        self.lost = threading.Event()
        self.answers: list[dict[str, Any]] = []
        self._thread = threading.Thread(target=self._talk, daemon=True)
        self._thread.start()
        run.until(lambda: robot_health(run).get("mode") in {mode.name for mode in BUSY})

    def end(self) -> None:
        self._over.set()
        self._thread.join(WAIT_S)
        assert not self._thread.is_alive()

    def _talk(self) -> None:
        url = self._run.url.replace("http", "ws") + "/rosbridge"
        with contextlib.suppress(WebSocketException, OSError), connect(url) as socket:
            self._do(socket)
        self.lost.set()

    def _do(self, socket: Any) -> None:
        raise NotImplementedError

    def _take(self, socket: Any, seconds: float) -> None:
        with contextlib.suppress(TimeoutError):
            self.answers.append(json.loads(socket.recv(seconds)))


class Servo(OverRosbridge):
    """Points on /{robot}/joint_cmd."""

    def _do(self, socket: Any) -> None:
        def send(**content: Any) -> None:
            message = {"op": "publish", "topic": f"/{self._run.name}/joint_cmd"}
            data = {"data": json.dumps(content)}
            socket.send(json.dumps({**message, "type": "std_msgs/String", "msg": data}))

        begin = self._run.joints()
        send(
            type="servo_control",
            command="set_mode",
            mode=1,
            watchdog_timeout=WATCHDOG_S,
            send_period=PERIOD_S,
        )
        number = 0
        while not self._over.wait(PERIOD_S):
            number += 1
            turned = begin[0] + 0.1 * (1.0 - math.cos(2.0 * number * PERIOD_S))
            where = {"session_id": 1, "point_id": number, "time": PERIOD_S}
            send(type="servo_point", position=[turned, *begin[1:]], **where)

    def error(self) -> str:
        """A session has no end of its own: its client looks at the robot's status."""
        health = robot_health(self._run)
        return str(health["reason"]) if health.get("mode") == "HOLD" else ""


def goal_asked(run: Run, there: list[float], time_s: int, joint: str | list[str] = "joint") -> str:
    """To be sent over rosbridge for a goal of FollowJointTrajectory. The joints have these names, or this
    name and a number.
    """
    point = {"positions": there, "time_from_start": {"sec": time_s, "nanosec": 0}}
    joints = joint
    if isinstance(joint, str):
        joints = [f"{joint}{number}" for number in range(1, len(there) + 1)]
    asked = {
        "op": "send_action_goal",
        "id": "goal",
        "action": f"/{run.name}/follow_joint_trajectory",
        "action_type": "control_msgs/action/FollowJointTrajectory",
        "args": {"trajectory": {"joint_names": joints, "points": [point]}},
    }
    return json.dumps(asked)


def followed(
    run: Run, there: list[float], time_s: int = 2, joint: str | list[str] = "joint"
) -> tuple[bool, str]:
    """Whether a goal of FollowJointTrajectory arrives, and what was answered."""
    with connect(run.url.replace("http", "ws") + "/rosbridge") as socket:
        socket.send(goal_asked(run, there, time_s, joint))
        said = str(socket.recv(WAIT_S))
    return bool(json.loads(said)["values"]["error_code"] == 0), said


class Goal(OverRosbridge):
    """A goal of FollowJointTrajectory."""

    def _do(self, socket: Any) -> None:
        here = self._run.joints()
        there = AWAY if abs(here[0] - AWAY[0]) > 0.1 else HOME
        socket.send(goal_asked(self._run, there, 20))
        while not self._over.is_set() and not self.answers:
            self._take(socket, 0.05)

    def error(self) -> str:
        for answer in self.answers:
            assert answer["status"] == ABORTED
            return str(answer["values"]["error_string"])
        return ""


class Program:
    """A sequence file, or a Lua program, that the runner runs."""

    file = ""
    source = b""

    def __init__(self, run: Run) -> None:
        self._run = run
        files = {"config": (self.file, self.source)}
        started = httpx.post(f"{run.url}/sequences/start", files=files, timeout=WAIT_S)
        assert started.status_code == 200, started.text
        self.pid = int(started.json()["pid"])
        run.until(lambda: robot_health(run).get("mode") == "TRAJECTORY")

    def end(self) -> None:
        with contextlib.suppress(httpx.TransportError):
            httpx.post(f"{self._run.url}/stop", timeout=WAIT_S)

    def error(self) -> str:
        if httpx.get(f"{self._run.url}/sequences/status", timeout=WAIT_S).json()["returncode"] in (0, None):
            return ""
        job = httpx.get(f"{self._run.url}/jobs", timeout=WAIT_S).json()["jobs"][0]
        return str((job["error"] or {"detail": ""})["detail"])


class Sequence(Program):
    file = "s.json"
    source = json.dumps(
        {"waypoints": [{"joints": joints, "speed": 0.1} for joints in 50 * (AWAY, HOME)]}
    ).encode()


class Lua(Program):
    file = "p.lua"
    source = (
        f"while true do movej({{{', '.join(map(str, AWAY))}}}, 0.1) "
        f"movej({{{', '.join(map(str, HOME))}}}, 0.1) end"
    ).encode()


ACTIVITIES: dict[str, Any] = {
    "motion": Motion,
    "servo": Servo,
    "goal": Goal,
    "sequence": Sequence,
    "lua": Lua,
}


@contextlib.contextmanager
def active(run: Run, activity: str) -> Iterator[Any]:
    made = ACTIVITIES[activity](run)
    try:
        yield made
    finally:
        made.end()
