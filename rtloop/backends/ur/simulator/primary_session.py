"""One client of a simulated controller's primary or secondary interface, which receives programs and sends
the state.
"""

from __future__ import annotations

import struct

from rtloop.backends.ur.fields import AXES, RuntimeState, SafetyMode, UrRobotMode
from rtloop.backends.ur.simulator.controller import UrController
from rtloop.backends.ur.simulator.urscript import is_complete

STATE_S = 0.1
MAX_PROGRAM = 1 << 20
MAX_OUT = 1 << 20
_STATE, _MESSAGE, _VERSION, _EXCEPTION = 16, 20, 3, 10
_SAFETY_SOURCE = 7
NOBODY = 253


class PrimarySession:
    """A `UrSession` for a client of the primary or secondary interface."""

    def __init__(self, controller: UrController, *, is_primary: bool = True) -> None:
        """
        Args:
            is_primary: whether the client receives messages in addition to the state.
        """
        self._controller, self._is_primary = controller, is_primary
        self.out, self.is_over = bytearray(), False
        self._text = b""
        self._periods = round(STATE_S / controller.period_s)
        self._seen = len(controller.messages)
        if is_primary:
            self.out += self._version()

    def feed(self, received: bytes) -> None:
        self._text += received
        if len(self._text) > MAX_PROGRAM:
            self.is_over = True
        elif self._text.endswith(b"\n"):
            text = self._text.decode(errors="replace")
            if not text.strip():
                self._text = b""
            elif is_complete(text):
                self._text = b""
                self._controller.upload(text)

    def tick(self) -> None:
        if self._is_primary:
            messages = self._controller.messages
            for line, column, said in messages[self._seen :]:
                body = struct.pack(">ii", line, column) + said.encode()
                self.out += self._message(_EXCEPTION, body)
            self._seen = len(messages)
        if self._controller.steps % self._periods == 0 and len(self.out) < MAX_OUT:
            self.out += _package(_STATE, self._mode() + self._joints() + self._cartesian())

    def close(self) -> None:
        """Do nothing, because this session leaves nothing behind in the controller."""

    def _message(self, kind: int, body: bytes) -> bytes:
        stamp = round(1e6 * self._controller.time_s)
        return _package(_MESSAGE, struct.pack(">QbB", stamp, -2, kind) + body)

    def _version(self) -> bytes:
        major, minor, bugfix, build = self._controller.options.version
        name = b"URControl"
        body = bytes([len(name)]) + name + struct.pack(">BBii", major, minor, bugfix, build)
        return self._message(_VERSION, body)

    def _mode(self) -> bytes:
        c = self._controller
        stopped = c.safety in (SafetyMode.SYSTEM_EMERGENCY_STOP, SafetyMode.ROBOT_EMERGENCY_STOP)
        flags = (
            False,
            True,
            c.robot_mode >= UrRobotMode.POWER_ON,
            stopped,
            c.safety == SafetyMode.PROTECTIVE_STOP,
            c.runtime == RuntimeState.PLAYING,
            c.runtime == RuntimeState.PAUSED,
        )
        body = struct.pack(">Q7?BB", round(1e6 * c.time_s), *flags, max(int(c.robot_mode), 0), 0)
        return _part(0, body + struct.pack(">dddB", c.slider, 1.0, 1.0, 0))

    def _joints(self) -> bytes:
        arm = self._controller.arm
        mode = NOBODY if self._controller.robot_mode == UrRobotMode.RUNNING else 239
        measured = arm.measured
        return _part(
            1,
            b"".join(
                struct.pack(
                    ">dddffffB",
                    measured.position[joint],
                    arm.setpoint[joint],
                    measured.velocity[joint],
                    0.0,
                    48.0,
                    30.0,
                    30.0,
                    mode,
                )
                for joint in range(AXES)
            ),
        )

    def _cartesian(self) -> bytes:
        return _part(4, struct.pack(">12d", *self._controller.pose(), *self._controller.tcp))


def _package(kind: int, body: bytes) -> bytes:
    return struct.pack(">iB", 5 + len(body), kind) + body


def _part(kind: int, body: bytes) -> bytes:
    return _package(kind, body)
