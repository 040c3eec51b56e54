"""The WebSocket of rosbridge v2: topics, services and actions as JSON; see docs/rosbridge.md."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any, cast

from fastapi import WebSocket, WebSocketDisconnect
from fastapi.responses import JSONResponse

from app.api.dependencies import LARGE_BYTES
from app.api.errors import status_of
from app.api.json_text import decoded
from app.api.middleware.access import identity_of
from app.api.route import EndpointRouter, without_collection
from app.graph.graph import Graph
from app.rosbridge.connection import RosbridgeConnection
from app.services.clients import CLIENT
from cobot.access.roles import Role
from cobot.errors import CobotError, InputError, PayloadError, UnavailableError
from cobot.ros.message_limits import MAX_MESSAGE, check_message

PATH = "/rosbridge"
MAX_CONNECTIONS = 32
MAX_FRAME_BYTES = 2 * MAX_MESSAGE
"""Maximum size of a frame, in bytes. A larger frame closes the connection. A smaller frame whose message is
too large only causes an error.
"""
TRY_LATER = 1013

router = EndpointRouter()


@router.endpoint(f"WS {PATH}", Role.OBSERVER, timeout_s=2.0)
async def rosbridge(socket: WebSocket) -> None:
    """See docs/rosbridge.md."""
    state = socket.app.state
    try:
        if state.rosbridge_connections >= MAX_CONNECTIONS:
            raise UnavailableError(
                f"{MAX_CONNECTIONS} clients of rosbridge are already connected, which is the maximum"
            )
    except CobotError as exc:
        answer = JSONResponse({"detail": str(exc), "code": exc.code}, status_of(exc))
        await socket.send_denial_response(answer)
        return
    state.rosbridge_connections += 1
    try:
        await _serve(socket, cast(Graph, state.graph), cast(asyncio.Lock, state.large_body))
    finally:
        state.rosbridge_connections -= 1


async def _serve(socket: WebSocket, graph: Graph, large: asyncio.Lock) -> None:
    await socket.accept()
    client = socket.client
    name = f"{client.host}:{client.port}" if client else "a client"
    connection = RosbridgeConnection(graph, name, identity_of(socket))
    CLIENT.get().tell = connection.tell
    work = [
        asyncio.create_task(each)
        for each in (
            _receive(socket, connection, large),
            _send(socket, connection),
            _watch(socket, connection),
        )
    ]
    try:
        done, _ = await asyncio.wait(work, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in work:
            task.cancel()
        await connection.close()


async def _receive(socket: WebSocket, connection: RosbridgeConnection, large: asyncio.Lock) -> None:
    while await _receive_one(socket, connection, large):
        await asyncio.sleep(0)  # a client that floods this connection must not delay the others


async def _receive_one(socket: WebSocket, connection: RosbridgeConnection, large: asyncio.Lock) -> bool:
    """Handle the next message, and return whether there was one. The message is freed before the next one is
    awaited. Otherwise each connection would keep a decoded message, which takes three times the memory of its
    text.
    """
    message = await socket.receive()
    if message["type"] != "websocket.receive":
        return False
    text = message.get("text")
    if text is None:
        connection.report_error(InputError("binary messages are not understood: CBOR is not supported"))
    while text is not None:
        try:
            check_message(text)
            if len(text) <= LARGE_BYTES:
                content = decoded(text, "the message")
            else:
                async with large:
                    content = await asyncio.to_thread(without_collection, _prepared, connection, text)
        except PayloadError as exc:
            connection.reject_unread(text, exc)
            break
        except CobotError as exc:
            connection.report_error(exc)
            break
        text = connection.take(content, len(text))
    return True


def _prepared(connection: RosbridgeConnection, text: str) -> Any:
    return connection.prepared(decoded(text, "the message"))


async def _send(socket: WebSocket, connection: RosbridgeConnection) -> None:
    outbox = connection.outbox
    try:
        while True:
            await outbox.wake.wait()
            outbox.wake.clear()
            for text in outbox.texts():
                await socket.send_text(text)
    except WebSocketDisconnect:
        return


async def _watch(socket: WebSocket, connection: RosbridgeConnection) -> None:
    await connection.outbox.overfull.wait()
    with contextlib.suppress(WebSocketDisconnect):
        await socket.close(TRY_LATER, "the client reads its answers too slowly")
