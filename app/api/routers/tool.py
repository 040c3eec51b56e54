"""The tool on the flange."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
from fastapi import Request

from app.api.dependencies import Call
from app.api.errors import responses
from app.api.route import EndpointRouter
from app.api.schemas.scene import ObjectAnswer
from app.api.schemas.tool import ChangeTool, TcpFitAnswer, ToolAnswer, ToolTip, TouchedPoints
from app.api.solids import solid_of
from app.services.motion.tool import Edit
from cobot.access.roles import Role
from cobot.robot.model import RobotModel
from cobot.robot.tcp_fit import fit_tcp
from cobot.robot.tool import BARE, Tool
from cobot.types import Numbers7, Pose

router = EndpointRouter(tags=["robot"])


@router.endpoint("GET /robot/tool", Role.OBSERVER, timeout_s=1.5)
async def tool(request: Request) -> ToolAnswer:
    """Return the tool: its mass, TCP and shapes."""
    return _answer(Call(request).services.robot.model, [])


@router.endpoint(
    "POST /robot/tool", Role.PROGRAMMER, timeout_s=10.0, control=True, responses=responses(409, 503)
)
async def change_tool(body: ChangeTool, request: Request) -> ToolAnswer:
    """Set the tool. Either all changes are made, or none.

    Motions requested after the response are planned with the mass, the TCP and the shapes of this tool. The
    real-time process and the simulation include its weight. The tool is kept across restarts. It can be
    changed only while the arm is at rest.
    """
    call = Call(request)
    changed = await call.services.tool.change(await asyncio.to_thread(_edit, body), call.name)
    return _answer(call.services.robot.model, [str(each) for each in changed.contacts])


@router.endpoint("POST /robot/tool/calibrate", Role.OPERATOR, timeout_s=1.5)
async def calibrate_tool(body: TouchedPoints, request: Request) -> TcpFitAnswer:
    """Calculate the TCP from joint positions in which the tip touches one fixed point, by least squares.

    Nothing changes: send the position to POST /robot/tool as `tcp` with an orientation.
    """
    services = Call(request).services
    for index, joints in enumerate(body.points):  # measured positions may exceed a limit slightly
        services.goals.require_joints(np.array(joints), name=f"points[{index}]", checked=False)
    model = services.robot.model
    flange_in_tcp = model.flange_in_tcp()
    found = fit_tcp([model.forward(np.array(joints)) @ flange_in_tcp for joints in body.points])
    return TcpFitAnswer(
        position=found.tcp.tolist(),
        point=found.point.tolist(),
        error_m=found.error_m,
        errors_m=list(found.errors_m),
    )


def _edit(body: ChangeTool) -> Edit:
    given, changes = body.model_fields_set, cast(dict[str, Any], {})
    if body.name is not None:
        changes["name"] = body.name
    if body.mass is not None:
        changes["mass"] = body.mass
        changes["centre"] = tuple(body.centre or (0.0, 0.0, 0.0))
        changes["inertia"] = None if body.inertia is None else tuple(body.inertia)
    if "tcp" in given:
        changes["tcp"] = None if body.tcp is None else _tip_pose(body.tcp)
    if body.shapes is not None:
        changes["shapes"] = {
            name: solid_of(f"shapes.{name}", each, each.touch) for name, each in body.shapes.items()
        }
    if "gravity" in given:
        changes["gravity"] = None if body.gravity is None else tuple(body.gravity)
    return lambda tool: replace(replace(BARE, version=tool.version) if body.clear else tool, **changes)


def _tip_pose(tip: ToolTip) -> Numbers7:
    if tip.quaternion is None:
        return Pose.from_abc(tip.x, tip.y, tip.z, tip.a, tip.b, tip.c).numbers
    x, y, z, w = tip.quaternion
    return (tip.x, tip.y, tip.z, w, x, y, z)


def _answer(model: RobotModel, contacts: list[str]) -> ToolAnswer:
    tool: Tool = model.tool
    tcp = model.tcp_in_flange()
    return ToolAnswer(
        version=tool.version,
        name=tool.name,
        mass=tool.mass,
        centre=list(tool.centre),
        inertia=None if tool.inertia is None else list(tool.inertia),
        position=list(tcp[:3]),
        quaternion=_xyzw(tcp),
        shapes=[ObjectAnswer.of(name, replace(each, attached=True)) for name, each in tool.shapes.items()],
        gravity=model.gravity.tolist(),
        contacts=contacts,
    )


def _xyzw(pose: Sequence[float]) -> list[float]:
    return [*pose[4:], pose[3]]
