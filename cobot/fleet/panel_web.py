"""The cells' panels at the hub, on a separate port.

The scripts of a panel come from the cell. The separate port gives them a different origin than the fleet
page. So a cell whose software has been changed cannot use the rights that the person has at the hub.

An address is https://HUB:PORT/SECRET/PATH, where PATH is the path in the cell. The panel uses only addresses
relative to its own.
"""

from __future__ import annotations

import asyncio
import contextlib
import html
import json
import logging
import re
import socket
import threading
from collections.abc import AsyncIterator, Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import uvicorn
from pydantic import ValidationError
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, JSONResponse, RedirectResponse, Response, StreamingResponse
from starlette.types import Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from cobot.addresses import NAME
from cobot.errors import (
    AuthenticationError,
    BusyError,
    CobotError,
    InputError,
    NotFoundError,
    NotSupportedError,
    PayloadError,
    UnavailableError,
)
from cobot.fleet.connections import HubServer
from cobot.fleet.hub import STOP, Hub
from cobot.fleet.panel_link import OpenPanel, PanelLink, PanelPerson, require_room
from cobot.fleet.panel_messages import (
    MAX_ANSWER_BYTES,
    MAX_BODY_BYTES,
    MAX_FRAME_BYTES,
    MAX_REQUESTS,
    MAX_SOCKETS,
    REQUEST_HEADERS,
    CloseStream,
    OpenHttp,
    OpenSocket,
    PanelHead,
    ReadStream,
    SendMessage,
)
from cobot.fleet.same_site import SameSite
from cobot.fleet.status import status_of
from cobot.strict import sentences

MAX_ALL_REQUESTS, MAX_CONNECTIONS = 200, 500
"""Maximum number of requests in progress for all panels together, and maximum number of connections from
browsers.
"""
BROWSER_S = 30.0
"""Timeout for a browser to send a request body, and to accept a piece of an answer. Without it, browsers that
hang would use up the permitted number of requests.
"""
MAX_STOPS = 20
"""Maximum number of stops that are in progress at the same time. Further stops wait for one of them to
end.
"""
POLICY = "connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'; object-src 'none'"
HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
}
STYLE = "font: 18px/1.5 system-ui, sans-serif; max-width: 40rem; margin: 3rem auto; padding: 0 1rem"
NO_CONTENT = "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'none'"
WORDS = json.loads((Path(__file__).parent / "page" / "words.json").read_text(encoding="utf-8"))
_DOCS = re.compile(r"(?:/v1)?/(?:docs|redoc)(?:/.*)?")
_STOP = re.compile(rf"(?:/v1)?(?:/robots/({NAME}))?/stop")
log = logging.getLogger("cobot.fleet")


