"""The link to a ROS 2 driver. The separate process `cobot.dds.action_client` speaks DDS."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from dataclasses import dataclass, field
from typing import Any, Protocol

from cobot.clock import SYSTEM
from cobot.grippers.protocol import GripperError, Now

CLOSE_S = 2.0


@dataclass(slots=True)
class GripperGoal:
    """A goal, and the messages received about it.

    Attributes:
        number: number of the goal; 0 if no goal was sent yet.
        sent_s: time at which the goal was sent.
        accepted: whether the goal was accepted; None before the answer.
        ended_s: time at which the result of the goal arrived.
        status, values: status and values of the result. The status is None before the result arrives.
    """

    number: int = 0
    sent_s: float = 0.0
    accepted: bool | None = None
    ended_s: float = 0.0
    status: int | None = None
    values: dict[str, Any] = field(default_factory=dict)

    def take(self, content: dict[str, Any], now_s: float) -> None:
        """Read a line about this goal."""
        if content["what"] == "sent":
            self.sent_s = now_s
        elif content["what"] == "answer":
            self.accepted = content["accepted"]
        elif content["what"] == "result":
            self.ended_s, self.values, self.status = now_s, content["values"], content["status"]


@dataclass(slots=True)
class DriverState:
    """The data received from the ROS 2 driver. One thread receives it, and another one starts goals.

    Attributes:
        ready: whether the server of the action is available.
        joint: position and effort of the joint; None before the first joint state, or if they are not
            numbers.
        joint_s, told_s: times of the last joint state, and of the last data of any kind.
        goal: the latest goal. A new goal is a new object, so that a result that arrives at the same moment is
            not mistaken for its result.
        earlier: values of the last result from before this link was opened.
        problem: the reason why no more data arrive; "" while data arrive.
    """

    ready: bool = False
    joint: tuple[Any, Any] | None = None
    joint_s: float = -1e9
    told_s: float = -1e9
    goal: GripperGoal = field(default_factory=GripperGoal)
    earlier: dict[str, Any] | None = None
    problem: str = ""

    def begin(self, now_s: float) -> int:
        """Start a new goal, and return its number."""
        self.goal = GripperGoal(self.goal.number + 1, now_s)
        self.earlier = None
        return self.goal.number

    def take(self, content: dict[str, Any], now_s: float) -> None:
        """Read a line that the process has printed."""
        goal, what = self.goal, content["what"]
        self.told_s = now_s
        if what == "ready":
            self.ready = content["ready"]
        elif what == "joint":
            self.joint, self.joint_s = (content["position"], content["effort"]), now_s
        elif what == "error":
            self.problem = content["text"]
        elif content["number"] == goal.number and goal.number:
            goal.take(content, now_s)
        elif content["number"] == goal.number:
            self.earlier = content["values"]


class ActionLink(Protocol):
    """Interface of the link to a ROS 2 driver.

    Attributes:
        heard: the received data.
    """

    heard: DriverState

    def open(self) -> None:
        """Start to listen, unless the link already listens."""
        ...

    def close(self) -> None:
        """Close the link. May be called twice."""
        ...

    def send(self, goal: dict[str, Any]) -> None:
        """Send a goal.

        Raises:
            GripperError: the link has ended.
        """
        ...

    def cancel(self) -> None:
        """Cancel the latest goal."""
        ...


class ActionProcess:
    """An `ActionLink` that uses a separate process. `cobot.dds.action_client` describes its settings."""

    def __init__(self, settings: dict[str, Any], clock: Now = SYSTEM) -> None:
        self._settings, self._clock = settings, clock
        self._process: subprocess.Popen[str] | None = None
        self.heard = DriverState()

    def open(self) -> None:
        if self._process is not None and self._process.poll() is None:
            return
        self.close()
        command = [sys.executable, "-P", "-m", "cobot.dds.action_client", json.dumps(self._settings)]
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            start_new_session=True,  # Ctrl-C is meant for the service
        )
        self.heard = heard = DriverState()
        threading.Thread(target=self._listen, args=(self._process, heard), daemon=True).start()

    def close(self) -> None:
        process, self._process = self._process, None
        if process is None or process.stdin is None:
            return
        try:
            process.stdin.close()
            process.wait(CLOSE_S)
        except (OSError, subprocess.TimeoutExpired):
            process.kill()
            process.wait()

    def send(self, goal: dict[str, Any]) -> None:
        self._write({"number": self.heard.begin(self._clock.now_s()), "goal": goal})

    def cancel(self) -> None:
        self._write({"cancel": self.heard.goal.number})

    def _write(self, content: dict[str, Any]) -> None:
        process = self._process
        try:
            if process is None or process.stdin is None:
                raise OSError("the process that speaks ROS 2 is not running")
            process.stdin.write(json.dumps(content) + "\n")
            process.stdin.flush()
        except (OSError, ValueError) as exc:
            raise GripperError(
                f"the process that speaks ROS 2 has ended: {exc}; cobot starts it again"
            ) from exc

    def _listen(self, process: subprocess.Popen[str], heard: DriverState) -> None:
        assert process.stdout is not None
        with process.stdout as lines:
            for line in lines:
                try:
                    heard.take(json.loads(line), self._clock.now_s())
                except (ValueError, KeyError, TypeError) as exc:
                    heard.problem = f"the process that speaks ROS 2 has sent {line[:100]!r}: {exc}"
        heard.problem = heard.problem or "the process that speaks ROS 2 has ended; cobot starts it again"
