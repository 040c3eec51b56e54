"""Vendor services called by their names, as transports do, on a robot of which only a part is there."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from types import SimpleNamespace
from typing import Any

from cobot_run import WAIT_S

from app.aubo.classes import REGISTRY
from app.aubo.registry import VendorAnswer, call
from app.services.devices.equipment import Equipment
from cobot.codes import Code
from cobot.robot.description import RobotDescription
from cobot.robot.tool import Tool, check_tool


class Caller:
    """Calls services of one class; keyword arguments are the fields of the request. Nobody has the control of
    a robot that has nothing to say about it.
    """

    def __init__(self, robot: Any, robot_class: str) -> None:
        if not hasattr(robot, "ownership"):
            robot.ownership = SimpleNamespace(stops=0, require_control=lambda: None)
        self._robot = robot
        self._class = robot_class
        assert any(key[0] == robot_class for key in REGISTRY)

    async def answer(self, method: str, /, **fields: Any) -> VendorAnswer:
        return await call(self._robot, self._class, method, fields)

    async def __call__(self, method: str, /, **fields: Any) -> Any:
        """The result of a call that succeeds."""
        answer = await self.answer(method, **fields)
        assert answer.code == Code.OK, f"{method}: {answer}"
        return answer.result

    async def fails(self, method: str, code: Code, /, **fields: Any) -> str:
        """The message of a call that fails with this code."""
        answer = await self.answer(method, **fields)
        assert answer.code == code, f"{method}: {answer}"
        assert answer.message
        return answer.message


def equipped(**parts: Any) -> Any:
    """A robot with equipment and no arm."""
    equipment = Equipment(
        *(parts.pop(name, None) for name in ("link", "stopping", "speed_override")), simulated=True
    )
    return SimpleNamespace(equipment=equipment, **parts)


class ToolHere:
    """The tool of a robot without processes: checked, and in its model at once."""

    def __init__(self, robot: RobotDescription) -> None:
        self._model = robot.model

    async def change(self, edit: Callable[[Tool], Tool], name: str) -> None:
        tool = edit(self._model.tool)
        check_tool(tool, 14.0, self._model.file_gravity)
        self._model.carry(tool)


async def eventually(condition: Callable[[], Any]) -> Any:
    """What the condition gave when it first held, in the running loop."""
    async with asyncio.timeout(WAIT_S):
        while not (value := condition()):
            await asyncio.sleep(0.005)
    return value


def run(work: Coroutine[Any, Any, None]) -> None:
    """In a loop of its own, within a generous time."""
    asyncio.run(asyncio.wait_for(work, 3 * WAIT_S))
