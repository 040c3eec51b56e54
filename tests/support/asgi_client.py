"""Clients of an application that runs on virtual time: they speak to itself, without a network (ASGI)."""

from __future__ import annotations

import asyncio
import json
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import httpx
from cobot_run import WAIT_S
from fastapi import FastAPI
from starlette.types import ASGIApp, Receive, Scope, Send

from app.api.access import IDENTITY
from cobot.access.roles import SERVICE

if TYPE_CHECKING:
    from virtual_service import VirtualService


def ask(app: FastAPI, method: str, path: str, **content: Any) -> httpx.Response:
    """What an application that has not been started answers."""

    async def request() -> httpx.Response:
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url="http://robot.test") as client:
            return await client.request(method, path, **content)

    return asyncio.run(request())


class Anybody:
    """For an application without `app.api.access.Access`: who asks may do everything."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        scope[IDENTITY] = SERVICE
        await self._app(scope, receive, send)


class SynchronousTransport(httpx.BaseTransport):
    """httpx's synchronous client at a virtual service."""

    def __init__(self, service: VirtualService) -> None:
        self._service = service

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        content = request.read()
        answer = self._service.run(
            self._service.asking(
                request.method, str(request.url), headers=dict(request.headers), content=content
            )
        )
        return httpx.Response(answer.status_code, headers=answer.headers, content=answer.content)


class Refused(Exception):
    """The service has denied a WebSocket."""

    def __init__(self, status: int, body: bytes) -> None:
        super().__init__(f"HTTP {status}")
        self.status, self.body = status, body


class Closed(Exception):
    """The service has closed a WebSocket; the code says why."""


class Socket:
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
        self._service = service
        self._inbox: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self._outbox: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self._inbox.put_nowait({"type": "websocket.connect"})
        self._task = service.begin(self._serve(service.app, path, headers))
        first = service.run(self._next())
        if first["type"] == "websocket.http.response.start":
            raise Refused(first["status"], service.run(self._next())["body"])
        assert first["type"] == "websocket.accept", first
        self.subprotocol = first.get("subprotocol")

    def __enter__(self) -> Socket:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    async def _serve(self, app: FastAPI, path: str, headers: dict[str, str]) -> None:
        path, _, query = path.partition("?")
        offered = headers.pop("subprotocols", "")
        scope = {
            "type": "websocket",
            "asgi": {"version": "3.0", "spec_version": "2.4"},
            "http_version": "1.1",
            "scheme": "ws",
            "path": path,
            "raw_path": path.encode(),
            "query_string": query.encode(),
            "root_path": "",
            "headers": [
                (name.lower().encode(), value.encode())
                for name, value in {"host": urlsplit(self._service.url).netloc, **headers}.items()
            ],
            "client": ("127.0.0.1", next(self._ports)),
            "server": ("robot.test", 80),
            "subprotocols": offered.split(", ") if offered else [],
            "state": {},
            "extensions": {"websocket.http.response": {}},
        }
        try:
            await app(scope, self._inbox.get, self._outbox.put)
        finally:
            self._outbox.put_nowait({"type": "websocket.close", "code": 1006})

    async def _next(self) -> dict[str, Any]:
        return await asyncio.wait_for(self._outbox.get(), WAIT_S)

    def send(self, frame: str | bytes) -> None:
        """Time does not go on: the service reads it when it next has its turn."""
        kind = "text" if isinstance(frame, str) else "bytes"
        self._inbox.put_nowait({"type": "websocket.receive", kind: frame})

    def recv(self, timeout_s: float = WAIT_S) -> str | bytes:
        """The next frame; time goes on until there is one."""
        del timeout_s
        message = self._service.run(self._next())
        if message["type"] == "websocket.close":
            if self._task.done():
                self._task.result()
            raise Closed(message["code"])
        text = message.get("text")
        return text if text is not None else message["bytes"]

    def close(self) -> None:
        """As a client that goes."""
        self._inbox.put_nowait({"type": "websocket.disconnect", "code": 1000})
        self._service.run(gathered({self._task}))


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
        path, _, query = path.partition("?")
        headers = {"host": urlsplit(self._service.url).netloc, "content-type": "application/json"}
        headers["content-length"] = str(len(self._body))
        scope = {
            "type": "http",
            "asgi": {"version": "3.0", "spec_version": "2.4"},
            "http_version": "1.1",
            "method": method,
            "scheme": "http",
            "path": path,
            "raw_path": path.encode(),
            "query_string": query.encode(),
            "root_path": "",
            "headers": [(name.encode(), value.encode()) for name, value in headers.items()],
            "client": ("127.0.0.1", 49_999),
            "server": ("robot.test", 80),
            "state": {},
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


class EventStream:
    """A client's end of a text/event-stream, that knows nothing of ours.

    Args:
        path: with a query, if it has one.

    Attributes:
        status: of the answer.
        last_id: as a browser would send it when it comes back; "" for none.
    """

    def __init__(self, service: VirtualService, path: str, headers: dict[str, str]) -> None:
        self._service = service
        self._inbox: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self._outbox: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self._inbox.put_nowait({"type": "http.request", "body": b"", "more_body": False})
        self._text = ""
        self.last_id = ""
        self._task = service.begin(self._serve(service.app, path, headers))
        first = service.run(self._next())
        self.status: int = first["status"]
        self.headers = {name.decode(): value.decode() for name, value in first["headers"]}

    def __enter__(self) -> EventStream:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    async def _serve(self, app: FastAPI, path: str, headers: dict[str, str]) -> None:
        path, _, query = path.partition("?")
        scope = {
            "type": "http",
            "asgi": {"version": "3.0", "spec_version": "2.4"},
            "http_version": "1.1",
            "method": "GET",
            "scheme": "http",
            "path": path,
            "raw_path": path.encode(),
            "query_string": query.encode(),
            "root_path": "",
            "headers": [
                (name.lower().encode(), value.encode())
                for name, value in {"host": urlsplit(self._service.url).netloc, **headers}.items()
            ],
            "client": ("127.0.0.1", 40_000),
            "server": ("robot.test", 80),
            "state": {},
        }
        try:
            await app(scope, self._inbox.get, self._outbox.put)
        finally:
            self._outbox.put_nowait({"type": "http.response.body", "body": b"", "more_body": False})

    async def _next(self) -> dict[str, Any]:
        return await asyncio.wait_for(self._outbox.get(), WAIT_S)

    def body(self) -> bytes:
        """All of an answer that ends."""
        content = b""
        while (message := self._service.run(self._next())).get("more_body"):
            content += message["body"]
        return content + message["body"]

    def block(self) -> dict[str, str]:
        """The fields of the next block; time goes on until there is one."""
        while "\n\n" not in self._text:
            message = self._service.run(self._next())
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

    def close(self) -> None:
        """As a client that goes."""
        self._inbox.put_nowait({"type": "http.disconnect"})
        self._service.run(gathered({self._task}))


async def gathered(tasks: set[asyncio.Task[Any]]) -> None:
    await asyncio.gather(*tasks, return_exceptions=True)
