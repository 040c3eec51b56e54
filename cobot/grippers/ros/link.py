"""The link to a ROS 2 driver: a process of its own speaks DDS (`cobot.dds.action_client`)."""

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
class DriverState:
    """What has come from the driver.

    Attributes:
        ready: the server of the action is there.
        joint: position and effort of the joint; None before the first one, or if they are not numbers.
        joint_s, told_s: when the joint was heard last, and anything at all.
        number: of the newest goal.
        sent_s: when it was sent.
        accepted: None before the answer.
        ended_s: when its result came.
        status, values: of the result; None before it.
        earlier: the values of the last result from before this link.
        problem: why nothing comes any more.
    """

    ready: bool = False
    joint: tuple[Any, Any] | None = None
    joint_s: float = -1e9
    told_s: float = -1e9
    number: int = 0
    sent_s: float = 0.0
    accepted: bool | None = None
    ended_s: float = 0.0
    status: int | None = None
    values: dict[str, Any] = field(default_factory=dict)
    earlier: dict[str, Any] | None = None
    problem: str = ""

    def begin(self, now_s: float) -> int:
        """There is a new goal; its number."""
        self.number += 1
        self.sent_s, self.accepted, self.status, self.values = now_s, None, None, {}
        self.earlier = None
        return self.number

    def take(self, content: dict[str, Any], now_s: float) -> None:
        """Take a line of the process."""
        self.told_s = now_s
        what, own = content["what"], content.get("number") == self.number
        if what == "ready":
            self.ready = content["ready"]
        elif what == "joint":
            self.joint, self.joint_s = (content["position"], content["effort"]), now_s
        elif what == "answer" and own:
            self.accepted = content["accepted"]
        elif what == "result" and own and self.number:
            self.ended_s, self.values, self.status = now_s, content["values"], content["status"]
        elif what == "result" and own:
            self.earlier = content["values"]
        elif what == "error":
            self.problem = content["text"]


class ActionLink(Protocol):
    """What a driver needs of the link.

    Attributes:
        heard: what has come.
    """

    heard: DriverState

    def open(self) -> None:
        """Begin to listen, unless it does already."""
        ...

    def close(self) -> None:
        """Let go; also twice."""
        ...

    def send(self, goal: dict[str, Any]) -> None:
        """Send a goal.

        Raises:
            GripperError: the link has ended.
        """
        ...

    def cancel(self) -> None:
        """Cancel the newest goal."""
        ...


class ActionProcess:
    """An `ActionLink` over the process. Settings: see `cobot.dds.action_client`."""

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
            start_new_session=True,  # Ctrl-C is the service's
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
        self._write({"cancel": self.heard.number})

    def _write(self, content: dict[str, Any]) -> None:
        process = self._process
        try:
            if process is None or process.stdin is None:
                raise OSError("it is not connected")
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
                    heard.problem = f"the process that speaks ROS 2 has said {line[:100]!r}: {exc}"
        heard.problem = heard.problem or "the process that speaks ROS 2 has ended; cobot starts it again"
