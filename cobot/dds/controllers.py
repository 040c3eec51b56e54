"""The controllers of a ros2_control system, read by a client of its controller manager."""

from __future__ import annotations

from typing import Any

from cobot.dds.caller import ServiceCaller
from cobot.dds.node import DdsNode, Message
from cobot.errors import CobotError, InputError

LIST = "controller_manager_msgs/srv/ListControllers"
LAYOUTS = tuple(f"controller_manager_msgs/srv/{name}ListControllers" for name in ("", "Humble", "Exporting"))
"""The fields of the answer differ between Jazzy, Humble, and releases without is_async. The type hash of a
service is not sent, so the layout that matches the answer is used.
"""
STATES = frozenset({"unconfigured", "inactive", "active", "finalized", "unknown"})
TRAJECTORIES = "JointTrajectoryController"
"""Ending of the type names of controllers that accept trajectories. For example, the type in UR's driver is
ScaledJointTrajectoryController.
"""

POSITIONS = ("ForwardCommandController", "JointGroupPositionController")
"""Endings of the type names of controllers that forward commands."""


class ControllerLister(ServiceCaller):
    """Requests the list of controllers from a controller manager."""

    def __init__(self, node: DdsNode, manager: str) -> None:
        super().__init__(node, f"{manager}/list_controllers", LIST)

    async def controllers(self) -> list[dict[str, Any]]:
        """Name, type, state and joints of each controller."""
        return [_controller(each) for each in (await self.call({}))["controller"]]

    def _read(self, payload: bytes) -> Message:
        for layout in LAYOUTS:
            try:
                answer = self._node.messages.from_cdr(f"{layout}_Response", payload)
            except (CobotError, AssertionError):
                continue
            if all(_plausible(each) for each in answer["controller"]):
                return answer
        raise InputError(f"the answer to {LIST} has a layout that cobot does not know")


def takes_trajectories(controller: dict[str, Any]) -> bool:
    """Whether a controller is a joint trajectory controller."""
    return str(controller["type"]).endswith(TRAJECTORIES)


def takes_positions(controller: dict[str, Any]) -> bool:
    """Whether a controller forwards positions to the drives as they arrive."""
    return str(controller["type"]).endswith(POSITIONS) and set(controller["interfaces"]) == {"position"}


def _plausible(controller: Message) -> bool:
    interfaces = [*controller["claimed_interfaces"], *controller["required_command_interfaces"]]
    return controller["state"] in STATES and all("/" in each for each in interfaces)


def _controller(answer: Message) -> dict[str, Any]:
    interfaces = [*answer["required_command_interfaces"], *answer["claimed_interfaces"]]
    joints = dict.fromkeys(each.rsplit("/", 1)[0] for each in interfaces)
    return {
        "name": answer["name"],
        "type": answer["type"],
        "state": answer["state"],
        "joints": list(joints),
        "interfaces": sorted({each.rsplit("/", 1)[-1] for each in interfaces}),
    }
