"""The link to the controllers: a separate process that speaks DDS (`cobot.dds.arm_client`).

The process is polled several times a second. Because it is separate, network traffic and decoding do not
block the interpreter that runs the cycle. Motions are sent to it as binary arrays.
"""

from __future__ import annotations

import json
import os
import selectors
import subprocess
import sys
import time
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from cobot.types import Array
from rtloop.backends.protocols import BackendError

CLOSE_S = 2.0
START_S = 10.0
"""Timeout for the first answer from the process, s. A slow computer needs several seconds to start it."""
ANSWER_S = 3.0
"""Timeout for an answer from the process, in addition to the driver's own timeout, s."""
MAX_LINE = 1 << 21
ENDED = "the process that speaks ROS 2 has ended or does not answer; a reset starts it again"


@dataclass(frozen=True, slots=True)
class GoalFacts:
    """The state of the newest goal that this link has sent.

    Attributes:
        accepted: whether the controller accepted it; None before the answer.
        status: value of action_msgs/msg/GoalStatus; None before the result.
        error_code, error_string: fields of the result.
        lost: whether the action server disappeared before the result.
        stopping: whether cobot has cancelled it.
        running_s: time since the goal was sent, s; once there is a result: from sending to result.
        desired: desired positions in the last feedback, in the arm's order, shape (dof,), rad; None before
            the first feedback.
        feedback_age_s: age of this feedback, s.
    """

    accepted: bool | None = None
    status: int | None = None
    error_code: int = 0
    error_string: str = ""
    lost: bool = False
    stopping: bool = False
    running_s: float = 0.0
    desired: list[float] | None = None
    feedback_age_s: float = 1e9


@dataclass(frozen=True, slots=True)
class Facts:
    """The facts that the link reports.

    Attributes:
        problem: reason why the link does not work; "" while it works.
        action: name of the action that accepts the goals; "" if it is unknown.
        ready: whether the action server is available.
        choices: the candidates, if several actions match the settings.
        controllers: name, type, state and joints of each controller; None if there is no controller manager.
        controller: the controller that accepts the goals; "" if it is unknown.
        age_s: age of the last joint state, s; None before the first one.
        rate_hz: rate of joint states, Hz.
        names: joint names in the joint state.
        missing: joints of the arm that the joint state does not contain.
        position, velocity, effort: measured values in the arm's order; None if the joint state lacks them.
        goal: the newest goal; None before the first one and after `forget`.
        others: number of goals of other clients that are being executed.
        scaling: value of the speed slider; None if the driver does not report it.
        position_range: smallest and largest position of each joint in the recent joint states.
        held: positions that the controller itself has reported, in its state or in its feedback; empty if it
            reports none.
        held_range: smallest and largest position of each joint that the controller has recently reported.
        held_age_s: age of these positions, s.
        gpio: values of the inputs and outputs, by names of the form GPIO/INTERFACE.
        gpio_age_s: age of these values, s; None before the first ones.
        gpio_problem: reason why the driver has not set an output, or a note that it was set late; "" if no
            problem is known.
    """

    problem: str = ""
    action: str = ""
    ready: bool = False
    choices: list[str] = field(default_factory=list)
    controllers: list[dict[str, Any]] | None = None
    controller: str = ""
    age_s: float | None = None
    rate_hz: float = 0.0
    names: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    position: list[float] | None = None
    velocity: list[float] | None = None
    effort: list[float] | None = None
    goal: GoalFacts | None = None
    others: int = 0
    scaling: float | None = None
    position_range: tuple[list[float], list[float]] = ([], [])
    held: list[float] = field(default_factory=list)
    held_range: tuple[list[float], list[float]] = ([], [])
    held_age_s: float = 1e9
    gpio: dict[str, float] = field(default_factory=dict)
    gpio_age_s: float | None = None
    gpio_problem: str = ""


def facts_of(content: dict[str, Any]) -> Facts:
    """Convert an answer from the process to `Facts`."""
    goal = content.pop("goal")
    return Facts(**content, goal=None if goal is None else GoalFacts(**goal))


