"""Client of rosbridge v2 for the gateway: a connection to the service that is reopened when it is lost.

Messages of a topic keep their order; topics and services take turns, so that one topic cannot delay the
others. A message that is too large for the service is rejected here, because a frame that is too large closes
the connection for all clients. A call that is not rejected immediately ends when its answer arrives or when
the connection is lost.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import logging
from collections import Counter
from collections.abc import AsyncIterator, Callable
from typing import Any

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException

from cobot.client.tls import tls_context
from cobot.codes import ERROR_OF, Code
from cobot.dds.outgoing import Outgoing
from cobot.errors import UnavailableError
from cobot.ros.codec import without_nan
from cobot.ros.message_limits import check_message

Message = dict[str, Any]
PATH = "/rosbridge"
MAX_CALLS = 960
"""Maximum number of calls in progress. The service accepts 1024 from one client."""
MAX_CALLS_OF_CLIENT = 120
"""Maximum number of calls in progress for one ROS client, so that it cannot displace other clients."""
MAX_RECEIVED = 64 << 20
FIRST_RETRY_S = 0.05
LAST_RETRY_S = 1.0
OPEN_S = 20.0
PING_S = 3.0
"""Time without an answer to a ping after which the service is considered unavailable, s."""
AWAY = "the service of cobot is not connected; cobot run restarts it"
LOST = "the connection to the service was lost during the call: it is not known whether the call was executed"

log = logging.getLogger("cobot.ros2")


class Rosbridge:
    """A connection to the service. If the connection is lost, it is opened again automatically.

    Args:
        url: service address, such as "http://localhost:8007".
        on_open: called with each new connection, before anything else is sent on it.
        on_message: called with the topic and the message for each message of a subscription.
        token: identifies this process to the service.
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
        self._outgoing = Outgoing()
        self._wake = asyncio.Event()
        self._open = False
        self._calls: dict[str, asyncio.Future[Message]] = {}
        self._calls_of: Counter[bytes] = Counter()
        self._numbers = itertools.count(1)

    async def run(self) -> None:
        """Keep the connection open until this task is cancelled."""
        pause_s = FIRST_RETRY_S
        told = False
        while True:
            try:
                async with self._connect() as socket:
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
        """Queue a message if the service is connected and fast enough. Returns whether the message was
        queued.

        Raises:
            PayloadError: the message is too large for the service.
        """
        if not self._open:
            return False
        try:
            text = json.dumps(content, allow_nan=False)
        except ValueError:
            text = json.dumps(without_nan(content))
        check_message(text)
        queued = self._outgoing.put(str(content.get("topic") or content.get("service")), text)
        self._wake.set()
        return queued

    async def call(self, service: str, request: Message, client: bytes = b"") -> Message:
        """Call a service.

        Args:
            client: the caller, because the number of calls from one client is limited.

        Raises:
            UnavailableError: cobot's service is not connected, disconnects, or is overloaded.
            PayloadError: the request is too large for the service.
            CobotError: the call was rejected; the message gives the reason. The code in the answer determines
                the class.
        """
        if len(self._calls) >= MAX_CALLS:
            raise UnavailableError(
                f"{MAX_CALLS} calls over ROS 2 are already in progress, which is the maximum"
            )
        if self._calls_of[client] >= MAX_CALLS_OF_CLIENT:
            raise UnavailableError(
                f"{MAX_CALLS_OF_CLIENT} calls of this process are already in progress, which is the maximum"
            )
        number = f"call:{next(self._numbers)}"
        answer: asyncio.Future[Message] = asyncio.get_running_loop().create_future()
        self._calls[number] = answer
        self._calls_of[client] += 1
        try:
            if not self.send({"op": "call_service", "id": number, "service": service, "args": request}):
                raise UnavailableError(AWAY)
            return await answer
        finally:
            del self._calls[number]
            self._calls_of -= Counter([client])

    @contextlib.asynccontextmanager
    async def _connect(self) -> AsyncIterator[ClientConnection]:
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
                self._outgoing.clear()
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
            while (text := self._outgoing.next()) is not None:
                await socket.send(text)

    def _take(self, content: Message) -> None:
        match content["op"]:
            case "publish":
                self._on_message(content["topic"], content["msg"])
            case "service_response":
                code = None if content["result"] else content.get("code", Code.EXECUTION)
                self._answer(content["id"], content["values"], code)
            case "status" if content.get("id") in self._calls:
                self._answer(content["id"], content["msg"], content.get("code", Code.EXECUTION))
            case "status":
                log.warning("the service reports: %s", content["msg"])

    def _answer(self, number: str, values: Any, code: int | None) -> None:
        """End a call. `code` is the code of a rejection; None for a result."""
        answer = self._calls.get(number)
        if answer is None or answer.done():
            return
        if code is None:
            answer.set_result(values)
        else:
            answer.set_exception(ERROR_OF[code](str(values)))
