"""Clients of an application that runs on virtual time: they speak to itself, without a network (ASGI)."""

from __future__ import annotations

import asyncio
import json
from typing import TYPE_CHECKING, Any, Self
from urllib.parse import urlsplit

import httpx
import httpx2
from cobot_run import WAIT_S
from fastapi import FastAPI
from starlette.types import ASGIApp, Receive, Scope, Send

from app.api.middleware.access import IDENTITY
from cobot.access.roles import SERVICE

if TYPE_CHECKING:
    from virtual_service import VirtualService

Message = dict[str, Any]


def ask(app: FastAPI, method: str, path: str, **content: Any) -> httpx.Response:
    """What an application that has not been started answers."""

    async def request() -> httpx.Response:
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url="http://robot.test") as client:
            return await client.request(method, path, **content)

    return asyncio.run(request())


class Anybody:
    """For an application without `app.api.middleware.access.Access`: who asks may do everything."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        scope[IDENTITY] = SERVICE
        await self._app(scope, receive, send)


class SynchronousTransport(httpx2.BaseTransport):
    """httpx2's synchronous client at a virtual service."""

    def __init__(self, service: VirtualService) -> None:
        self._service = service

    def handle_request(self, request: httpx2.Request) -> httpx2.Response:
        content = request.read()
        answer = self._service.run(
            self._service.asking(
                request.method, str(request.url), headers=dict(request.headers), content=content
            )
        )
        return httpx2.Response(answer.status_code, headers=answer.headers, content=answer.content)


class Refused(Exception):
    """The service has denied a WebSocket."""

    def __init__(self, status: int, body: bytes) -> None:
        super().__init__(f"HTTP {status}")
        self.status, self.body = status, body


class Closed(Exception):
    """The service has closed a WebSocket; the code says why."""


class _Connection:
    """A client's end of a connection to the application, which ends with the context.

    Args:
        first: what the application receives first.
        last: what it receives when the client goes.
        end: what the client receives when the application has ended.
        port: the client's.
    """

    def __init__(
        self,
        service: VirtualService,
        path: str,
        headers: dict[str, str],
        kind: dict[str, Any],
        first: Message,
        last: Message,
        end: Message,
    ) -> None:
        self._service = service
        self._inbox: asyncio.Queue[Message] = asyncio.Queue()
        self._outbox: asyncio.Queue[Message] = asyncio.Queue()
        self._inbox.put_nowait(first)
        self._last = last

        async def serve() -> None:
            try:
                await service.app(_scope(service, path, headers) | kind, self._inbox.get, self._outbox.put)
            finally:
                self._outbox.put_nowait(end)

        self._task = service.begin(serve())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _next(self) -> Message:
        return self._service.run(asyncio.wait_for(self._outbox.get(), WAIT_S))

    def close(self) -> None:
        """As a client that goes."""
        self._inbox.put_nowait(self._last)
        self._service.run(gathered({self._task}))


def _scope(service: VirtualService, path: str, headers: dict[str, str]) -> dict[str, Any]:
    """What the scopes of requests and WebSockets have in common."""
    path, _, query = path.partition("?")
    sent = {"host": urlsplit(service.url).netloc, **headers}
    return {
        "asgi": {"version": "3.0", "spec_version": "2.4"},
        "http_version": "1.1",
        "path": path,
        "raw_path": path.encode(),
        "query_string": query.encode(),
        "root_path": "",
        "headers": [(name.lower().encode(), value.encode()) for name, value in sent.items()],
        "server": ("robot.test", 80),
        "state": {},
    }


