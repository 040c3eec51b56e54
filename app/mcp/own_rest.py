"""The REST API as a tool asks it: in this process, on behalf of who has called the tool."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote

import httpx
from mcp.server.mcpserver import Context
from mcp.server.mcpserver.exceptions import ToolError
from starlette.requests import Request
from starlette.types import Scope

from app.robot_services import Services

PASSED_ON = ("authorization", "host", "x-control-token", "x-request-id")


class OwnRest:
    """Who asks, where from and with which token is what the request to the tool says: so roles, control,
    limits and the audit are those of the REST API.

    Attributes:
        services: of the robot that is meant.
    """

    def __init__(self, ctx: Context[Any, Request], robot: str) -> None:
        """Raises ToolError: there is no such robot."""
        request = ctx.request_context.request
        assert request is not None  # this transport is HTTP alone
        self.scope: Scope = request.scope
        self._prefix = f"/robots/{quote(robot, safe='')}" if robot else ""
        self._headers = {name: request.headers[name] for name in PASSED_ON if name in request.headers}
        self._url = f"{request.url.scheme}://{request.url.netloc}"
        app = self.scope["app"]
        if robot and robot not in app.state.robots:
            raise ToolError(f"there is no robot {robot!r}; valid are: {', '.join(app.state.robots)}")
        self.services: Services = app.state.robots[robot] if robot else app.state.services

    async def get(self, path: str, **params: Any) -> Any:
        return await self._ask("GET", path, params=params)

    async def post(self, path: str, body: dict[str, Any] | None = None) -> Any:
        return await self._ask("POST", path, json=body)

    async def _ask(self, method: str, path: str, **content: Any) -> Any:
        """What is answered; raises ToolError: it is no success, with the reason in words."""
        transport = httpx.ASGITransport(self.scope["app"], client=self.scope["client"] or ("", 0))
        async with httpx.AsyncClient(
            transport=transport, base_url=self._url, headers=self._headers, timeout=None
        ) as client:
            answer = await client.request(method, self._prefix + path, **content)
        if answer.is_success:
            return answer.json()
        raise ToolError(f"{answer.status_code}: {answer.json()['detail']}")
