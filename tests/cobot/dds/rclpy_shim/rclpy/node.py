"""rclpy.node.Node, as far as the manual's client goes."""

from __future__ import annotations

import queue
import sys
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import rclpy
from rclpy.types import Message


class Node:
    def __init__(self, name: str) -> None:
        self._name = name

    def create_publisher(self, kind: type[Message], topic: str, depth: int) -> SimpleNamespace:
        made = rclpy.peer().publisher(topic, kind.TYPE, depth=depth)
        return SimpleNamespace(publish=lambda message: made.publish(message.to_dict()))

    def create_client(self, kind: Any, name: str) -> Client:
        return Client(kind, name)

    def get_clock(self) -> SimpleNamespace:
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=time.time_ns()))

    def get_logger(self) -> SimpleNamespace:
        def line(level: str) -> Callable[[str], None]:
            return lambda text: print(f"[{level}] [{self._name}]: {text}", file=sys.stderr)

        return SimpleNamespace(info=line("INFO"), warning=line("WARN"), error=line("ERROR"))

    def destroy_node(self) -> None: ...


class Client:
    def __init__(self, kind: Any, name: str) -> None:
        self._kind = kind
        self._client = rclpy.peer().client(name, kind.TYPE)

    def wait_for_service(self, timeout_sec: float) -> bool:
        deadline_s = time.monotonic() + timeout_sec
        while not self._client.ready():
            if time.monotonic() > deadline_s:
                return False
            time.sleep(0.01)
        return True

    def call_async(self, request: Message) -> Future:
        return Future(self._client.begin(request.to_dict()), self._kind.Response)


class Future:
    def __init__(self, reply: Callable[[float], dict[str, Any]], kind: type[Message]) -> None:
        self._reply, self._kind = reply, kind
        self._result: Message | None = None

    def wait(self, timeout_s: float | None) -> None:
        try:
            self._result = self._kind(**self._reply(timeout_s or 60.0))
        except queue.Empty:
            self._result = None

    def result(self) -> Message | None:
        return self._result