class Socket(_Connection):
    """A client's end of a WebSocket to the application; at most `unread` messages wait for who does not read.

    Args:
        path: with a query, if it has one.
        headers: `subprotocols` among them are offered ones, with commas between.

    Attributes:
        subprotocol: that the service has chosen.

    Raises:
        Refused: the service does not accept it.
    """

    _ports = iter(range(50_000, 60_000))

    def __init__(self, service: VirtualService, path: str, headers: dict[str, str]) -> None:
        offered = headers.pop("subprotocols", "")
        super().__init__(
            service,
            path,
            headers,
            {
                "type": "websocket",
                "scheme": "ws",
                "client": ("127.0.0.1", next(self._ports)),
                "subprotocols": offered.split(", ") if offered else [],
                "extensions": {"websocket.http.response": {}},
            },
            {"type": "websocket.connect"},
            {"type": "websocket.disconnect", "code": 1000},
            {"type": "websocket.close", "code": 1006},
        )
        first = self._next()
        if first["type"] == "websocket.http.response.start":
            raise Refused(first["status"], self._next()["body"])
        assert first["type"] == "websocket.accept", first
        self.subprotocol = first.get("subprotocol")

    def send(self, frame: str | bytes) -> None:
        """Time does not go on: the service reads it when it next has its turn."""
        kind = "text" if isinstance(frame, str) else "bytes"
        self._inbox.put_nowait({"type": "websocket.receive", kind: frame})

    def recv(self, timeout_s: float = WAIT_S) -> str | bytes:
        """The next frame; time goes on until there is one."""
        del timeout_s
        message = self._next()
        if message["type"] == "websocket.close":
            if self._task.done():
                self._task.result()
            raise Closed(message["code"])
        text = message.get("text")
        return text if text is not None else message["bytes"]


class Leaving:
    """A request with a JSON body whose client waits for the answer until `leave` is called."""

    def __init__(self, service: VirtualService, method: str, path: str, content: object) -> None:
        self._gone = asyncio.Event()
        self._body = json.dumps(content).encode()
        self._service = service
        self._sent: list[dict[str, Any]] = []
        self._task = service.begin(self._serve(service.app, method, path))

    def leave(self) -> None:
        """Close the connection; returns when the service has noticed."""
        self._gone.set()
        self._service.run(gathered({self._task}))

    async def _serve(self, app: FastAPI, method: str, path: str) -> None:
        headers = {"content-type": "application/json", "content-length": str(len(self._body))}
        scope = _scope(self._service, path, headers) | {
            "type": "http",
            "method": method,
            "scheme": "http",
            "client": ("127.0.0.1", 49_999),
        }
        waiting = [{"type": "http.request", "body": self._body, "more_body": False}]

        async def receive() -> dict[str, Any]:
            if waiting:
                return waiting.pop()
            await self._gone.wait()
            return {"type": "http.disconnect"}

        async def send(message: dict[str, Any]) -> None:
            self._sent.append(message)

        await app(scope, receive, send)


class EventStream(_Connection):
    """A client's end of a text/event-stream, that knows nothing of ours.

    Args:
        path: with a query, if it has one.

    Attributes:
        status: of the answer.
        last_id: as a browser would send it when it comes back; "" for none.
    """

    def __init__(self, service: VirtualService, path: str, headers: dict[str, str]) -> None:
        super().__init__(
            service,
            path,
            headers,
            {"type": "http", "method": "GET", "scheme": "http", "client": ("127.0.0.1", 40_000)},
            {"type": "http.request", "body": b"", "more_body": False},
            {"type": "http.disconnect"},
            {"type": "http.response.body", "body": b"", "more_body": False},
        )
        self._text = ""
        self.last_id = ""
        first = self._next()
        self.status: int = first["status"]
        self.headers = {name.decode(): value.decode() for name, value in first["headers"]}

    def body(self) -> bytes:
        """All of an answer that ends."""
        content = b""
        while (message := self._next()).get("more_body"):
            content += message["body"]
        return content + message["body"]

    def block(self) -> dict[str, str]:
        """The fields of the next block; time goes on until there is one."""
        while "\n\n" not in self._text:
            message = self._next()
            self._text += message["body"].decode()
            if not message.get("more_body"):
                raise Closed("the end of the answer")
        block, _, self._text = self._text.partition("\n\n")
        fields = dict(line.split(": ", 1) for line in block.split("\n"))
        self.last_id = fields.get("id", self.last_id)
        return fields

    def event(self, *types: str) -> dict[str, Any]:
        """The next event, or the next one of these types."""
        while True:
            fields = self.block()
            if "data" not in fields:
                continue
            found: dict[str, Any] = json.loads(fields["data"])
            assert found["type"] == fields["event"]
            if not types or found["type"] in types:
                return found


async def gathered(tasks: set[asyncio.Task[Any]]) -> None:
    await asyncio.gather(*tasks, return_exceptions=True)
