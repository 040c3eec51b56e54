"""Calls of the REST API inside this process, on behalf of an agent.

The calls use the client, the address and the token of the agent's request. So roles, control, limits and the
audit log apply as in the REST API.
"""

from __future__ import annotations

import asyncio
import json
from typing import Any
from urllib.parse import urlencode

from starlette.types import Message, Scope

from app.api.middleware.access import FORWARDING
from app.robot_services import Services
from cobot.addresses import address
from cobot.errors import NotFoundError
from cobot.strict import shown

PASSED_ON = FORWARDING.union((b"authorization", b"host", b"x-control-token", b"x-request-id"))
_OF_THE_CONNECTION = ("type", "asgi", "http_version", "scheme", "server", "client", "app")


class OwnRest:
    """The REST API of one robot. Without a name, the paths without a robot are used.

    Attributes:
        services: services of the addressed robot.
    """

    def __init__(self, scope: Scope, robot: str) -> None:
        """Raises NotFoundError if there is no such robot."""
        state = scope["app"].state
        if robot and robot not in state.robots:
            raise NotFoundError(f"there is no robot {shown(robot)}; valid names: {', '.join(state.robots)}")
        self.services: Services = state.robots[robot] if robot else state.services
        self._scope = scope
        self._prefix = address("", robot) if robot else ""

    async def ask(self, method: str, path: str, body: Any = None, **params: Any) -> tuple[int, Any]:
        """Call an endpoint. Returns the status and the document of its answer."""
        headers = [(name, value) for name, value in self._scope["headers"] if name in PASSED_ON]
        content = b"" if body is None else json.dumps(body).encode()
        if body is not None:
            headers += [(b"content-type", b"application/json"), (b"content-length", b"%d" % len(content))]
        path = self._prefix + path
        scope = {name: self._scope[name] for name in _OF_THE_CONNECTION if name in self._scope} | {
            "method": method,
            "path": path,
            "raw_path": path.encode(),
            "query_string": urlencode(params).encode(),
            "headers": headers,
        }
        coming: list[Message] = [{"type": "http.request", "body": content, "more_body": False}]
        status, answer = 0, bytearray()

        async def receive() -> Message:
            if coming:
                return coming.pop()
            await asyncio.Event().wait()  # an internal client never disconnects before the answer
            raise AssertionError("unreachable")

        async def send(message: Message) -> None:
            nonlocal status
            status = message.get("status", status)
            answer.extend(message.get("body", b""))

        await scope["app"](scope, receive, send)
        return status, json.loads(answer)
