"""ROS topics for Lua programs, through the service's rosbridge. The vendor's manual calls this `ros_bind`.

Source of the protocol: https://github.com/RobotWebTools/rosbridge_suite/blob/ros2/ROSBRIDGE_PROTOCOL.md
"""

from __future__ import annotations

import contextlib
import json
import threading
from collections import deque
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect

from cobot.client.tls import tls_context, token_from_environment
from cobot.errors import CobotError, InputError, UnavailableError
from cobot.ros.codec import without_nan
from cobot.ros.messages import Messages
from cobot.runner.lua_sandbox import ProgramWatch
from cobot.runner.lua_values import kind, number, plain, text

PATH = "/rosbridge"
ANSWER_S = 10.0
KEEP_LAST = 10
MAX_ENDPOINTS = 256
DEEPEST_QUEUE = 10_000
BIGGEST_MESSAGE = 64 << 20

STRING = "std_msgs/msg/String"
_NUMBERS = ["Float32", "Float64", *(f"{sign}nt{bits}" for sign in ("I", "UI") for bits in (8, 16, 32, 64))]
ATOMS = {f"std_msgs/msg/{name}" for name in ("Bool", "Byte", "Char", "String", *_NUMBERS)}
"""Types of messages that contain one value. A program sees such a message as that value."""


@dataclass(slots=True)
class _Endpoint:
    """A topic that the program has opened.

    Attributes:
        received: messages that have arrived; None for a publisher.
    """

    topic: str
    type: str
    received: deque[Any] | None = None
    closed: bool = False


@dataclass(slots=True)
class _Answers:
    """The service's answers, by the ids of the requests."""

    responses: dict[str, Any] = field(default_factory=dict)
    complaints: dict[str, str] = field(default_factory=dict)


