"""The connection between the driver and a Franka Hand, through separate processes."""

from __future__ import annotations

import json
import select
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from cobot.grippers.protocol import GripperError

HELPER = Path(__file__).with_name("helper.py")
CONNECT_S = 10.0
READ_S = 1.0
"""Timeout for the answer to a read or a stop, s."""


@dataclass(frozen=True, slots=True)
class HandReading:
    """A reading of the hand (in m and °C), and the age of the reading in s."""

    width: float
    max_width: float
    is_grasped: bool
    temperature: float
    age_s: float = 0.0


@dataclass(frozen=True, slots=True)
class CallResult:
    """The result of a command.

    Attributes:
        failure: the reason why the hand has rejected the command; "" if it has not rejected it.
    """

    good: bool
    failure: str = ""


class HandLink(Protocol):
    """A connection to a hand. Each method may raise a GripperError."""

    def open(self) -> None: ...

    def close(self) -> None: ...

    def read(self) -> HandReading:
        """Read the state. While a command is running, the result can be the state before that command."""
        ...

    def begin(self, call: str, *arguments: float) -> None:
        """Start a command. The previous one must have ended or been aborted."""
        ...

    def result(self) -> CallResult | None:
        """The result of the last command; None while it is running."""
        ...

    def abort(self) -> None:
        """Stop the fingers and end the running command."""
        ...


class ProcessLink:
    """The hand at an address. One process is connected, and a second process waits to replace it.

    The hand accepts one connection at a time, and the state cannot be read while a command is running.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._connected: _Helper | None = None
        self._spare: _Helper | None = None
        self._pending = False
        self._result: CallResult | None = None
        self._seen = HandReading(0.0, 0.0, False, 0.0)
        self._seen_s = 0.0

    def open(self) -> None:
        """See `HandLink`."""
        self._disconnect()
        self._connected, self._spare = self._spare or _Helper(self._address), None
        self._ask(CONNECT_S, "connect", self._address)
        self._spare = _Helper(self._address)

    def close(self) -> None:
        """See `HandLink`."""
        self._disconnect()
        if self._spare is not None:
            self._spare.close()
            self._spare = None

    def read(self) -> HandReading:
        """See `HandLink`. While a command is running, this returns the state before that command."""
        if not self._pending:
            self._seen = HandReading(*self._ask(READ_S, "read_once"))
            self._seen_s = time.monotonic()
        return replace(self._seen, age_s=time.monotonic() - self._seen_s)

    def begin(self, call: str, *arguments: float) -> None:
        """See `HandLink`."""
        self._helper().call(call, *arguments)
        self._pending, self._result = True, None

    def result(self) -> CallResult | None:
        """See `HandLink`."""
        if self._pending and (answer := self._helper().answer(0.0, waits=False)) is not None:
            self._pending = False
            self._result = CallResult(bool(answer.get("ok")), str(answer.get("failed", "")))
        return self._result

    def abort(self) -> None:
        """See `HandLink`."""
        if self.result() is None and self._pending:
            self.open()
            self._ask(READ_S, "stop")
            self._result = CallResult(good=False)

    def _disconnect(self) -> None:
        if self._connected is not None:
            self._connected.close()
        self._connected, self._pending = None, False

    def _ask(self, timeout_s: float, call: str, *arguments: Any) -> Any:
        helper = self._helper()
        helper.call(call, *arguments)
        answer = helper.answer(timeout_s)
        if "failed" in answer:
            raise GripperError(f"{self._address}: the hand rejects {call}: {answer['failed']}")
        return answer["ok"]

    def _helper(self) -> _Helper:
        if self._connected is None:
            raise GripperError(f"{self._address}: the hand is not connected")
        return self._connected


class _Helper:
    """A helper process. It imports the library in advance, before a connection is needed."""

    def __init__(self, address: str) -> None:
        self._address = address
        self._process = subprocess.Popen(
            [sys.executable, "-P", str(HELPER)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            start_new_session=True,
        )
        self._buffer = b""

    def call(self, name: str, *arguments: Any) -> None:
        """Send a method's name and arguments to the process. Read the result with `answer`."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps([name, *arguments]).encode() + b"\n")
        except OSError as exc:
            raise self._error("the process of this connection has ended") from exc

    def answer(self, timeout_s: float, *, waits: bool = True) -> Any:
        """The next answer from the process.

        Args:
            waits: whether a missing answer is an error. If it is not, the result is then None.

        Raises:
            GripperError: there is no answer in time, or the connection is lost.
        """
        assert self._process.stdout is not None
        end_s = time.monotonic() + timeout_s
        while b"\n" not in self._buffer:
            left_s = max(0.0, end_s - time.monotonic())
            if not select.select([self._process.stdout], [], [], left_s)[0]:
                if waits:
                    raise self._error(f"the hand has not answered within {timeout_s:.3g} s")
                return None
            got = self._process.stdout.read(4096)
            if not got:
                raise self._error("the process of this connection has ended")
            self._buffer += got
        line, _, self._buffer = self._buffer.partition(b"\n")
        answer = json.loads(line)
        if "lost" in answer:
            raise self._error(str(answer["lost"]))
        return answer

    def close(self) -> None:
        """Kill the process, because it may hang in a library call."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            pipe.close()

    def _error(self, why: str) -> GripperError:
        return GripperError(
            f"{self._address}: the hand cannot be reached: {why}; check the network, and that the hand is "
            "configured in Franka's Desk"
        )