class PanelApp:
    """The application that forwards requests to the cells.

    Args:
        connections: returns the number of connections from browsers.
    """

    def __init__(self, hub: Hub, link: PanelLink, connections: Callable[[], int]) -> None:
        self._hub, self._link, self._connections = hub, link, connections
        self._requests = 0
        self._stops = ThreadPoolExecutor(MAX_STOPS, thread_name_prefix="stop")

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http":
            request = Request(scope, receive)
            try:
                await self._serve(request, send)
            except CobotError as exc:
                await _failure(request, exc)(scope, receive, send)
            except (OSError, ClientDisconnect) as exc:  # the connection ends, so the answer is incomplete
                log.warning("an answer of a panel has ended early: %s", exc or type(exc).__name__)
        elif scope["type"] == "websocket":
            await self._join(WebSocket(scope, receive, send))

    def _require_alive(self, panel: OpenPanel) -> None:
        """Check that the cell of a panel is connected.

        Raises:
            UnavailableError: the cell is gone.
        """
        if not any(each["alive"] for each in self._hub.robots_of(panel.cell)):
            raise UnavailableError(
                f"the cell {panel.cell} is not connected to the hub. Its arm may be moving: use the "
                "emergency stop"
            )

    async def _serve(self, request: Request, send: Send) -> None:
        """Answer a request.

        Raises:
            CobotError: the request cannot be forwarded, or the cell reports an error.
        """
        name, path = _split(request.scope)
        panel = self._link.get(name)
        person = panel.use()
        stop = _STOP.fullmatch(path)
        if request.method == "POST" and stop is not None:
            answer = await self._stop(panel, person, stop[1] or "*")
            await answer(request.scope, request.receive, send)
            return
        require_room(self._connections() - 1, MAX_CONNECTIONS, "connections to panels at this hub")
        self._require_alive(panel)
        if _DOCS.fullmatch(path):
            raise NotSupportedError(
                "the pages of the REST API contain addresses of the cell, so they do not work through "
                "a hub; open them at the address of the cell itself"
            )
        if not path:
            await RedirectResponse(f"/{name}/")(request.scope, request.receive, send)
            return
        wish = _wish_of(request, path)
        require_room(panel.requests, MAX_REQUESTS, "requests from this panel")
        require_room(self._requests, MAX_ALL_REQUESTS, "panel requests at this hub")
        panel.requests += 1
        self._requests += 1
        try:
            body = await _body(request)
            await _end_with_browser(request, self._pass_on(f"/{name}", panel, wish, body, request, send))
        finally:
            panel.requests -= 1
            self._requests -= 1

    async def _pass_on(
        self, place: str, panel: OpenPanel, wish: OpenHttp, body: bytes, request: Request, send: Send
    ) -> None:
        async def send_in_time(message: Message) -> None:
            async with asyncio.timeout(BROWSER_S):
                await send(message)

        async with panel.turns:
            opening = asyncio.ensure_future(self._link.ask(panel, wish, body))
            try:
                head, content = await asyncio.shield(opening)
            except asyncio.CancelledError:
                with contextlib.suppress(CobotError):
                    head, _ = await opening  # contains the name of the stream that must be closed
                    await self._close(panel, head.stream)
                raise
        last = [head]
        try:
            while not head.status:
                head, content = await self._read(panel, last)
            headers = _headers_of(head, place)
            pieces = self._pieces(panel, content, last)
            response = StreamingResponse(pieces, head.status, headers)
            await response(request.scope, request.receive, send_in_time)
        finally:
            if not last[0].ended:
                await asyncio.shield(self._close(panel, head.stream))

    async def _read(self, panel: OpenPanel, last: list[PanelHead]) -> tuple[PanelHead, bytes]:
        """The piece that follows the piece `last`."""
        async with panel.turns:
            last[0], content = await self._link.ask(panel, ReadStream(kind="read", stream=last[0].stream))
        return last[0], content

    async def _pieces(self, panel: OpenPanel, content: bytes, last: list[PanelHead]) -> AsyncIterator[bytes]:
        """All pieces of an answer. After an error no more pieces follow, and the browser finds the answer
        incomplete.
        """
        size = 0
        while True:
            size += len(content)
            if size > MAX_ANSWER_BYTES:
                raise OSError(f"the answer of {panel.cell} has more than {MAX_ANSWER_BYTES} bytes")
            if content:
                yield content
            if last[0].ended:
                return
            try:
                _, content = await self._read(panel, last)
            except CobotError as exc:
                raise OSError(str(exc)) from exc  # as for a browser that is gone: closes the connection

    async def _close(self, panel: OpenPanel, stream: str) -> None:
        with contextlib.suppress(CobotError):
            await self._link.ask(panel, CloseStream(kind="close", stream=stream))

    async def _stop(self, panel: OpenPanel, person: PanelPerson, robot: str) -> Response:
        """Stop the arms, with the same priority as a stop on the fleet page. Requests to panels do not delay
        the stop.
        """
        work = partial(self._hub.command, STOP, person.name, person.role, panel.cell, robot)
        answers = await asyncio.get_running_loop().run_in_executor(self._stops, work)
        bad = [each for each in answers if each["code"] != "ok"]
        message = "; ".join(f"{each['robot']}: {each['text']}" for each in bad or answers)
        return JSONResponse({"success": bool(answers) and not bad, "message": message}, headers=HEADERS)

    async def _join(self, browser: WebSocket) -> None:
        """Connect a browser with a WebSocket in a cell."""
        panel: OpenPanel | None = None
        try:
            name, path = _split(browser.scope)
            panel = self._link.get(name)
            require_room(self._connections() - 1, MAX_CONNECTIONS, "connections to panels at this hub")
            self._require_alive(panel)
            require_room(panel.sockets, MAX_SOCKETS, "connections of this panel")
            query = browser.scope["query_string"].decode("latin-1")
            wish = OpenSocket.model_validate({"kind": "socket", "path": path, "query": query})
            panel.sockets += 1
        except (CobotError, ValidationError) as exc:
            await _deny(browser, str(exc))
            return
        try:
            head, _ = await self._link.ask(panel, wish)
            await browser.accept("cobot" if "cobot" in browser.scope["subprotocols"] else None)
            up = asyncio.create_task(self._send_up(browser, panel, head.stream))
            try:
                await self._send_down(browser, panel, head.stream, up)
            finally:
                up.cancel()
                await asyncio.shield(self._close(panel, head.stream))
        except CobotError as exc:
            with contextlib.suppress(RuntimeError):
                await _deny(browser, str(exc))
        finally:
            panel.sockets -= 1

    async def _send_up(self, browser: WebSocket, panel: OpenPanel, stream: str) -> None:
        """Forward the messages from a browser in order."""
        while (message := await browser.receive())["type"] == "websocket.receive":
            text = message.get("text")
            wish = SendMessage(kind="send", stream=stream, is_text=text is not None)
            await self._link.ask(panel, wish, message["bytes"] if text is None else text.encode())

    async def _send_down(
        self, browser: WebSocket, panel: OpenPanel, stream: str, up: asyncio.Task[None]
    ) -> None:
        """Forward the messages from a cell until one side closes the connection."""
        while not up.done():
            head, content = await self._link.ask(panel, ReadStream(kind="read", stream=stream))
            place = 0
            try:
                for is_text, size in head.frames:
                    frame, place = content[place : place + size], place + size
                    await (browser.send_text(frame.decode()) if is_text else browser.send_bytes(frame))
                if head.ended:
                    await browser.close()
                    return
            except (WebSocketDisconnect, RuntimeError):
                return
        with contextlib.suppress(asyncio.CancelledError):
            up.result()


