"""The command `cobot teleop`."""

from __future__ import annotations

import argparse
import sys

from websockets.exceptions import WebSocketException

from cobot.addresses import address
from cobot.client.tls import token_from_environment
from cobot.client.websocket import open_socket
from cobot.commands.options import url_of
from cobot.errors import UnavailableError
from cobot.teleop.gamepad import Gamepad
from cobot.teleop.hand import HandDevice
from cobot.teleop.keyboard import HELP, Keyboard
from cobot.teleop.teleop import Teleoperation

ANSWER_S = 5.0
PAD_HELP = (
    "hold a shoulder button to move, the left one for half speed; A: switch between base and tool; start: end"
)


class _Answering:
    """A connection with a timeout for each answer."""

    def __init__(self, url: str, chosen: argparse.Namespace) -> None:
        self._url = url
        verify = True if chosen.certificate is None else chosen.certificate
        self._connection = open_socket(url, chosen.token or token_from_environment(), verify)

    def send(self, frame: str) -> None:
        try:
            self._connection.send(frame)
        except (WebSocketException, OSError) as exc:
            raise UnavailableError(f"{self._url}: the connection is lost: {exc}") from exc

    def recv(self) -> str | bytes:
        try:
            return self._connection.recv(ANSWER_S)
        except TimeoutError as exc:
            raise UnavailableError(f"{self._url}: no answer for {ANSWER_S:g} s") from exc
        except (WebSocketException, OSError) as exc:
            raise UnavailableError(f"{self._url}: the connection is lost: {exc}") from exc

    def close(self) -> None:
        self._connection.close()


def teleop(chosen: argparse.Namespace) -> None:
    """Control an arm with an input device until the user quits.

    Raises:
        InputError: the device does not exist, or the speed is invalid.
        UnavailableError: the service does not answer, or the device is gone.
    """
    url = url_of(chosen)
    socket = _Answering(address(url, chosen.robot) if chosen.robot else url, chosen)
    try:
        device = _device(chosen)
        try:
            print(HELP if chosen.gamepad is None else PAD_HELP, flush=True)
            Teleoperation(socket, device, chosen.speed, _say).run()
        finally:
            device.close()
    finally:
        socket.close()


def _device(chosen: argparse.Namespace) -> HandDevice:
    if chosen.gamepad is None:
        return Keyboard()
    return Gamepad(chosen.gamepad if chosen.gamepad.name else None)


def _say(line: str) -> None:
    print(f"\r\x1b[K{line}", end="", file=sys.stderr, flush=True)