class RosBridge:
    """A rosbridge client that connects when it is first needed.

    Raises (every method):
        Stopping: the program must end.
        InputError: an argument is invalid; the message gives the reason.
        UnavailableError: there is no connection, or it was closed.
    """

    def __init__(self, url: str, watch: ProgramWatch) -> None:
        """
        Args:
            url: root of the service.
        """
        parts = urlsplit(url)
        self._url = f"{'wss' if parts.scheme == 'https' else 'ws'}://{parts.netloc}{PATH}"
        self._watch = watch
        self._messages = Messages()
        self._connection: ClientConnection | None = None
        self._open_connection = contextlib.ExitStack()
        self._problem = ""
        self._endpoints: dict[int, _Endpoint] = {}
        self._answers = _Answers()
        self._asked = 0

    def close(self) -> None:
        """End the connection, and with it all publishers and subscriptions."""
        with contextlib.suppress(WebSocketException, OSError):
            self._open_connection.close()

    def advertise(self, topic: object = None, type_: object = None, keep_last: object = None) -> int:
        """Open a topic for writing, and return its handle."""
        endpoint = self._new_endpoint(topic, type_)
        self._depth(keep_last)  # only checked, because a single ordered connection keeps all messages
        return self._open(endpoint, {"op": "advertise"})

    def subscribe(self, topic: object = None, type_: object = None, keep_last: object = None) -> int:
        """Open a topic for reading, and return its handle. The newest `keep_last` unread messages are
        kept.
        """
        endpoint = self._new_endpoint(topic, type_)
        depth = self._depth(keep_last)
        endpoint.received = deque(maxlen=depth)
        return self._open(endpoint, {"op": "subscribe", "queue_length": depth})

    def publish(self, handle: int, value: object = None) -> bool:
        """Publish a value, or a message that is given as its CDR bytes. Returns True."""
        endpoint = self._endpoint(handle)
        self._send({"op": "publish", "topic": endpoint.topic, "msg": self._message(endpoint.type, value)})
        return True

    def take(self, handle: int, timeout_ms: object = None) -> tuple[bool, Any]:
        """The oldest unread message as (True, value), or (False, None) after the timeout.

        Args:
            timeout_ms: timeout in ms; with None, the call waits forever.
        """
        endpoint = self._endpoint(handle)
        received = endpoint.received
        assert received is not None  # sandbox.lua calls `take` only for subscribers
        timeout_s = None if timeout_ms is None else number(timeout_ms, "the timeout in ms", 0.0, 1e9) / 1000.0
        self._watch.wait(lambda: bool(received) or bool(self._problem), timeout_s)
        if received:
            return True, self._value(endpoint.type, received.popleft())
        self._require_connection()
        return False, None

    def finish(self, handle: int) -> None:
        """Close a topic. This may be called again."""
        endpoint = self._endpoints[handle]
        if not endpoint.closed:
            endpoint.closed = True
            op = "unadvertise" if endpoint.received is None else "unsubscribe"
            self._send({"op": op, "topic": endpoint.topic, "id": f"lua:{handle}"})

    def _new_endpoint(self, topic: object, type_: object) -> _Endpoint:
        if sum(not endpoint.closed for endpoint in self._endpoints.values()) >= MAX_ENDPOINTS:
            raise InputError(f"{MAX_ENDPOINTS} publishers and subscribers are open, which is the maximum")
        return _Endpoint(
            text(topic, "the topic"), self._messages.resolved(text(type_, "the message type"), "msg")
        )

    def _depth(self, keep_last: object) -> int:
        return KEEP_LAST if keep_last is None else int(number(keep_last, "keep_last", 1, DEEPEST_QUEUE))

    def _endpoint(self, handle: int) -> _Endpoint:
        endpoint = self._endpoints[handle]
        if endpoint.closed:
            raise InputError(f"{endpoint.topic} was closed")
        return endpoint

    def _open(self, endpoint: _Endpoint, request: dict[str, Any]) -> int:
        """Send a request, and wait until it has been processed. The answer to a later request confirms
        this.
        """
        handle = len(self._endpoints) + 1
        self._endpoints[handle] = endpoint
        name = f"lua:{handle}"
        try:
            self._send({**request, "id": name, "topic": endpoint.topic, "type": endpoint.type})
            self._call("/rosapi/get_time")
        except CobotError:
            endpoint.closed = True
            raise
        complaint = self._answers.complaints.pop(name, "")
        if complaint:
            endpoint.closed = True
            raise InputError(complaint)
        return handle

    def _call(self, service: str) -> None:
        self._asked += 1
        name = f"call:{self._asked}"
        self._send({"op": "call_service", "id": name, "service": service, "args": {}})
        answered = self._watch.wait(
            lambda: name in self._answers.responses or bool(self._problem), timeout_s=ANSWER_S
        )
        self._require_connection()
        if not answered:
            raise UnavailableError(f"{self._url} did not answer within {ANSWER_S:g} s")
        del self._answers.responses[name]

    def _send(self, message: dict[str, Any]) -> None:
        if self._connection is None:
            self._connect()
        self._require_connection()
        assert self._connection is not None
        try:
            self._connection.send(json.dumps(without_nan(message)))
        except (WebSocketException, OSError) as exc:
            raise UnavailableError(f"{self._url}: {exc}") from exc

    def _connect(self) -> None:
        try:
            token = token_from_environment()
            self._connection = self._open_connection.enter_context(
                connect(
                    self._url,
                    ssl=tls_context(True) if self._url.startswith("wss:") else None,
                    additional_headers={"Authorization": f"Bearer {token}"} if token else None,
                    open_timeout=ANSWER_S,
                    max_size=BIGGEST_MESSAGE,
                    proxy=None,
                    close_timeout=0.2,
                )
            )
        except (WebSocketException, OSError, ValueError) as exc:
            raise UnavailableError(f"{self._url}: {exc}") from exc
        threading.Thread(
            target=self._receive, args=(self._connection,), name="rosbridge", daemon=True
        ).start()

    def _require_connection(self) -> None:
        if self._problem:
            raise UnavailableError(self._problem)

    def _receive(self, connection: ClientConnection) -> None:
        try:
            for raw in connection:
                self._handle(json.loads(raw))
            self._problem = f"{self._url}: the connection was closed"
        except (WebSocketException, OSError, ValueError) as exc:
            self._problem = f"{self._url}: {exc}"
        self._watch.wake()

    def _handle(self, message: dict[str, Any]) -> None:
        match message.get("op"):
            case "publish":
                for endpoint in tuple(self._endpoints.values()):
                    if endpoint.received is not None and endpoint.topic == message["topic"]:
                        endpoint.received.append(message["msg"])
            case "service_response":
                self._answers.responses[str(message.get("id"))] = message
            case "status" if message.get("level") == "error":
                self._answers.complaints[str(message.get("id"))] = str(message.get("msg"))
        self._watch.wake()

    def _message(self, type_: str, value: object) -> Any:
        if type_ not in ATOMS:
            if not isinstance(value, bytes):
                raise InputError(f"a {type_} must be a string with its CDR, got {kind(value)}")
            return self._messages.from_cdr(type_, value)
        data = text(value, f"a {type_}") if type_ == STRING else plain(value, f"a {type_}")
        if isinstance(data, list | dict):  # an empty list would be treated as a missing field, and so as 0
            raise InputError(f"a {type_} must be one value, got {kind(value)}")
        return self._messages.checked(type_, {"data": data})

    def _value(self, type_: str, message: Any) -> Any:
        if type_ not in ATOMS:
            return self._messages.to_cdr(type_, message)
        data = self._messages.checked(type_, message)["data"]
        return data.encode() if type_ == STRING else data
