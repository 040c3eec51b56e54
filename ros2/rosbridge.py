"""The client side of rosbridge v2, as the gateway needs it: a connection to the service, made anew when lost.

What is sent goes through one bounded queue, so messages of a topic keep their order. Nothing waits for ever:
a call ends with its answer, with the connection, or is refused at once.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import logging
from collections import deque
from collections.abc import AsyncIterator, Callable
from typing import Any

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from cobot.client.tls import tls_context
from cobot.errors import ExecutionError, UnavailableError
from cobot.ros.codec import without_nan

Message = dict[str, Any]
PATH = "/rosbridge"
MAX_WAITING = 20_000
MAX_CHARACTERS = 64 << 20
"""So many characters may wait to be sent."""
MAX_CALLS = 240
"""So many calls are under way at a time: the service takes 256 of one client."""
MAX_RECEIVED = 64 << 20
FIRST_RETRY_S = 0.05
LAST_RETRY_S = 1.0
OPEN_S = 20.0
PING_S = 3.0
"""A service that answers no ping for so long is away."""
AWAY = "the service of cobot is away; cobot run restarts it"
LOST = "the connection to the service was lost during the call: whether it was done is not known"

log = logging.getLogger("cobot.ros2")


class Rosbridge:
    """A connection to the service that comes back by itself.

    Args:
        url: of the service, "http://localhost:8007".
        on_open: called with each new connection, before anything else is sent on it.
        on_message: called with (topic, message) of what was subscribed.
        token: by which the service knows this process.
    """

    def __init__(
        self,
        url: str,
        on_open: Callable[[], None],
        on_message: Callable[[str, Message], None],
        token: str = "",
    ) -> None:
        self._headers = {"Authorization": f"Bearer {token}"} if token else None
        self._trusted = tls_context(True) if url.startswith("https:") else None
        self._url = "ws" + url.removeprefix("http") + PATH
        self._on_open = on_open
        self._on_message = on_message
        self._queue: deque[str] = deque()
        self._characters = 0
        self._wake = asyncio.Event()
        self._open = False
        self._calls: dict[str, asyncio.Future[Message]] = {}
        self._numbers = itertools.count(1)

    async def run(self) -> None:
        """Stay connected, until cancelled."""
        pause_s = FIRST_RETRY_S
        told = False
        while True:
            try:
                async with self._connected() as socket:
                    log.info("connected to the service")
                    pause_s, told = FIRST_RETRY_S, False
                    await self._serve(socket)
            except (OSError, WebSocketException, TimeoutError) as exc:
                if not told:
                    log.warning("no connection to the service: %s", exc)
                told = True
            await asyncio.sleep(pause_s)
            pause_s = min(2.0 * pause_s, LAST_RETRY_S)

    def send(self, content: Message) -> bool:
        """Have something sent, if the service is there and keeps up; whether that was so."""
        try:
            text = json.dumps(content, allow_nan=False)
        except ValueError:
            text = json.dumps(without_nan(content))
        full = len(self._queue) >= MAX_WAITING or self._characters + len(text) > MAX_CHARACTERS
        if not self._open or full:
            return False
        self._queue.append(text)
        self._characters += len(text)
        self._wake.set()
        return True

    async def call(self, service: str, request: Message) -> Message:
        """Call a service.

        Raises:
            UnavailableError: the service of cobot is away, goes away, or has too much to do.
            ExecutionError: the call was refused, with the reason.
        """
        if len(self._calls) >= MAX_CALLS:
            raise UnavailableError(f"{MAX_CALLS} calls over ROS 2 are under way already")
        number = f"call:{next(self._numbers)}"
        answer: asyncio.Future[Message] = asyncio.get_running_loop().create_future()
        self._calls[number] = answer
        try:
            if not self.send({"op": "call_service", "id": number, "service": service, "args": request}):
                raise UnavailableError(AWAY)
            return await answer
        finally:
            del self._calls[number]

    @contextlib.asynccontextmanager
    async def _connected(self) -> AsyncIterator[ClientConnection]:
        async with connect(
            self._url,
            ssl=self._trusted,
            additional_headers=self._headers,
            compression=None,
            max_size=MAX_RECEIVED,
            open_timeout=OPEN_S,
            close_timeout=1.0,
            ping_interval=PING_S,
            ping_timeout=PING_S,
            proxy=None,
        ) as socket:
            self._open = True
            try:
                self._on_open()
                yield socket
            finally:
                self._open = False
                self._queue.clear()
                self._characters = 0
                for answer in self._calls.values():
                    if not answer.done():
                        answer.set_exception(UnavailableError(LOST))

    async def _serve(self, socket: ClientConnection) -> None:
        sending = asyncio.create_task(self._send_all(socket))
        try:
            async for text in socket:
                self._take(json.loads(text))
        finally:
            sending.cancel()
            with contextlib.suppress(asyncio.CancelledError, WebSocketException):
                await sending

    async def _send_all(self, socket: ClientConnection) -> None:
        while True:
            await self._wake.wait()
            self._wake.clear()
            while self._queue:
                text = self._queue.popleft()
                self._characters -= len(text)
                await socket.send(text)

    def _take(self, content: Message) -> None:
        match content["op"]:
            case "publish":
                self._on_message(content["topic"], content["msg"])
            case "service_response":
                self._answer(content["id"], content["values"], refused=not content["result"])
            case "status" if content.get("id") in self._calls:
                self._answer(content["id"], content["msg"], refused=True)
            case "status":
                log.warning("the service says: %s", content["msg"])

    def _answer(self, number: str, values: Any, *, refused: bool) -> None:
        answer = self._calls.get(number)
        if answer is None or answer.done():
            return
        if refused:
            answer.set_exception(ExecutionError(str(values)))
        else:
            answer.set_result(values)
