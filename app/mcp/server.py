"""The MCP server of this service: its tools, resources and prompts."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from mcp import MCPError
from mcp.server.mcpserver import Context, MCPServer
from mcp.server.mcpserver.exceptions import ResourceError, ToolError
from mcp.server.streamable_http_manager import StreamableHTTPSessionManager
from mcp.server.transport_security import TransportSecuritySettings
from mcp_types import INVALID_PARAMS, CallToolResult, InputRequiredResult, TextContent
from mcp_types import Tool as MCPTool

from app.api.middleware.access import IDENTITY
from app.mcp import tools
from app.mcp.arguments import arguments_of, require_valid
from app.mcp.endpoint import MAX_BODY_BYTES
from cobot.access.roles import require
from cobot.addresses import MCP
from cobot.audit import note, report_refusal
from cobot.codes import code_of
from cobot.errors import CobotError, NotFoundError
from cobot.strict import shown

if TYPE_CHECKING:
    from fastapi import FastAPI

INSTRUCTIONS = """\
You look at a robot arm, plan its motions and, where that is permitted, run them.
Plan first, look at the preview, tell a person what the arm will do, then execute the plan.
Lengths are in m, angles in rad, in the base frame: x forward, z up.
A rejection says what is wrong and what is allowed: change the request, do not repeat it.
If anything looks wrong, stop. This is not a safety system."""
MANUAL = f"""\
{INSTRUCTIONS}

1. get_state reports where the arm is, list_positions the named positions, get_scene the obstacles.
2. plan_to_position, plan_to_joints, plan_to_pose, plan_path and plan_arc answer with a plan_id, the \
duration, a sampled path, how much of each limit is used and the closest distances. Nothing has moved.
3. preview draws the plan, rehearse runs it on a simulated copy of the robot and reports the first problem.
4. execute runs it if an operator has approved it (each approval is for one run), or if the robot's \
settings define a fence and the plan is within it: a box for the TCP, a speed, a payload, planners, hours. \
The arm must be at the start of the plan, and limits, scene and tool must not have changed.
5. get_gripper reports what the fingers hold. plan_gripper_move, plan_gripper_grasp, plan_gripper_release \
and plan_gripper_home also answer with a plan_id. A gripper plan always needs an operator's approval, and \
the arm must not have moved since. A grasp that attaches an object changes the scene, so plan the next \
motion after it.
6. stop stops the arm, stop_gripper the fingers. why_did_it_stop reports why the arm does not move."""


class AgentServer(MCPServer[Any]):
    """The MCP library's server with cobot's tools. It checks the role before the arguments, describes invalid
    arguments briefly, and records each call in the audit log, including rejected ones.
    """

    def __init__(self) -> None:
        super().__init__("cobot", version=version("cobot"), instructions=INSTRUCTIONS)
        self._known = {tool.__name__: (role, arguments_of(tool)) for tool, role, _ in tools.TOOLS}
        for tool, _, kind in tools.TOOLS:
            self.add_tool(tool, annotations=kind, structured_output=False)

    async def list_tools(self) -> list[MCPTool]:
        """The list of tools, with the schemas that validate calls."""
        return [
            each.model_copy(update={"input_schema": self._known[each.name][1].model_json_schema()})
            for each in await super().list_tools()
        ]

    async def call_tool(
        self, name: str, arguments: dict[str, Any], context: Context[Any, Any] | None = None
    ) -> CallToolResult | InputRequiredResult:
        """Call a tool. The result of a rejected call has `is_error`, the reason in words and its code."""
        if name not in self._known:
            valid = ", ".join(self._known)
            return refusal(NotFoundError(f"there is no tool {shown(name)}; valid names: {valid}"))
        role, known = self._known[name]
        outcome, code = "no answer", ""
        try:
            request = None if context is None else context.request_context.request
            assert request is not None  # this transport uses only HTTP
            require(request.scope[IDENTITY], role)
            require_valid(known, name, arguments)
            answer = await super().call_tool(name, arguments, context)
            outcome = "ok"
        except CobotError as exc:
            outcome, code = str(exc), exc.code
            return refusal(exc)
        except ToolError as exc:
            error = refused_by(exc)
            if error is None:
                raise
            outcome, code = str(exc.__cause__ or exc), error.code
            return refusal(error, str(exc))
        finally:
            if code and name == tools.execute.__name__:
                report_refusal(f"MCP {name}", code, outcome)
            note(
                f"MCP {name}",
                outcome,
                **{key: arguments[key] for key in known.model_fields if key in arguments},
            )
        return answer

    async def read_resource(self, uri: Any, context: Any = None) -> Any:
        with _audit("MCP read", uri=str(uri)):
            return await super().read_resource(uri, context)

    async def get_prompt(
        self, name: str, arguments: dict[str, Any] | None = None, context: Any = None
    ) -> Any:
        with _audit("MCP prompt", prompt=name, arguments=str(arguments or {})):
            try:
                return await super().get_prompt(name, arguments, context)
            # otherwise the library would treat it as an internal error, and log where it
            # occurred
            except ValueError as exc:
                valid = [
                    f"{each.name}({', '.join(argument.name for argument in each.arguments or ())})"
                    for each in await self.list_prompts()
                ]
                sentence = (
                    f"there is no prompt {shown(name)} with these arguments; valid names: {', '.join(valid)}"
                )
                raise MCPError(INVALID_PARAMS, sentence) from exc


def refused_by(exc: BaseException | None) -> CobotError | None:
    """Return the error behind a tool's error; None for a programming error in the tool."""
    return exc if exc is None or isinstance(exc, CobotError) else refused_by(exc.__cause__)


