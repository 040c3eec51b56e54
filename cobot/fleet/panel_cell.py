"""The cell's part of its panel at the hub: requests to the cell's own service, with the rights that the cell
permits.

Everything runs in one event loop in a separate thread, so no command of the fleet waits for it. The service
decides what a request may do, by the role of the token that is sent with the request.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
from collections.abc import Callable
from functools import partial
from hashlib import sha256
from typing import TYPE_CHECKING

import httpx2
from websockets.asyncio.client import connect
from websockets.exceptions import WebSocketException

from cobot.access.authentication import panel_token
from cobot.access.roles import Role
from cobot.client.tls import tls_context
from cobot.config.sections import AcceptedCommands
from cobot.errors import CobotError, InputError, NotFoundError, PermissionDenied, UnavailableError
from cobot.fleet.certificates import Verifier
from cobot.fleet.commands import Deadlines, SeenMessages
from cobot.fleet.messages import HubTime, written
from cobot.fleet.panel_messages import (
    ANSWER_HEADERS,
    MAX_BODY_BYTES,
    MAX_PIECE_BYTES,
    WAIT_S,
    CloseStream,
    OpenHttp,
    OpenSocket,
    PanelHead,
    PanelRequest,
    ReadStream,
    SendMessage,
)
from cobot.fleet.panel_streams import PanelStream, PanelStreams, require_piece

if TYPE_CHECKING:
    import zenoh

MAX_WAITING = 200
"""Maximum number of queries that are answered at the same time."""
CONNECT_S = 5.0
LONG_S = 150.0
"""Timeout for an answer from the service. It is longer than the timeouts of the panel."""
READING = ("GET", "HEAD")
NO_ROLE = "none"
HIGHEST = Role.PROGRAMMER
"""Highest role that a person at the hub can have in this cell. Tokens, backups and reloads need a higher
role.
"""

log = logging.getLogger("cobot.fleet")


class CellPanel:
    """Answers the requests that the hub sends to the panel of this cell.

    Args:
        fleet, cell: the names of the fleet and of this cell.
        url: URL of the cell's service; "" for a cell without a service.
        token: token of this process for the service.
        record: function that adds a request that changes something to the audit. Its arguments are the
            person, the request, the outcome and the id.
    """

    def __init__(
        self,
        fleet: str,
        cell: str,
        accept: AcceptedCommands,
        verifier: Verifier | None,
        ask_time: Callable[[], HubTime | None],
        url: str,
        token: str,
        record: Callable[[str, str, str, str], None],
    ) -> None:
        self._fleet, self._cell, self._accept, self._verifier = fleet, cell, accept, verifier
        self._url, self._token, self._record = url, token, record
        deadlines = Deadlines(ask_time)
        self.synchronize = deadlines.synchronize
        self._seen = SeenMessages(deadlines)
        self._streams = PanelStreams()
        self._places = threading.Semaphore(MAX_WAITING)
        self._loop = asyncio.new_event_loop()
        self._http: httpx2.AsyncClient | None = None
        self._thread = threading.Thread(target=self._serve, name="panel", daemon=True)
        self._thread.start()

    def receive(self, query: zenoh.Query, key: str) -> None:
        """Answer a query of the hub, in the event loop."""
        if not self._places.acquire(blocking=False):
            busy = PanelHead(code="busy", text=f"{MAX_WAITING} requests to the panel of this cell wait")
            query.reply(key, b"", attachment=written(busy))
            return
        asyncio.run_coroutine_threadsafe(self._answer(query, key), self._loop)

    def close_streams(self) -> None:
        """Close all streams, because the connection to the hub is lost."""
        self._loop.call_soon_threadsafe(self._streams.close_unread, -1.0)

    def close(self) -> None:
        self.close_streams()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(CONNECT_S)

    def _serve(self) -> None:
        loop = self._loop
        asyncio.set_event_loop(loop)
        waiting = loop.create_task(self._close_unread())
        loop.run_forever()
        waiting.cancel()
        loop.run_until_complete(self._end())
        loop.run_until_complete(loop.shutdown_default_executor())
        loop.close()

    async def _end(self) -> None:
        """Cancel all tasks, and close the connections to the service."""
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        if self._http is not None:
            await self._http.aclose()

    async def _close_unread(self) -> None:
        while True:
            await asyncio.sleep(1.0)
            self._streams.close_unread()

    async def _answer(self, query: zenoh.Query, key: str) -> None:
        try:
            with query:
                attachment = query.attachment
                body = b"" if attachment is None else bytes(attachment)
                try:
                    head, content = await self._execute(bytes(query.payload or b""), body)
                except CobotError as exc:
                    head, content = PanelHead(code=exc.code, text=str(exc)[:2000]), b""
                query.reply(key, content, attachment=written(head))
        except Exception:
            log.exception("a request to the panel was not answered")
        finally:
            self._places.release()

    async def _execute(self, content: bytes, body: bytes) -> tuple[PanelHead, bytes]:
        """Execute a request from the hub.

        Raises:
            CobotError: the request is not accepted, or cannot be executed.
        """
        if self._verifier is None:
            raise PermissionDenied(
                "a cell without fleet.certificates shows no panel through a hub; create certificates with "
                "`cobot fleet certificate`"
            )
        request = self._verifier.read(PanelRequest, content)
        if len(body) > MAX_BODY_BYTES or sha256(body).hexdigest() != request.body:
            raise InputError("the body of the request is not the one that the hub has signed")
        if (request.fleet, request.cell) != (self._fleet, self._cell):
            raise InputError(
                f"the request is for {request.fleet}/{request.cell}, but {self._fleet}/{self._cell} "
                "received it"
            )
        await asyncio.to_thread(self._seen.require_new, request)  # may ask the hub for its time
        match request.wish:
            case OpenHttp():
                role = self._role(request, changes=request.wish.method not in READING)
                stream = self._streams.open(partial(self._ask, request, request.wish, body, role))
                return await self._piece(stream)
            case OpenSocket():
                role = self._role(request, changes=False)
                return await self._open_socket(request.wish, role)
            case ReadStream():
                return await self._piece(self._streams.get(request.wish.stream))
            case SendMessage():
                send = self._streams.get(request.wish.stream).send
                if send is None:
                    raise InputError("this stream takes no messages")
                with contextlib.suppress(WebSocketException):  # the stream reports the end of the WebSocket
                    await send(body.decode("utf-8", "replace") if request.wish.is_text else body)
                return PanelHead(), b""
            case CloseStream():
                self._streams.close(request.wish.stream)
                return PanelHead(ended=True), b""

    def _role(self, request: PanelRequest, *, changes: bool) -> Role:
        """The role of a request to the service.

        Raises:
            PermissionDenied: this cell does not permit the request.
            NotFoundError: this cell has no service.
        """
        if not self._url:
            raise NotFoundError(
                "this cell runs without its web service, so it has no panel; set web.enabled to true"
            )
        given = Role[request.role.upper()]
        self._require("panel", request, given)
        commands = self._accept.panel_commands
        if commands != NO_ROLE and given >= Role[commands.upper()]:
            return min(given, HIGHEST)
        if changes:
            self._require("panel_commands", request, given)
        return Role.OBSERVER

    def _require(self, setting: str, request: PanelRequest, given: Role) -> None:
        needed = str(getattr(self._accept, setting))
        if needed == NO_ROLE or given < Role[needed.upper()]:
            raise PermissionDenied(
                f"through the hub, the lowest role allowed for this request is {needed} "
                f"(fleet.accept.{setting}), but {request.who} has the role {request.role}"
            )

    async def _piece(self, stream: PanelStream) -> tuple[PanelHead, bytes]:
        frames, ended = await stream.read(WAIT_S)
        status, headers = stream.status, stream.headers
        stream.status, stream.headers = 0, {}  # status and headers are sent only once
        if ended:
            self._streams.close(stream.name)
        told = [] if stream.send is None else [(is_text, len(content)) for is_text, content in frames]
        head = PanelHead(stream=stream.name, status=status, headers=headers, frames=told, ended=ended)
        return head, b"".join(content for _, content in frames)

    async def _ask(
        self, request: PanelRequest, wish: OpenHttp, body: bytes, role: Role, stream: PanelStream
    ) -> None:
        """Fill a stream with the answer from the service."""
        if self._http is None:
            timeout = httpx2.Timeout(LONG_S, connect=CONNECT_S)
            self._http = httpx2.AsyncClient(timeout=timeout, verify=tls_context(True), trust_env=False)
        target = wish.path + (f"?{wish.query}" if wish.query else "")
        own = {
            "accept-encoding": "identity",
            "authorization": f"Bearer {panel_token(self._token, role)}",
        }
        made = self._http.build_request(
            wish.method,
            httpx2.URL(self._url).copy_with(raw_path=target.encode("ascii")),
            headers=wish.headers | own,
            content=body or None,
        )
        outcome = "error"
        try:
            answer = await self._http.send(made, stream=True)
            try:
                outcome = "ok" if answer.status_code < 400 else str(answer.status_code)
                headers = {name: value for name, value in answer.headers.items() if name in ANSWER_HEADERS}
                await stream.begin(answer.status_code, headers)
                async for content in answer.aiter_raw():
                    await stream.put(content)
            finally:
                await answer.aclose()
        except httpx2.HTTPError as exc:
            raise UnavailableError(
                f"the service of the cell does not answer: {str(exc) or type(exc).__name__}"
            ) from exc
        finally:
            if wish.method not in READING:
                what = f"panel {wish.method} {wish.path}"
                await asyncio.shield(asyncio.to_thread(self._record, request.who, what, outcome, request.id))

    async def _open_socket(self, wish: OpenSocket, role: Role) -> tuple[PanelHead, bytes]:
        address = self._url.replace("http", "ws", 1) + wish.path + (f"?{wish.query}" if wish.query else "")
        try:
            socket = await connect(
                address,
                additional_headers={"Authorization": f"Bearer {panel_token(self._token, role)}"},
                ssl=tls_context(True) if address.startswith("wss") else None,
                max_size=MAX_PIECE_BYTES,
                compression=None,
                open_timeout=CONNECT_S,
                proxy=None,
            )
        except (WebSocketException, OSError, TimeoutError) as exc:
            raise UnavailableError(f"the service of the cell does not open {wish.path}: {exc}") from exc

        async def read(stream: PanelStream) -> None:
            try:
                async for message in socket:
                    is_text = isinstance(message, str)
                    content = message.encode() if isinstance(message, str) else bytes(message)
                    await stream.put(require_piece(content), is_text=is_text)
            finally:
                await socket.close()

        try:
            stream = self._streams.open(read)
        except CobotError:
            await socket.close()
            raise
        stream.send = socket.send
        return PanelHead(stream=stream.name), b""
