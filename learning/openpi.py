"""A policy that a server computes, over openpi's WebSocket protocol.

On connecting the server sends one message that describes it; from then on each message with an observation
is answered by one with actions. Messages are MessagePack maps; an array is a map of the keys
`__ndarray__`, `data`, `dtype` and `shape`, a single number of numpy one of `__npgeneric__`, `data` and
`dtype`. A server that fails sends text and closes.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any, Self, cast

import msgpack
import numpy as np
from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect

from cobot.errors import ExecutionError, InputError, UnavailableError

CONNECT_S = 10.0
PLAIN = "biufSU"
"""Kinds of numpy's types whose bytes say everything."""


def packed(message: Mapping[str, Any]) -> bytes:
    """A message as bytes.

    Raises:
        InputError: something in it has no form in this protocol.
    """
    try:
        return cast(bytes, msgpack.packb(message, default=_as_map))
    except (TypeError, ValueError, OverflowError) as exc:
        raise InputError(f"the observation cannot be sent: {exc}") from exc


def unpacked(content: bytes) -> Any:
    """The message that bytes are.

    Raises:
        ExecutionError: they are none.
    """
    try:
        return msgpack.unpackb(content, object_hook=_from_map)
    except (ValueError, TypeError, KeyError, msgpack.UnpackException) as exc:
        raise ExecutionError(f"the server has sent what is no message of openpi's protocol: {exc}") from exc


def _as_map(value: object) -> object:
    if isinstance(value, (np.ndarray, np.generic)):
        if value.dtype.kind not in PLAIN:
            raise TypeError(f"an array of {value.dtype} has no form in this protocol")
        if isinstance(value, np.ndarray):
            return {
                b"__ndarray__": True,
                b"data": value.tobytes(),
                b"dtype": value.dtype.str,
                b"shape": value.shape,
            }
        return {b"__npgeneric__": True, b"data": value.item(), b"dtype": value.dtype.str}
    raise TypeError(f"{type(value).__name__} has no form in this protocol")


def _from_map(value: dict[Any, Any]) -> Any:
    if b"__ndarray__" in value or b"__npgeneric__" in value:
        dtype = np.dtype(value[b"dtype"])
        if dtype.kind not in PLAIN:
            raise ValueError(f"an array of {dtype}")
        if b"__ndarray__" in value:
            return np.frombuffer(value[b"data"], dtype).reshape(value[b"shape"])
        return dtype.type(value[b"data"])
    return value


class PolicyConnection:
    """A connection to a policy's server.

    Attributes:
        address: of the server.
        metadata: what it says of itself.

    Args:
        address: ws://HOST:PORT, or HOST:PORT.
        api_key: for a server that asks for one.
        timeout_s: an answer is waited for so long.

    Raises (constructor):
        InputError: that is no address.
        UnavailableError: nobody answers there.
        ExecutionError: what answers speaks something else.
    """

    def __init__(self, address: str, *, api_key: str | None = None, timeout_s: float = 30.0) -> None:
        self.address = address if address.startswith(("ws://", "wss://")) else f"ws://{address}"
        self._timeout_s = timeout_s
        self._connection = self._open(api_key)
        try:
            metadata = unpacked(self._receive("describe itself"))
        except Exception:
            self.close()
            raise
        self.metadata: dict[str, Any] = metadata if isinstance(metadata, dict) else {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def infer(self, observation: Mapping[str, Any]) -> dict[str, Any]:
        """What the policy answers to an observation, `actions` among it.

        Raises:
            InputError: the observation has something in it that cannot be sent.
            ExecutionError: the policy has failed, with the last line of its reason.
            UnavailableError: the server has gone, or does not answer in time.
        """
        content = packed(observation)
        try:
            self._connection.send(content)
        except (WebSocketException, OSError) as exc:
            raise UnavailableError(f"{self.address}: the connection is lost: {exc}") from exc
        answer = unpacked(self._receive("answer"))
        if not isinstance(answer, dict):
            raise ExecutionError(f"{self.address}: the answer is {type(answer).__name__}, and no map")
        return answer

    def close(self) -> None:
        """May be called again."""
        with contextlib.suppress(WebSocketException, OSError):
            self._connection.close()

    def _receive(self, what: str) -> bytes:
        try:
            content = self._connection.recv(self._timeout_s)
        except TimeoutError as exc:
            raise UnavailableError(
                f"{self.address}: the policy did not {what} within {self._timeout_s:g} s"
            ) from exc
        except (WebSocketException, OSError) as exc:
            raise UnavailableError(f"{self.address}: the connection is lost: {exc}") from exc
        if isinstance(content, str):
            lines = [line for line in content.splitlines() if line.strip()]
            said = lines[-1] if lines else "no reason"
            raise ExecutionError(f"{self.address}: the policy has failed: {said}")
        return content

    def _open(self, api_key: str | None) -> ClientConnection:
        headers = {"Authorization": f"Api-Key {api_key}"} if api_key else None
        try:
            return connect(
                self.address,
                additional_headers=headers,
                proxy=None,
                compression=None,
                max_size=None,
                open_timeout=CONNECT_S,
                close_timeout=1.0,
                ping_interval=None,  # a server that thinks may not answer pings meanwhile
            ).__enter__()  # or websockets 17 takes it for an iterator; `close` is all that the exit does
        except (WebSocketException, OSError) as exc:
            raise UnavailableError(f"{self.address}: {str(exc) or type(exc).__name__}") from exc
        except ValueError as exc:
            raise InputError(f"address {self.address!r}: {exc}") from exc