class PanelServer:
    """Serves the panels in a separate event loop and thread.

    Args:
        hosts: names and addresses that requests may use for the hub.
    """

    def __init__(self, hub: Hub, listener: socket.socket, hosts: list[str], folder: Path) -> None:
        assert hub.panels is not None
        panels = PanelApp(hub, hub.panels, lambda: len(self._server.server_state.connections))
        app = TrustedHostMiddleware(SameSite(panels), hosts, www_redirect=False)
        self._listener = listener
        self._server = HubServer(
            uvicorn.Config(
                app,
                log_config=None,
                access_log=False,
                lifespan="off",
                timeout_graceful_shutdown=1,
                ws_max_size=MAX_FRAME_BYTES,
                ws_per_message_deflate=False,
                proxy_headers=False,
                server_header=False,
                ssl_certfile=folder / "hub" / "hub.pem",
                ssl_keyfile=folder / "hub" / "hub.key",
            )
        )
        self._thread = threading.Thread(target=self._run, name="panels", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._server.should_exit = True
        self._thread.join(5.0)

    def _run(self) -> None:
        self._server.run(sockets=[self._listener])


def _split(scope: Scope) -> tuple[str, str]:
    """The secret part of an address, and the path in the cell."""
    name, slash, path = scope["raw_path"].decode("ascii").removeprefix("/").partition("/")
    return name, slash + path


def _wish_of(request: Request, path: str) -> OpenHttp:
    """Read the request of a browser.

    Raises:
        InputError: the path or a header is not one that a panel sends.
    """
    content = {
        "kind": "http",
        "method": request.method,
        "path": path,
        "query": request.scope["query_string"].decode("latin-1"),
        "headers": {key: value for key, value in request.headers.items() if key in REQUEST_HEADERS},
    }
    try:
        return OpenHttp.model_validate(content)
    except ValidationError as exc:
        raise InputError(f"the request cannot be passed on to the cell: {sentences(exc.errors())}") from exc


def _headers_of(head: PanelHead, place: str) -> dict[str, str]:
    """The headers for a browser.

    Args:
        place: path of the panel at the hub.

    Raises:
        PayloadError: the answer is too large.
    """
    headers = dict(head.headers)
    length = headers.get("content-length", "0")
    if not length.isdecimal() or int(length) > MAX_ANSWER_BYTES:
        raise PayloadError(
            f"the answer has {length} bytes, but the hub forwards at most {MAX_ANSWER_BYTES}; use the "
            "address of the cell itself, or `cobot fleet pull` for recordings"
        )
    location = headers.pop("location", "")
    if re.match(r"/(?!/)", location):
        headers["location"] = f"{place}{location}"
    policies = headers.pop("content-security-policy", ""), POLICY
    return headers | HEADERS | {"content-security-policy": ", ".join(filter(None, policies))}


async def _end_with_browser(request: Request, work: Coroutine[Any, Any, None]) -> None:
    """Forward a request. If the browser disconnects before the cell has answered, make the cell end the
    request.

    With `web.stop_on_disconnect`, the cell also ends the motion, as it does for browsers that are connected
    to the cell directly.

    Args:
        request: a request whose body was read.
    """

    async def wait_for_departure() -> None:
        while (await request.receive())["type"] != "http.disconnect":
            pass

    doing, leaving = asyncio.ensure_future(work), asyncio.ensure_future(wait_for_departure())
    try:
        await asyncio.wait((doing, leaving), return_when=asyncio.FIRST_COMPLETED)
        if doing.done():
            doing.result()
    finally:
        leaving.cancel()
        doing.cancel()


async def _body(request: Request) -> bytes:
    """Read a request body.

    Raises:
        PayloadError: the body is too large.
        InputError: the body has not arrived in time.
    """
    announced = request.headers.get("content-length", "0")
    body = b""
    if not announced.isdecimal() or int(announced) <= MAX_BODY_BYTES:
        try:
            async with asyncio.timeout(BROWSER_S):
                async for part in request.stream():
                    body += part
                    if len(body) > MAX_BODY_BYTES:
                        break
                else:
                    return body
        except TimeoutError as exc:
            raise InputError(
                f"only {len(body)} bytes of the body have arrived within {BROWSER_S:g} s; send it again"
            ) from exc
    raise PayloadError(
        f"the body has more than {MAX_BODY_BYTES} bytes, the maximum that a hub forwards; use the address of "
        "the cell itself, or `cobot fleet roll-out` for programs"
    )


async def _deny(browser: WebSocket, reason: str) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        await browser.close(1013, reason.encode()[:120].decode(errors="ignore"))


def _failure(request: Request, exc: CobotError) -> Response:
    """The response for an error: JSON for scripts, and a page for people."""
    status = status_of(exc)
    headers = HEADERS | ({"connection": "close"} if isinstance(exc, BusyError) else {})
    if "text/html" not in request.headers.get("accept", ""):
        return JSONResponse({"detail": str(exc), "code": exc.code}, status, headers)
    wanted = request.headers.get("accept-language", "")[:2]
    words = WORDS.get(wanted, WORDS["en"])
    again = isinstance(exc, UnavailableError)
    kind = "closed" if isinstance(exc, NotFoundError) else "none"
    title = words["panel_elsewhere" if isinstance(exc, NotSupportedError) else f"panel_{kind}"]
    advice = words["panel_again"] if again else ""
    if isinstance(exc, NotFoundError | AuthenticationError):
        advice = words["panel_reopen"]
    language = wanted if wanted in WORDS else "en"
    page = (
        f"<!doctype html><html lang='{language}'><meta charset='utf-8'><title>cobot</title>"
        f"{'<meta http-equiv=refresh content=3>' if again else ''}<body style='{STYLE}'>"
        f"<h1>{html.escape(title)}</h1><p>{html.escape(str(exc))}</p><p>{html.escape(advice)}</p>"
    )
    headers |= {"content-security-policy": NO_CONTENT, "cache-control": "no-store"}
    return HTMLResponse(page, status, headers)
