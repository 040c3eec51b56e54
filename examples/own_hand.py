"""Move the arm by hand with your own device, such as a joystick, a tracker or a glove. The device in this
example draws a small square with the TCP. While it returns no velocity, the arm does not move.

Start `make run` in another terminal, then:

.venv/bin/python examples/own_hand.py
"""

from __future__ import annotations

import os
import sys

from cobot.client import Client
from cobot.client.tls import token_from_environment
from cobot.client.websocket import open_socket
from cobot.clock import SYSTEM
from cobot.errors import UnavailableError
from cobot.teleop.hand import JogVelocity
from cobot.teleop.teleop import Teleoperation

SIDE_S = 0.5
SIDES = ((0.0, 1.0), (-1.0, 0.0), (0.0, -1.0), (1.0, 0.0))


class Square:
    """A `cobot.teleop.hand.HandDevice`."""

    def __init__(self) -> None:
        self._begun_s = SYSTEM.now_s()

    def read_velocity(self, now_s: float) -> JogVelocity | None:
        """Return the requested velocity along and about x, y and z, as shares of the maximum velocity."""
        side = int((now_s - self._begun_s) / SIDE_S)
        if side >= len(SIDES):
            return None
        x, y = SIDES[side]
        return JogVelocity(twist=(x, y, 0.0, 0.0, 0.0, 0.0))

    @property
    def ended(self) -> bool:
        return SYSTEM.now_s() > self._begun_s + SIDE_S * (len(SIDES) + 1)

    def close(self) -> None:
        """Nothing to close."""


url = os.environ.get("COBOT_URL", "http://localhost:8007")
try:
    with Client(url) as robot:
        robot.move_named("work", speed=0.5)
        with open_socket(url, token_from_environment(), True) as socket:
            Teleoperation(socket, Square(), 0.4, print).run()  # prints when the velocity is limited, and why
        place = robot.pose()["position"]
        print(f"at rest at x {place['x']:.3f} m, y {place['y']:.3f} m")
except UnavailableError as exc:
    sys.exit(f"own_hand.py: {exc}; `make run` starts a service, COBOT_URL says where another one is")