def refusal(error: CobotError, text: str = "") -> CallToolResult:
    """Return the result of a rejected call: a sentence, and its code as structured content.

    Args:
        text: the sentence; if it is empty, the text of the error is used.
    """
    sentence = text or str(error)
    return CallToolResult(
        content=[TextContent(type="text", text=sentence)],
        structured_content={"detail": sentence, "code": error.code, "number": int(code_of(error))},
        is_error=True,
    )


@contextmanager
def _audit(what: str, **details: object) -> Iterator[None]:
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
    """The MCP library's manager of requests, without sessions, because sessions could be lost or stolen.

    The library's own check of hosts is off, because `app.api.middleware.access` has already checked hosts and
    clients.
    """
    server = AgentServer()
    _offer_resources(server, app)
    _offer_prompts(server)
    server.streamable_http_app(
        streamable_http_path=MCP,
        json_response=True,
        stateless_http=True,
        max_request_body_size=MAX_BODY_BYTES,
        transport_security=TransportSecuritySettings(enable_dns_rebinding_protection=False),
    )
    return server.session_manager


def _offer_resources(server: MCPServer, app: FastAPI) -> None:
    @server.resource("cobot://manual", mime_type="text/plain")
    def manual() -> str:
        """Instructions for using the tools."""
        return MANUAL

    @server.resource("cobot://robots", mime_type="application/json")
    def robots() -> str:
        """The robots, with their joints, base frame and named positions."""
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
        """The limits of a robot's joints: rad, rad/s, rad/s², rad/s³, N·m; for sliding joints m and N."""
        if robot not in app.state.robots:
            raise ResourceError(
                f"there is no robot {shown(robot)}; valid names: {', '.join(app.state.robots)}"
            )
        found = app.state.robots[robot].robot.limits
        table: dict[str, Any] = {
            name: getattr(found, name).tolist()
            for name in ("min_position", "max_position", *found.QUANTITIES)
        }
        return json.dumps({"joints": list(found.names), **table})


def _offer_prompts(server: MCPServer) -> None:
    @server.prompt()
    def move_safely(goal: str) -> str:
        """Move to a goal, with a preview first."""
        return (
            f"Bring the arm to: {goal}. Read cobot://manual. Plan it, look at the preview, say in two "
            f"sentences what the arm will do, how long it takes and how near it comes to obstacles, then "
            "execute the plan. If it is refused because it is not approved, "
            "tell me the plan_id and wait for me."
        )

    @server.prompt()
    def diagnose() -> str:
        """Find out why the arm does not move."""
        return (
            "Use why_did_it_stop, get_state and get_log. Say why the arm does not move, since when, and "
            "what a person has to do. Do not move it."
        )