class ControllerLink(Protocol):
    """The functions of the link that the device uses. Each may raise BackendError."""

    def open(self) -> None:
        """Start to listen. Does nothing if the link is already listening."""
        ...

    def close(self) -> None:
        """Close the link. May be called several times."""
        ...

    def facts(self) -> Facts:
        """Return the current facts."""
        ...

    def load(self, times_s: Array, rows: Array) -> None:
        """Store a motion; shapes as in `TrajectoryDevice.load`."""
        ...

    def start(self) -> None:
        """Send the motion as a goal and wait for the answer, which `facts` then returns."""
        ...

    def cancel(self) -> str:
        """Cancel all goals of the action and wait for the answer. Returns "" on success, otherwise the reason
        for the failure.
        """
        ...

    def forget(self) -> None:
        """Forget the last goal."""
        ...

    def set_output(self, interface: str, value: float) -> None:
        """Send the value of an interface to the driver. If this fails later, `Facts.gpio_problem` contains
        the reason.
        """
        ...

    def pause(self, duration_s: float) -> None:
        """Wait between two polls."""
        ...


class ClientProcess:
    """A `ControllerLink` that uses the process that speaks DDS.

    Args:
        settings: see `cobot.dds.arm_client`.
    """

    def __init__(self, settings: dict[str, Any]) -> None:
        self._settings = settings
        self._process: subprocess.Popen[bytes] | None = None
        self._rest, self._begins = b"", True

    @property
    def _runs(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def open(self) -> None:
        if not self._runs:
            self.close()
            self._begin(self._settings)

    def _begin(self, settings: dict[str, Any], descriptors: tuple[int, ...] = ()) -> None:
        """Start the process.

        Args:
            descriptors: file descriptors of this process that the started process inherits.
        """
        command = [sys.executable, "-P", "-m", "cobot.dds.arm_client", json.dumps(settings)]
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=descriptors,
            start_new_session=True,  # Ctrl-C is handled by the service
        )
        self._rest, self._begins = b"", True

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
        if process.stdout is not None:
            process.stdout.close()

    def facts(self) -> Facts:
        return facts_of(self._ask({"ask": "facts"}))

    def load(self, times_s: Array, rows: Array) -> None:
        content = np.ascontiguousarray(np.concatenate([times_s, rows.reshape(-1)]), "<f8").tobytes()
        self._ask({"ask": "load", "points": len(times_s), "bytes": len(content)}, content)

    def start(self) -> None:
        self._ask({"ask": "start"}, driver_s=self._settings["answer_timeout_s"])

    def cancel(self) -> str:
        return str(self._ask({"ask": "cancel"}, driver_s=self._settings["answer_timeout_s"])["failed"])

    def forget(self) -> None:
        self._ask({"ask": "forget"})

    def set_output(self, interface: str, value: float) -> None:
        self._ask({"ask": "output", "interface": interface, "value": value})

    def pause(self, duration_s: float) -> None:
        time.sleep(duration_s)

    def _ask(
        self, question: dict[str, Any], content: bytes = b"", *, driver_s: float = 0.0
    ) -> dict[str, Any]:
        """
        Args:
            driver_s: time for which the process may wait for the driver, s.
        """
        process = self._process
        if process is None or process.stdin is None or process.stdout is None:
            raise BackendError(ENDED)
        try:
            process.stdin.write(json.dumps(question).encode() + b"\n" + content)
            process.stdin.flush()
            timeout_s = (START_S if self._begins else ANSWER_S) + driver_s
            answer: dict[str, Any] = json.loads(self._line(process.stdout.fileno(), timeout_s))
        except (OSError, ValueError) as exc:
            self.close()
            raise BackendError(ENDED) from exc
        self._begins = False
        if answer.get("error"):
            raise BackendError(answer["error"])
        return answer

    def _line(self, descriptor: int, timeout_s: float) -> bytes:
        """Read the next line from the process.

        Raises:
            OSError: the line does not arrive in time.
        """
        deadline_s = time.monotonic() + timeout_s
        with selectors.DefaultSelector() as selector:
            selector.register(descriptor, selectors.EVENT_READ)
            while b"\n" not in self._rest:
                if len(self._rest) > MAX_LINE or not selector.select(deadline_s - time.monotonic()):
                    raise OSError("no answer")
                piece = os.read(descriptor, 1 << 16)
                if not piece:
                    raise OSError("the end")
                self._rest += piece
        line, self._rest = self._rest.split(b"\n", 1)
        return line
