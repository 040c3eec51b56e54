"""The connection to the robot. It is established in small steps, and reports the reason if it is lost.

If the robot does not answer, libfranka blocks the whole interpreter, and with it the cycle, for a minute. So
its address is first checked in small steps.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import time
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from rtloop.backends import BackendError
from rtloop.backends.franka.words import explained, said

INSTALL = "pylibfranka is not installed: pip install 'cobot[franka]'"

PORT = 1337
"""Port of the Franka Control Interface."""
CONNECT_S = 3.0


class Knocking(Protocol):
    def await_answer(self, wait_s: float = 0.0) -> bool:
        """Whether the robot has answered yet.

        Raises:
            BackendError: the robot does not answer; the error gives the reason.
        """
        ...


class Knock:
    """A test connection to the robot's address, which is closed as soon as it is established."""

    def __init__(self, address: str) -> None:
        """Begin to connect.

        Raises:
            BackendError: the address is invalid, or there is no route to it.
        """
        self._address = address
        try:
            ((family, kind, _, _, place), *_) = socket.getaddrinfo(address, PORT, type=socket.SOCK_STREAM)
            self._socket = socket.socket(family, kind)
        except OSError as exc:
            raise self._no_answer(exc.strerror) from exc
        self._socket.setblocking(False)
        self._until_s = time.monotonic() + CONNECT_S
        self._socket.connect_ex(place)

    def await_answer(self, wait_s: float = 0.0) -> bool:
        poll = select.poll()
        poll.register(self._socket, select.POLLOUT)
        if not poll.poll(1e3 * wait_s):
            if time.monotonic() < self._until_s:
                return False
            self._socket.close()
            raise self._no_answer(f"the robot has not answered within {CONNECT_S:g} s")
        error = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        self._socket.close()
        if error:
            raise self._no_answer(os.strerror(error))
        return True

    def _no_answer(self, why: str | None) -> BackendError:
        return BackendError(
            f"cannot connect to {self._address}, port {PORT}: {why}; is the robot on, its cable in the "
            "control unit, and FCI activated in Desk?"
        )


class Link:
    """The connection to one robot.

    Attributes:
        library: pylibfranka.
        robot: pylibfranka's `Robot`; None while it is not connected.
        control: the active control; None while no control is active.
        lost: reason for the loss of the connection; "" while it is open.
    """

    def __init__(self, address: str, realtime: str, library: Any, knock: Callable[[str], Knocking]) -> None:
        """
        Args:
            library: None for the installed pylibfranka.
        """
        self.library: Any = library or _installed()
        self._address, self._realtime, self._knock = address, realtime, knock
        self._knocking: Knocking | None = None
        self.robot: Any = None
        self.control: Any = None
        self.lost = ""

    def is_open(self, wait_s: float = 0.0) -> bool:
        """Whether the connection is open. If it is not, try for at most `wait_s` to open it.

        Raises:
            BackendError: the address does not answer, or is not a robot.
        """
        if self.robot is not None:
            return True
        knocking = self._knocking or self._knock(self._address)
        self._knocking = None
        if not knocking.await_answer(wait_s):
            self._knocking = knocking
            return False
        kinds = self.library.RealtimeConfig
        with self.in_words():
            kind = kinds.kEnforce if self._realtime == "enforce" else kinds.kIgnore
            self.robot = self.library.Robot(self._address, kind)
        self.lost = ""
        return True

    @contextlib.contextmanager
    def in_words(self) -> Iterator[None]:
        """Translate libfranka's exceptions to cobot's. An exception means that the control has ended."""
        library = self.library
        try:
            yield
        except library.ControlException as exc:
            self.control = None
            raise BackendError(f"the robot has stopped: {explained(said(exc))}") from exc
        except library.NetworkException as exc:
            self.control = self.robot = None
            self.lost = f"the connection to {self._address} is lost: {said(exc)}"
            raise BackendError(self.lost) from exc
        except library.RealtimeException as exc:
            raise BackendError(
                f"{said(exc)}; use a kernel with PREEMPT_RT, or set robot.backend.realtime: ignore"
            ) from exc
        except (library.CommandException, library.InvalidOperationException, library.FrankaException) as exc:
            self.control = None
            raise BackendError(f"the robot rejects the command: {explained(said(exc))}") from exc


def _installed() -> Any:
    try:
        import pylibfranka
    except ImportError as exc:
        raise BackendError(INSTALL) from exc
    return pylibfranka
