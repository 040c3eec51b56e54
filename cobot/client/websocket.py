"""Connection of a `Robot` to an rtloop on another computer, through the service's WebSocket."""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from websockets.exceptions import InvalidStatus, WebSocketException
from websockets.sync.client import ClientConnection, connect

from cobot.addresses import check_url, path_at
from cobot.client.connection import ERRORS
from cobot.client.tls import Verify, tls_context, token_from_environment, token_header
from cobot.client.wire import PATH, FrameKind, packed, record
from cobot.clock import SYSTEM, Clock
from cobot.errors import CobotError, InputError, LayoutError, UnavailableError
from cobot.ipc.layout import info_dtype
from cobot.ipc.state_fields import LAYOUT_VERSION

STALE_S = 0.5
"""Maximum age of a usable state, in seconds. It is larger than for a robot on this computer."""
ANSWER_S = 6.0
"""Timeout for an answer, in seconds. The service itself waits for rtloop before it answers."""
CONNECT_S = 5.0
STATE_RATE_HZ = 500
PING_S = 5.0
Result = TypeVar("Result")


class WebSocketTransport:
    """The `cobot.client.transport.Transport` that uses a network. A separate thread receives the newest
    state.

    The service does not answer targets. If a target is wrong, the next call that sends a target raises the
    error.

    Args:
        url: URL of the robot's service: http://HOST:PORT, or http://HOST:PORT/robots/NAME for one of several.
        token, verify: see `cobot.client.Client`.

    Raises:
        UnavailableError: the service or its rtloop does not answer.
        InputError: the URL is invalid.
        LayoutError: the version of cobot in the service differs.
    """

    def __init__(
        self, url: str, clock: Clock = SYSTEM, *, token: str | None = None, verify: Verify = True
    ) -> None:
        self.clock = clock
        self.url = url.rstrip("/")
        self._connection = open_socket(self.url, token or token_from_environment(), verify)
        self._changed = threading.Condition()
        self._sequence_turn = threading.Lock()
        self._sequence = 0
        self._hello: dict[str, Any] = {}
        self._newest = b""
        self._newest_s = -np.inf
        self._session: int | None = None  # set when there is an answer
        self._error: CobotError | None = None
        self._lost = ""
        threading.Thread(target=self._listen, name="cobot-stream", daemon=True).start()
        try:
            hello = self._wait(lambda: self._hello or None, "said hello")
            if hello["layout"] != LAYOUT_VERSION:
                raise LayoutError(
                    f"{url}: the service has layout version {hello['layout']}, but this program has "
                    f"{LAYOUT_VERSION}; use the service's version of cobot"
                )
            self.robot, self.dof = str(hello["robot"]), int(hello["dof"])
            self._send(json.dumps({"type": "subscribe", "rate_hz": STATE_RATE_HZ, "format": "binary"}))
            self._wait(lambda: self._newest or None, "sent a state of rtloop")
        except CobotError:
            self.close()
            raise

    @property
    def info(self) -> np.ndarray:
        return _info(self._hello, self.dof)

    def state(self) -> np.ndarray:
        age_s = self.clock.now_s() - self._newest_s
        if self._lost or age_s > STALE_S:
            raise UnavailableError(f"{self.url}: {self._lost or f'no state of rtloop for {age_s:.1f} s'}")
        return record(self._newest, self.dof)

    def open_session(self, request: np.ndarray) -> int:
        self._session = self._error = None
        self._send(packed(FrameKind.SESSION, 0, request))
        number = self._wait(self._session_or_error, "answered")
        answered_s = self.clock.now_s()
        # The service saw a state of the session before it answered, so the next state also belongs to the
        # session.
        self._wait(lambda: self._newest_s > answered_s or None, "sent a state of the session")
        self._sequence = 0
        return number

    def send_setpoint(self, setpoint: np.ndarray) -> None:
        self._send_next(FrameKind.SETPOINT, setpoint)

    def send_chunk(self, chunk: np.ndarray) -> None:
        self._send_next(FrameKind.CHUNK, chunk)

    def request_estop(self) -> None:
        self._send(packed(FrameKind.ESTOP, 0))

    def end_session(self) -> None:
        if self._session is not None:
            self._session = None
            if not self._lost:  # otherwise the service ends the session
                self._send(packed(FrameKind.END, 0))

    def close(self) -> None:
        with contextlib.suppress(UnavailableError):  # without a connection, the service also ends it
            self.end_session()
        self._connection.close()

    def _send_next(self, kind: FrameKind, content: np.ndarray) -> None:
        self._raise_error()
        with self._sequence_turn:
            self._sequence += 1
            self._send(packed(kind, self._sequence, content))

    def _send(self, frame: str | bytes) -> None:
        try:
            self._connection.send(frame)
        except (WebSocketException, OSError) as exc:
            raise UnavailableError(f"{self.url}: the connection is lost: {exc}") from exc

    def _listen(self) -> None:
        try:
            while True:
                frame = self._connection.recv()
                if isinstance(frame, bytes):
                    self._newest, self._newest_s = frame, self.clock.now_s()
                else:
                    self._take_answer(json.loads(frame))
                with self._changed:
                    self._changed.notify_all()
        except (WebSocketException, OSError, ValueError, KeyError) as exc:
            self._lost = f"the connection is lost: {exc}"
        with self._changed:
            self._changed.notify_all()

    def _take_answer(self, answer: dict[str, Any]) -> None:
        match answer["type"]:
            case "hello":
                self._hello = answer
            case "tool":
                self._hello = {
                    **self._hello,
                    "flange": answer["flange"],
                    "tool_version": answer["tool_version"],
                }
            case "session":
                self._session = int(answer["number"])
            case "session_ended":
                self._session = None
            case "error":
                self._error = ERRORS.get(answer["code"], CobotError)(answer["detail"])

    def _session_or_error(self) -> int | None:
        self._raise_error()
        return self._session

    def _raise_error(self) -> None:
        error, self._error = self._error, None
        if error is not None:
            raise error

    def _wait(self, condition: Callable[[], Result | None], what: str) -> Result:
        """Wait until the condition returns a value, and return it."""
        found: Result | None = None

        def is_met() -> bool:
            nonlocal found
            found = condition()
            return found is not None or bool(self._lost)

        with self._changed:
            self._changed.wait_for(is_met, ANSWER_S)
        if found is None:
            raise UnavailableError(
                f"{self.url}: {self._lost or f'the service has not {what} for {ANSWER_S:g} s'}"
            )
        return found


