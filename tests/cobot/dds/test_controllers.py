"""The list of controllers, which has other fields in each release.

Oracle: the layouts as the documentation of controller_manager_msgs has them, written by rosbags.
"""

from __future__ import annotations

from typing import Any

import pytest

from cobot.dds.controllers import ControllerLister, takes_trajectories
from cobot.errors import InputError
from cobot.ros.messages import Messages

JOINTS = ["joint1", "joint2"]


class Reader(ControllerLister):
    """Only reads."""

    def __init__(self) -> None:
        self._node: Any = type("Node", (), {"messages": Messages()})()


def controller(state: str) -> dict[str, Any]:
    interfaces = [f"{joint}/position" for joint in JOINTS]
    return {
        "name": "arm",
        "state": state,
        "type": "joint_trajectory_controller/JointTrajectoryController",
        "claimed_interfaces": interfaces if state == "active" else [],
        "required_command_interfaces": interfaces,
        "required_state_interfaces": interfaces,
        "is_chainable": False,
    }


@pytest.mark.parametrize("layout", ["", "Humble", "Exporting"])
@pytest.mark.parametrize("state", ["active", "inactive"])
def test_each_release_s_layout_is_read(layout: str, state: str) -> None:
    messages = Messages()
    more = {} if layout else {"update_rate": 250}
    type_ = f"controller_manager_msgs/srv/{layout}ListControllers_Response"
    content = messages.to_cdr(type_, {"controller": [{**controller(state), **more}]})
    (found,) = Reader()._read(content)["controller"]
    assert (found["name"], found["state"]) == ("arm", state)
    assert found["required_command_interfaces"] == ["joint1/position", "joint2/position"]
    assert takes_trajectories(found)


def test_another_layout_is_an_error() -> None:
    messages = Messages()
    content = messages.to_cdr("std_msgs/msg/String", {"data": "something else"})
    with pytest.raises(InputError, match="a layout that cobot does not know"):
        Reader()._read(content)
