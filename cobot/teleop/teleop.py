"""The loop between an input device and the arm. While a key or a button is held, it sends a `jog` frame
twenty times per second.

After each frame the service moves the arm for at most 0.2 s. So the arm stops if everything is released, if
the device is unplugged, if the program ends or hangs, or if the network is lost.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any, Protocol

from cobot.client.connection import ERRORS
from cobot.clock import SYSTEM, Clock
from cobot.errors import CobotError, InputError
from cobot.teleop.hand import HandDevice

PERIOD_S = 0.05
LET_GO = {"type": "jog"}


class FrameSocket(Protocol):
    """A WebSocket on /robot/stream."""

    def send(self, frame: str, /) -> None: ...

    def recv(self) -> str | bytes: ...


class Teleoperation:
    """
    Args:
        socket: connection from which `hello` has not been read yet.
        device: the input device.
        speed: share of the maximum velocities, above 0 to 1.
        say: shows the user a line that gives the reason why the arm moves slower or not at all.
    """

    def __init__(
        self,
        socket: FrameSocket,
        device: HandDevice,
        speed: float,
        say: Callable[[str], None],
        clock: Clock = SYSTEM,
    ) -> None:
        if not 0.0 < speed <= 1.0:
            raise InputError(f"speed must be above 0 and at most 1, got {speed}")
        self._socket, self._device, self._speed, self._say, self._clock = socket, device, speed, say, clock
        self._dof = int(json.loads(self._socket.recv())["dof"])
        self._moving = False
        self._said = ""

    def run(self) -> None:
        """Run until the user ends it.

        Raises:
            UnavailableError: the device or the service is gone. The arm stops.
        """
        due_s = self._clock.now_s()
        try:
            while not self._device.ended:
                self.once()
                now_s = self._clock.now_s()
                due_s = max(due_s + PERIOD_S, now_s)
                self._clock.sleep(due_s - now_s)
        finally:
            self._let_go()

    def once(self) -> None:
        """Send the velocity that is requested now."""
        velocity = self._device.read_velocity(self._clock.now_s())
        if velocity is None:
            self._let_go()
            return
        try:
            answer = self._ask(velocity.frame_of(self._dof, self._speed))
            self._moving = True
            self._tell(answer)
        except CobotError as exc:
            if exc.code == "unavailable":
                raise
            self._show(str(exc))

    def _let_go(self) -> None:
        if self._moving:
            self._moving = False
            self._socket.send(json.dumps(LET_GO))
            self._show("")

    def _ask(self, frame: dict[str, object]) -> dict[str, Any]:
        self._socket.send(json.dumps(frame))
        while True:
            answer = json.loads(self._socket.recv())
            if answer["type"] == "error":
                raise ERRORS.get(answer["code"], CobotError)(answer["detail"])
            if answer["type"] == "jog":
                return dict(answer)

    def _tell(self, answer: dict[str, Any]) -> None:
        share, why = float(answer["share"]), str(answer["limited_by"])
        self._show(f"{share:.0%} of the speed: {why}" if why and share < 1.0 else "")

    def _show(self, line: str) -> None:
        if line != self._said:
            self._said = line
            self._say(line)
