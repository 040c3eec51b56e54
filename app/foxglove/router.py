"""Live data for Foxglove over its WebSocket protocol, with the same messages as the recordings.

The protocol is small: https://github.com/foxglove/ws-protocol. The vendor's SDK is not used, because its
server needs a separate port and does not authenticate clients.
"""

from __future__ import annotations

import asyncio
import contextlib
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

from fastapi import WebSocket, WebSocketDisconnect
from fastapi.responses import JSONResponse
from pydantic import ConfigDict, Field, ValidationError

from app.api.dependencies import addressed
from app.api.errors import status_of
from app.api.json_text import decoded
from app.api.route import EndpointRouter
from app.foxglove.channels import EVENTS, RobotChannels
from app.services.events.ring import Event
from app.services.events.ring import Events as Ring
from app.services.reports.listener import EventFilter, Listener
from cobot.access.roles import Role
from cobot.codes import code_of
from cobot.errors import CobotError, InputError, PayloadError, UnavailableError
from cobot.strict import StrictModel, sentences, shown

PATH = "/foxglove"
SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
MAX_CLIENTS = 16
MAX_MESSAGE = 65536
MAX_SUBSCRIPTIONS = 64
"""Maximum number of subscriptions per client. Each causes a separate message a hundred times a second."""
MESSAGE_DATA = struct.Struct("<BIQ")
"""Header of a message: its kind (1), the id of its subscription, and its time, ns since 1970."""
ERROR = 2
MAX_ID = 2**32 - 1

router = EndpointRouter()


class RateQuery(StrictModel):
    """The rate at which the state is sent."""

    model_config = ConfigDict(strict=False)

    rate_hz: float = Field(20.0, ge=0.1, le=100.0, allow_inf_nan=False)


@dataclass(frozen=True, slots=True)
class _Tick:
    """Placeholder for a state in the queue of events. The state is read just before it is sent."""

    robot: str

    def text(self) -> str:
        return ""


@router.endpoint(f"WS {PATH}", Role.OBSERVER, timeout_s=1.5)
async def foxglove(socket: WebSocket) -> None:
    """See docs/foxglove.md."""
    ring = cast(Ring, socket.app.state.events)
    try:
        protocol = _protocol(socket)
        rate_hz = _rate(socket)
        if socket.app.state.foxglove_clients >= MAX_CLIENTS or ring.closed:
            raise UnavailableError(
                f"{MAX_CLIENTS} clients are already connected, or the service is shutting down"
            )
        robots = addressed(socket)
    except CobotError as exc:
        answer = JSONResponse({"detail": str(exc), "code": exc.code}, status_of(exc))
        await socket.send_denial_response(answer)
        return
    socket.app.state.foxglove_clients += 1
    try:
        channels = {
            name: await asyncio.to_thread(
                RobotChannels, each.robot, each.link, has_gripper=each.gripper.exists
            )
            for name, each in robots.items()
        }
        await socket.accept(protocol)
        with contextlib.suppress(WebSocketDisconnect):
            await _Client(socket, ring, channels, rate_hz).serve()
    finally:
        socket.app.state.foxglove_clients -= 1


