"""An agent of the Model Context Protocol at a service on virtual time, by the official client."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

import httpx2
from mcp.client.client import Client
from mcp.client.streamable_http import streamable_http_client
from starlette.types import ASGIApp
from virtual_service import URL, VirtualService

from cobot.access.roles import Role
from cobot.access.tokens import TokenFile

Result = TypeVar("Result")
ADDRESS = "192.0.2.7"
HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
NEAR, FAR = [0.0, 0.1, 0.0, -1.6, 0.0, 1.5, 0.0], [1.6, 0.1, 0.0, -1.6, 0.0, 1.5, 0.0]
FENCE = """
mcp:
  execution: fenced
  fence: {low: [0.2, -0.3, 0.2], high: [0.8, 0.3, 0.9], speed_m_s: 0.25, planners: [ptp, lin]}
"""


class Agent:
    """An agent with a token of its own; each of its calls is a connection."""

    def __init__(
        self, service: VirtualService, token: str = "", mode: str = "auto", app: ASGIApp | None = None
    ) -> None:
        """app: what it speaks to, in place of the service itself."""
        self._service, self._mode, self._app = service, mode, app or service.app
        self.headers = {"authorization": f"Bearer {token}"} if token else {}

    async def doing(self, work: Callable[[Client], Awaitable[Result]]) -> Result:
        transport = httpx2.ASGITransport(self._app, client=(ADDRESS, 4000))
        async with httpx2.AsyncClient(transport=transport, headers=self.headers, timeout=None) as http:
            connection = streamable_http_client(f"{URL}/mcp/mcp", http_client=http)
            async with Client(connection, mode=self._mode) as client:  # type: ignore[arg-type]
                return await work(client)

    def does(self, work: Callable[[Client], Awaitable[Result]]) -> Result:
        return self._service.run(self.doing(work))

    def call(self, tool: str, **arguments: Any) -> Any:
        """What a tool answers; raises AssertionError with its words if it is an error."""
        answer = self.does(lambda client: client.call_tool(tool, arguments))
        assert not answer.is_error, answer.content[0].text
        return decoded(answer)

    def refused(self, tool: str, **arguments: Any) -> str:
        """In which words a tool refuses."""
        answer = self.does(lambda client: client.call_tool(tool, arguments))
        assert answer.is_error, answer
        return str(answer.content[0].text)


def decoded(answer: Any) -> Any:
    return json.loads(answer.content[0].text)


def token(service: VirtualService, role: Role) -> str:
    """A new one, which the service knows at once."""
    file = TokenFile(service.config.parent / "tokens.json")
    made = file.create(f"{role.name.lower()}-{len(file.read())}", role)
    service.sleep(2.0)
    return made


class Cell:
    """A robot, an agent, and an operator who watches both."""

    def __init__(self, service: VirtualService) -> None:
        self.service = service
        self.agent = Agent(service, token(service, Role.AGENT))
        self.operator = {"authorization": f"Bearer {token(service, Role.OPERATOR)}"}

    def asks(self, path: str, body: Any) -> Any:
        """What the operator does."""
        return self.service.post(path, json=body, headers=self.operator).json()

    def goes_to(self, joints: list[float]) -> None:
        assert self.asks("/robot/move/joints", {"joints": joints, "speed": 1.0})["success"]

    def joints(self) -> list[float]:
        answer = self.service.ask("GET", "/robot/joint_states", headers=self.operator).json()
        found: list[float] = answer["position"]
        return found