def open_socket(url: str, token: str | None, verify: Verify) -> ClientConnection:
    """Open a connection to /robot/stream.

    Raises:
        UnavailableError: the service does not answer.
        InputError: the URL is invalid.
        CobotError: the service rejects the connection, for example because permission is missing.
    """
    check_url(url)
    trusted = tls_context(verify) if url.startswith("https:") else None
    try:
        # proxy=None: motions must not go through the web proxy that the environment names.
        return connect(
            "ws" + url.removeprefix("http") + path_at(url, PATH),
            ssl=trusted,
            additional_headers=token_header(token),
            proxy=None,
            compression=None,  # compression takes more time than it saves for these floats
            open_timeout=CONNECT_S,
            close_timeout=1.0,
            ping_interval=PING_S,
            ping_timeout=PING_S,
        ).__enter__()  # otherwise websockets 17 uses it as an iterator; its exit only calls `close`
    except InvalidStatus as exc:
        answer = exc.response
        try:
            raise ERRORS[(content := json.loads(answer.body))["code"]](content["detail"]) from exc
        except (ValueError, KeyError, TypeError):
            raise UnavailableError(
                f"{url}: status {answer.status_code}, so this is not a stream of cobot; check the URL"
            ) from exc
    except (WebSocketException, OSError) as exc:
        raise UnavailableError(f"{url}: {str(exc) or type(exc).__name__}") from exc
    except ValueError as exc:
        raise InputError(f"url {url!r}: {exc}") from exc


def _info(hello: dict[str, Any], dof: int) -> np.ndarray:
    """Convert JSON back to a record of `cobot.ipc.layout.info_dtype`."""
    dtype = info_dtype(dof)
    info = np.zeros((), dtype)
    for name in dtype.names or ():
        info[name] = hello[name]
    return info
