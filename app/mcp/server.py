"""The MCP server of this service: its tools, resources and prompts."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from mcp import MCPError
from mcp.server.mcpserver import MCPServer
from mcp.server.mcpserver.exceptions import ResourceError
from mcp.server.streamable_http_manager import StreamableHTTPSessionManager
from mcp.server.transport_security import TransportSecuritySettings
from mcp_types import INVALID_PARAMS

from app.mcp import tools
from cobot.addresses import MCP
from cobot.audit import note
from cobot.strict import shown

if TYPE_CHECKING:
    from fastapi import FastAPI

INSTRUCTIONS = """\
You look at a robot arm, plan its motions and, where that is permitted, run them.
Plan first, look at the preview, tell a person what the arm will do, then execute the plan.
Lengths are in m, angles in rad, in the base frame: x forward, z up.
A refusal says what is wrong and what is allowed: change the request, do not repeat it.
When anything looks wrong, stop. This is no safety system."""
MANUAL = f"""\
{INSTRUCTIONS}

1. get_state tells where the arm is, list_positions and get_scene what there is to go to and to keep clear of.
2. plan_to_position, plan_to_joints and plan_to_pose answer a plan_id, the duration, a sampled path, how \
much of each limit is used and the closest distances. Nothing has moved.
3. preview draws the plan, rehearse runs it on a simulated copy of the robot and tells what goes wrong first.
4. execute runs it, if an operator has approved it (each approval is for one run) or if the settings of \
the robot draw a fence and the plan is within: a box for the TCP, a speed, a payload, planners, hours. The \
arm has to be where the plan begins; limits, scene and tool have to be as they were.
5. stop brings the arm to rest. why_did_it_stop tells why it stands still."""


class _Server(MCPServer):
    """One of whose resources and prompts the audit knows as it knows of tools, refused ones too."""

    async def read_resource(self, uri: Any, context: Any = None) -> Any:
        with _audited("MCP read", uri=str(uri)):
            return await super().read_resource(uri, context)

    async def get_prompt(
        self, name: str, arguments: dict[str, Any] | None = None, context: Any = None
    ) -> Any:
        with _audited("MCP prompt", prompt=name, arguments=str(arguments or {})):
            try:
                return await super().get_prompt(name, arguments, context)
            except ValueError as exc:  # the library would take it for a mistake of its own, and log where
                valid = [
                    f"{each.name}({', '.join(argument.name for argument in each.arguments or ())})"
                    for each in await self.list_prompts()
                ]
                sentence = (
                    f"there is no prompt {shown(name)} with these arguments; valid are: {', '.join(valid)}"
                )
                raise MCPError(INVALID_PARAMS, sentence) from exc


@contextmanager
def _audited(what: str, **details: object) -> Iterator[None]:
    outcome = "no answer"
    try:
        yield
        outcome = "ok"
    except Exception as exc:
        outcome = str(exc)
        raise
    finally:
        note(what, outcome, **details)


def session_manager(app: FastAPI) -> StreamableHTTPSessionManager:
    """What answers requests for `MCP`, each by itself: there are no sessions to be lost or stolen.

    Who may ask from where is settled before (`app.api.access`), so the library's own check of hosts is off.
    """
    server = _Server("cobot", version=version("cobot"), instructions=INSTRUCTIONS)
    tools.offer(server)
    _offer_resources(server, app)
    _offer_prompts(server)
    server.streamable_http_app(
        streamable_http_path=MCP,
        json_response=True,
        stateless_http=True,
        max_request_body_size=app.state.web.max_json_bytes,
        transport_security=TransportSecuritySettings(enable_dns_rebinding_protection=False),
    )
    return server.session_manager


def _offer_resources(server: MCPServer, app: FastAPI) -> None:
    @server.resource("cobot://manual", mime_type="text/plain")
    def manual() -> str:
        """How to use the tools."""
        return MANUAL

    @server.resource("cobot://robots", mime_type="application/json")
    def robots() -> str:
        """The robots: joints, base frame, named positions."""
        return json.dumps(
            {
                name: {
                    "joints": list(each.robot.limits.names),
                    "base_frame": each.robot.base_frame,
                    "positions": list(each.robot.positions),
                }
                for name, each in app.state.robots.items()
            }
        )

    @server.resource("cobot://limits/{robot}", mime_type="application/json")
    def limits(robot: str) -> str:
        """The limits of a robot's joints: rad, rad/s, rad/s², rad/s³, N·m (m, N of slides)."""
        if robot not in app.state.robots:
            raise ResourceError(f"there is no robot {robot!r}; valid are: {', '.join(app.state.robots)}")
        found = app.state.robots[robot].robot.limits
        table: dict[str, Any] = {
            name: getattr(found, name).tolist()
            for name in ("min_position", "max_position", *found.QUANTITIES)
        }
        return json.dumps({"joints": list(found.names), **table})


def _offer_prompts(server: MCPServer) -> None:
    @server.prompt()
    def move_safely(goal: str) -> str:
        """Go somewhere with a look beforehand."""
        return (
            f"Bring the arm to: {goal}. Read cobot://manual. Plan it, look at the preview, say in two "
            "sentences what the arm will do, how long it takes and how near it comes to anything, then "
            "execute the plan. If it is refused because nobody has approved it, "
            "tell me the plan_id and wait for me."
        )

    @server.prompt()
    def diagnose() -> str:
        """Find out why the arm does not move."""
        return (
            "Use why_did_it_stop, get_state and get_log. Say why the arm stands still, since when, and "
            "what a person has to do. Do not move it."
        )
