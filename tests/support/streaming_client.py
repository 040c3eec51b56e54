"""A client of /robot/stream that knows nothing of ours: `websockets`, `json` and `struct`."""

from __future__ import annotations

import json
import struct
from typing import Any, Self

from cobot_run import WAIT_S
from websockets.sync.client import ClientConnection, connect


class Frames:
    """What is said on one connection; states that come in between are skipped when an answer is waited for.

    Args:
        socket: has `send`, `recv` and `close`.
    """

    def __init__(self, socket: Any) -> None:
        self.socket = socket
        self.hello = json.loads(self.socket.recv(WAIT_S))
        self.number = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def send(self, kind: str, **content: object) -> None:
        self.socket.send(json.dumps({"type": kind, **content}))

    def target(self, joints: object, **content: object) -> None:
        self.number += 1
        self.send("target", sequence=self.number, joints=list(joints), **content)  # type: ignore[call-overload]

    def binary(self, kind: int, sequence: int, record: bytes = b"", layout: int | None = None) -> None:
        version = self.hello["layout"] if layout is None else layout
        self.socket.send(struct.pack("<IIQ", kind, version, sequence) + record)

    def until_closed(self) -> None:
        """Read until there is nothing more, which the socket raises."""
        while True:
            self.socket.recv(WAIT_S)

    def answer(self) -> dict[str, Any]:
        """The next text frame that is no state."""
        while True:
            frame = self.socket.recv(WAIT_S)
            if isinstance(frame, str) and (content := json.loads(frame))["type"] != "state":
                return content

    def state(self) -> dict[str, Any]:
        """The next state in JSON."""
        while True:
            frame = self.socket.recv(WAIT_S)
            if isinstance(frame, str) and (content := json.loads(frame))["type"] == "state":
                return content

    def session(self, **fields: object) -> int:
        """Begin a session; its number."""
        self.send("session", **fields)
        answer = self.answer()
        assert answer["type"] == "session", answer
        return answer["number"]

    def ended(self) -> dict[str, Any]:
        """End the session; the last answer, errors skipped."""
        self.send("end")
        return self.until_ended()

    def until_ended(self) -> dict[str, Any]:
        while (answer := self.answer())["type"] != "session_ended":
            pass
        return answer


class StreamClient(Frames):
    """Over the network."""

    socket: ClientConnection

    def __init__(self, url: str, path: str = "/robot/stream", **options: Any) -> None:
        address = f"ws{url.removeprefix('http')}{path}"
        super().__init__(
            connect(address, proxy=None, compression=None, close_timeout=0.5, legacy=True, **options)
        )