class _Client:
    """One connection.

    Args:
        channels: channels of each robot, by the robot's name.
    """

    def __init__(
        self, socket: WebSocket, ring: Ring, channels: Mapping[str, RobotChannels], rate_hz: float
    ) -> None:
        self._socket, self._epoch, self._channels = socket, ring.epoch, channels
        ticks = [cast(Any, _Tick(name)) for name in channels]
        self._listener = Listener(ring, EventFilter(None, frozenset(channels)), None, ticks, rate_hz)
        topics = [(name, topic) for name, each in channels.items() for topic in each.schemas]
        self._numbers = dict(enumerate(topics, start=1))
        self._wanted: dict[int, tuple[str, str]] = {}
        self._errors: list[CobotError] = []

    async def serve(self) -> None:
        """Serve until the client disconnects, or the service shuts down."""
        with contextlib.closing(self._listener):
            await self._tell(
                {"op": "serverInfo", "name": "cobot", "capabilities": [], "sessionId": self._epoch}
            )
            await self._tell({"op": "advertise", "channels": self._advertised()})
            reading = asyncio.create_task(self._read())
            try:
                while found := await self._listener.next():
                    for event in found:
                        await self._send(event)
                    while self._errors:
                        error = self._errors.pop(0)
                        about = {"message": str(error), "code": int(code_of(error))}
                        await self._tell({"op": "status", "level": ERROR, **about})
            finally:
                reading.cancel()

    def _advertised(self) -> list[dict[str, Any]]:
        several = len(self._channels) > 1
        return [
            {
                "id": number,
                "topic": f"/{robot}{topic}" if several else topic,
                "encoding": "cdr",
                "schemaName": self._channels[robot].schemas[topic][0],
                "schemaEncoding": "ros2msg",
                "schema": self._channels[robot].schemas[topic][1],
            }
            for number, (robot, topic) in self._numbers.items()
        ]

    async def _send(self, event: Event) -> None:
        if event.type == "state":
            wanted = {each: topic for each, (robot, topic) in self._wanted.items() if robot == event.robot}
            if wanted.keys() and set(wanted.values()) != {EVENTS}:
                made = self._channels[event.robot].states()
                for subscription, topic in wanted.items():
                    if topic in made:
                        await self._data(subscription, *made[topic])
            return
        for subscription, (robot, topic) in list(self._wanted.items()):
            if topic == EVENTS and event.robot in ("", robot) and event.type != "hello":
                await self._data(subscription, *self._channels[robot].event(event.text))

    async def _data(self, subscription: int, moment_ns: int, content: bytes) -> None:
        await self._socket.send_bytes(MESSAGE_DATA.pack(1, subscription, moment_ns) + content)
        await asyncio.sleep(0)  # let other tasks of the event loop run

    async def _tell(self, message: Mapping[str, Any]) -> None:
        await self._socket.send_json(message)

    async def _read(self) -> None:
        while (message := await self._socket.receive())["type"] == "websocket.receive":
            try:
                self._take(message.get("text"))
            except CobotError as exc:
                if len(self._errors) < MAX_CLIENTS:
                    self._errors.append(exc)
            await asyncio.sleep(0)
        self._listener.close()

    def _take(self, text: str | None) -> None:
        """Handle a message from the client.

        Raises:
            InputError, PayloadError: this server does not understand the message.
        """
        if text is None:
            raise InputError(
                "binary messages are not supported: clients can neither publish nor call services here"
            )
        if len(text) > MAX_MESSAGE:
            raise PayloadError(f"the message has {len(text)} characters, allowed: {MAX_MESSAGE}")
        content = decoded(text, "the message")
        kind = content.get("op") if isinstance(content, dict) else None
        if kind == "subscribe":
            for each in _list(content, "subscriptions"):
                self._subscribe(each)
        elif kind == "unsubscribe":
            for each in _list(content, "subscriptionIds"):
                self._wanted.pop(_number(each, "subscriptionIds"), None)
        else:
            raise InputError(f"op: {shown(str(kind))} is not served; valid values: subscribe, unsubscribe")

    def _subscribe(self, asked: Any) -> None:
        if not isinstance(asked, dict):
            raise InputError("subscriptions: each must be an object with id and channelId")
        number, channel = _number(asked.get("id"), "id"), _number(asked.get("channelId"), "channelId")
        if channel not in self._numbers:
            raise InputError(
                f"channelId: there is no channel {channel}; valid values: 1 to {len(self._numbers)}"
            )
        if number in self._wanted:
            raise InputError(f"id: subscription {number} already exists")
        if len(self._wanted) >= (most := max(MAX_SUBSCRIPTIONS, len(self._numbers))):
            raise InputError(f"there are already {most} subscriptions, which is the maximum")
        self._wanted[number] = self._numbers[channel]


def _list(content: dict[str, Any], name: str) -> list[Any]:
    found = content.get(name)
    if not isinstance(found, list):
        raise InputError(f"{name}: must be a list")
    return found


def _number(value: Any, name: str) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= MAX_ID:
        raise InputError(f"{name}: must be a whole number from 0 to {MAX_ID}")
    return value


def _protocol(socket: WebSocket) -> str:
    offered = socket.scope.get("subprotocols", ())
    for each in offered:
        if each in SUBPROTOCOLS:
            return str(each)
    raise InputError(f"the subprotocol must be one of {', '.join(SUBPROTOCOLS)}")


def _rate(socket: WebSocket) -> float:
    try:
        return RateQuery.model_validate(dict(socket.query_params)).rate_hz
    except ValidationError as exc:
        raise InputError(sentences(exc.errors())) from exc
