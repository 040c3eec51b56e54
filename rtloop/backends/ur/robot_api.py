"""The Robot API of PolyScope X: requests over HTTP. It replaces the dashboard server, so `RobotApi` has the
same requests and answers as `Dashboard`.
"""

from __future__ import annotations

import json
from typing import Any

import h11

from rtloop.backends import BackendError
from rtloop.backends.ur.transport import ByteStream, UrTransport
from rtloop.backends.ur.words import LOCAL

PORT = 80
ROOT = "/universal-robots/robot-api"
MIN_VERSION = (10, 11)
"""First software version that provides the Robot API."""
REPLY_S = 5.0
MAX_BYTES = 65_536
STATE, PROGRAM, CONTROL_MODE = "/robotstate/v1/state", "/program/v1/state", "/system/v1/controlmode"
REQUESTS: dict[str, tuple[str, str, str]] = {
    "is in remote control": ("GET", CONTROL_MODE, ""),
    "unlock protective stop": ("PUT", STATE, "UNLOCK_PROTECTIVE_STOP"),
    "power on": ("PUT", STATE, "POWER_ON"),
    "brake release": ("PUT", STATE, "BRAKE_RELEASE"),
    "stop": ("PUT", PROGRAM, "stop"),
}
"""Method, path and action for each request to the dashboard server. Other requests are not needed."""
FORBIDDEN = 403
"""HTTP status of each action while the robot is in Local Control."""


class RobotApi:
    """Sends one request at a time, each over its own connection. No method waits: `poll` is called repeatedly
    until it returns the answer.
    """

    def __init__(self, transport: UrTransport, address: str, port: int) -> None:
        self._transport, self._address, self._port = transport, address, port
        self._stream: ByteStream | None = None
        self._http = h11.Connection(h11.CLIENT)
        self._request = ""
        self._is_sent = False
        self._status, self._body = 0, b""
        self._since_s = 0.0

    def ask(self, request: str) -> None:
        """Begin a request."""
        self.close()
        self._request, self._since_s = request, self._transport.clock()
        if request not in REQUESTS:
            return
        self._http, self._is_sent = h11.Connection(h11.CLIENT, max_incomplete_event_size=MAX_BYTES), False
        self._status, self._body = 0, b""
        try:
            self._stream = self._transport.connect(self._address, self._port)
        except OSError as exc:
            raise self._make_error(exc.strerror or str(exc)) from exc

    def poll(self) -> str | None:
        """Return the answer to the last request; None until it has arrived.

        Raises:
            BackendError: the controller does not answer or is in Local Control; the error gives the reason.
        """
        if self._request not in REQUESTS:
            return ""
        if self._stream is None:
            raise self._make_error("it is not connected")
        try:
            if self._exchange(self._stream):
                self.close()
                return self._answer()
        except OSError as exc:
            raise self._make_error(exc.strerror or str(exc)) from exc
        except (h11.RemoteProtocolError, ValueError) as exc:
            raise self._make_error(f"its answer is not valid: {exc}") from exc
        if self._transport.clock() - self._since_s > REPLY_S:
            raise self._make_error(f"no answer to {self._request!r} within {REPLY_S:g} s")
        return None

    def close(self) -> None:
        if self._stream is not None:
            self._stream.close()
        self._stream = None

    def _exchange(self, stream: ByteStream) -> bool:
        """Send the request and read the data that has arrived. Return whether the answer is complete."""
        if not self._is_sent:
            if not stream.is_connected():
                return False
            stream.send(self._message())
            self._is_sent = True
        try:
            received = stream.receive()
        except ConnectionResetError:
            self._http.receive_data(b"")  # the end of an answer without a length
        else:
            if not received:
                return False
            self._http.receive_data(received)
        while (event := self._http.next_event()) is not h11.NEED_DATA:
            if isinstance(event, h11.Response):
                self._status = event.status_code
            elif isinstance(event, h11.Data):
                self._body += bytes(event.data)
                if len(self._body) > MAX_BYTES:
                    raise ValueError(f"it is longer than {MAX_BYTES} bytes")
            elif isinstance(event, h11.EndOfMessage):
                return True
            elif isinstance(event, h11.ConnectionClosed):
                raise ConnectionResetError("it has closed the connection")
        return False

    def _message(self) -> bytes:
        method, path, action = REQUESTS[self._request]
        body = json.dumps({"action": action}).encode() if action else b""
        headers = [("Host", self._address), ("Accept", "application/json"), ("Connection", "close")]
        if body:
            headers += [("Content-Type", "application/json"), ("Content-Length", str(len(body)))]
        events = (
            h11.Request(method=method, target=ROOT + path, headers=headers),
            *((h11.Data(data=body),) if body else ()),
            h11.EndOfMessage(),
        )
        return b"".join(self._http.send(event) or b"" for event in events)

    def _answer(self) -> str:
        """Return the answer in the form that the dashboard server uses."""
        content = _json_object(self._body)
        if self._status == FORBIDDEN:
            raise BackendError(LOCAL)
        if not 200 <= self._status < 300:
            said = " ".join(filter(None, (str(content.get(name, "")) for name in ("message", "details"))))
            return f"status {self._status}{' ' if said else ''}{said[:300]}"
        if self._request == "is in remote control":
            mode = str(content.get("mode", ""))
            if mode not in ("LOCAL", "REMOTE"):
                raise self._make_error(f"its control mode is {mode[:50]!r}; it must be LOCAL or REMOTE")
            return str(mode == "REMOTE").lower()
        return "releasing" if self._request == "unlock protective stop" else "done"

    def _make_error(self, why: str) -> BackendError:
        if self._stream is not None:
            self._stream.abort()
        self.close()
        return BackendError(
            f"the Robot API at {self._address}, port {self._port}: {why}. It needs PolyScope X "
            f"{'.'.join(map(str, MIN_VERSION))} or later. With robot.backend.dashboard: false, a person "
            "switches the arm on at the teach pendant"
        )


def _json_object(body: bytes) -> dict[str, Any]:
    try:
        found = json.loads(body) if body else {}
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}
