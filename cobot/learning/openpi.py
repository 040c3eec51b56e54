"""Client of a policy server, over openpi's WebSocket protocol.

When the connection is open, the server sends one message that describes the server. Then it answers each
observation with a message that contains actions. Messages are MessagePack maps. An array is a map with the
keys `__ndarray__`, `data`, `dtype` and `shape`. A single numpy number is a map with the keys `__npgeneric__`,
`data` and `dtype`. A server that fails sends text and closes the connection.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Mapping
from typing import Any, Self, cast

import msgpack
import numpy as np
from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.frames import CloseCode
from websockets.sync.client import ClientConnection, connect

from cobot.errors import CobotError, ExecutionError, InputError, UnavailableError
from cobot.foreign import plain_text
from cobot.strict import shown

CONNECT_S = 10.0
MAX_ANSWER_BYTES = 64 << 20
"""Maximum size of a server's message, in bytes. A chunk of 100 actions with 32 numbers each takes 26 kB."""
PLAIN = "biufSU"
"""Kinds of numpy types whose values can be restored from their bytes alone."""
DTYPE = re.compile(f"[<>|=]?[{PLAIN}][0-9]{{1,9}}")
"""Valid names of these types. numpy accepts many more names, and parses some of them as Python code."""


def pack(message: Mapping[str, Any]) -> bytes:
    """Encode a message.

    Raises:
        InputError: the protocol cannot express a value.
    """
    try:
        return cast(bytes, msgpack.packb(message, default=_as_map))
    except (TypeError, ValueError, OverflowError) as exc:
        raise InputError(f"the observation cannot be sent: {exc}") from exc


def unpack(content: bytes) -> Any:
    """Decode a message.

    Raises:
        ExecutionError: the content is not a message.
    """
    try:
        return msgpack.unpackb(content, object_hook=_from_map)
    except (ValueError, TypeError, KeyError, OverflowError, msgpack.UnpackException) as exc:
        raise ExecutionError(
            f"the server has sent an invalid message of openpi's protocol: {plain_text(exc)}"
        ) from exc


def _as_map(value: object) -> object:
    if isinstance(value, (np.ndarray, np.generic)):
        if value.dtype.kind not in PLAIN:
            raise TypeError(f"the protocol cannot express an array of {value.dtype}")
        if isinstance(value, np.ndarray):
            return {
                b"__ndarray__": True,
                b"data": value.tobytes(),
                b"dtype": value.dtype.str,
                b"shape": value.shape,
            }
        return {b"__npgeneric__": True, b"data": value.item(), b"dtype": value.dtype.str}
    raise TypeError(f"the protocol cannot express a {type(value).__name__}")


def _from_map(value: dict[Any, Any]) -> Any:
    if b"__ndarray__" not in value and b"__npgeneric__" not in value:
        return value
    name, data = value[b"dtype"], value[b"data"]
    if not isinstance(name, str) or not DTYPE.fullmatch(name):
        raise ValueError(f"an array has the type {shown(name)}, which is not supported")
    dtype = np.dtype(name)
    if b"__ndarray__" in value:
        return np.frombuffer(data, dtype).reshape(value[b"shape"])
    if not isinstance(data, (str, bytes) if dtype.kind in "SU" else (bool, int, float)):
        raise TypeError(f"a number of {dtype} has the type {type(data).__name__}")
    with np.errstate(over="ignore"):  # the result is infinite, which is detected by its user
        return dtype.type(data)


class PolicyConnection:
    """A connection to a policy server.

    Attributes:
        address: address of the server.
        metadata: the message in which the server describes itself.

    Args:
        address: ws://HOST:PORT, or HOST:PORT.
        api_key: key for a server that requires one.
        timeout_s: time limit for an answer.

    Raises (constructor):
        InputError: the address is invalid.
        UnavailableError: no server answers there.
        ExecutionError: the server does not use this protocol.
    """

    def __init__(self, address: str, *, api_key: str | None = None, timeout_s: float = 30.0) -> None:
        self.address = address if address.startswith(("ws://", "wss://")) else f"ws://{address}"
        self._timeout_s = timeout_s
        self._headers = {"Authorization": f"Api-Key {api_key}"} if api_key else None
        self._connection: ClientConnection | None = None
        self.metadata: dict[str, Any] = {}
        with self._close_on_error():
            self._connect()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def infer(self, observation: Mapping[str, Any]) -> dict[str, Any]:
        """The policy's answer to an observation, including `actions`.

        After an error or `close`, the next call connects again, so that a late answer is never used for a
        later observation.

        Raises:
            InputError: the observation contains a value that cannot be sent.
            ExecutionError: the policy has failed; the message gives the last line of its reason.
            UnavailableError: the server is gone or does not answer in time.
        """
        content = pack(observation)
        with self._close_on_error():
            connection = self._connect()
            try:
                connection.send(content)
            except (WebSocketException, OSError) as exc:
                raise self._lost(exc) from exc
            answer = unpack(self._receive(connection, "answer"))
            if not isinstance(answer, dict):
                raise ExecutionError(f"{self.address}: the answer is a {type(answer).__name__}, not a map")
            return answer

    def close(self) -> None:
        """Close the connection. This may be called again."""
        connection, self._connection = self._connection, None
        if connection is not None:
            with contextlib.suppress(WebSocketException, OSError):
                connection.close()

    @contextlib.contextmanager
    def _close_on_error(self) -> Iterator[None]:
        """Context manager that closes the connection if an exchange is incomplete, even after Ctrl-C.
        Otherwise the remaining part could be mistaken for a later answer.
        """
        try:
            yield
        except BaseException:
            self.close()
            raise

    def _connect(self) -> ClientConnection:
        if self._connection is None:
            self._connection = self._open()
            metadata = unpack(self._receive(self._connection, "describe itself"))
            self.metadata = metadata if isinstance(metadata, dict) else {}
        return self._connection

    def _receive(self, connection: ClientConnection, what: str) -> bytes:
        try:
            content = connection.recv(self._timeout_s)
        except TimeoutError as exc:
            raise UnavailableError(
                f"{self.address}: the policy did not {what} within {self._timeout_s:g} s"
            ) from exc
        except (WebSocketException, OSError) as exc:
            raise self._lost(exc) from exc
        if isinstance(content, str):
            said = plain_text(content.rstrip().rpartition("\n")[2].strip()) or "no reason"
            raise ExecutionError(f"{self.address}: the policy has failed: {said}")
        return content

    def _lost(self, exc: Exception) -> CobotError:
        if isinstance(exc, ConnectionClosed) and exc.sent and exc.sent.code == CloseCode.MESSAGE_TOO_BIG:
            return ExecutionError(
                f"{self.address}: the policy's answer has more than {MAX_ANSWER_BYTES} bytes, the limit"
            )
        return UnavailableError(f"{self.address}: the connection is lost: {plain_text(exc)}")

    def _open(self) -> ClientConnection:
        try:
            return connect(
                self.address,
                additional_headers=self._headers,
                proxy=None,
                compression=None,
                max_size=MAX_ANSWER_BYTES,
                open_timeout=CONNECT_S,
                close_timeout=1.0,
                ping_interval=None,  # a busy server may not answer pings
            ).__enter__()  # otherwise websockets 17 treats it as an iterator; `close` replaces its exit
        except (WebSocketException, OSError) as exc:
            raise UnavailableError(f"{self.address}: {plain_text(exc) or type(exc).__name__}") from exc
        except ValueError as exc:
            raise InputError(f"address {self.address!r}: {exc}") from exc
