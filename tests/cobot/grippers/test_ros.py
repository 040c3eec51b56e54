"""The gripper of a ROS 2 driver, without a network; with rclpy: tests/e2e/realtime/test_ros_gripper.py.

Oracle: messages that the test makes up, as a driver might.
"""

from __future__ import annotations

import math
from typing import Any

import pytest
from pydantic import ValidationError

from cobot.grippers import GripperError
from cobot.grippers.contract.suite import NoPoints
from cobot.grippers.ros import RosGripper, RosOptions
from cobot.grippers.ros.link import DriverState

NEEDED = {"action": "/hand/cmd", "joint": "jaw", "open_position": 0.0, "open_width": 0.08}
KNUCKLE = {**NEEDED, "closed_position": 0.8, "max_effort": 12.0, "force": [5.0, 40.0]}


class Link:
    """A link that a test speaks on, and its clock."""

    def __init__(self) -> None:
        self.heard = DriverState()
        self.seconds = 10.0
        self.sent: list[dict[str, Any]] = []
        self.cancelled = 0

    def now_s(self) -> float:
        return self.seconds

    def open(self) -> None: ...

    def close(self) -> None: ...

    def send(self, goal: dict[str, Any]) -> None:
        self.heard.begin(self.seconds)
        self.sent.append(goal["command"])

    def cancel(self) -> None:
        self.cancelled += 1

    def hear(self, position: Any = 0.0, **content: Any) -> None:
        """Hear that the server is there, the joint, and then more."""
        for each in ({"what": "ready", "ready": True}, content):
            if each:
                self.heard.take(each, self.seconds)
        self.heard.take({"what": "joint", "position": position, "effort": None}, self.seconds)


@pytest.fixture
def link() -> Link:
    made = Link()
    made.hear()
    return made


def gripper(link: Link, options: dict[str, Any] = KNUCKLE) -> RosGripper:
    made = RosGripper(RosOptions.model_validate(options), NoPoints(), link, link)
    made.connect()
    return made


def test_widths_are_positions_of_the_joint_and_forces_efforts(link: Link) -> None:
    made = gripper(link)
    made.move(0.02, None, None)
    made.move(0.08, None, 30.0)
    assert link.sent == [
        {"position": pytest.approx(0.6), "max_effort": 12.0},
        {"position": pytest.approx(0.0), "max_effort": 30.0},
    ]
    link.hear(position=0.4)
    assert made.state().width == pytest.approx(0.04)
    other = gripper(link, {**KNUCKLE, "action_type": "ParallelGripperCommand", "max_effort": 0.0})
    other.move(0.04, None, None)
    assert link.sent[-1] == {"name": ["jaw"], "position": [pytest.approx(0.4)]}


def test_a_late_result_of_a_goal_that_was_replaced_is_not_the_new_goals(link: Link) -> None:
    made = gripper(link)
    made.close()
    made.open()
    for number, moving in ((1, True), (2, False)):
        values = {"stalled": False, "reached_goal": True}
        link.hear(what="result", number=number, status=4, values=values)
        assert made.state().moving is moving


def test_a_result_in_the_moment_in_which_a_goal_begins_is_not_the_new_goals(link: Link) -> None:
    """The results arrive in another thread."""
    made = gripper(link)
    made.close()

    class Content(dict[str, Any]):
        def __getitem__(self, key: str) -> Any:
            if key == "status":
                made.open()
            return super().__getitem__(key)

    aborted = Content(what="result", number=1, status=6, values={"stalled": False})
    link.heard.take(aborted, link.seconds)
    link.hear()
    assert made.state().moving


def test_the_time_for_the_answer_begins_when_the_goal_is_sent(link: Link) -> None:
    """The process sends a goal after the answer to the previous one."""
    made = gripper(link)
    made.close()
    link.seconds += 1.9
    link.hear(what="sent", number=1)
    link.seconds += 1.9
    link.hear()
    assert made.state().moving


def test_a_silence_is_always_the_same_error_so_that_it_is_logged_once(link: Link) -> None:
    made = gripper(link)
    said = set()
    for _ in range(3):
        link.seconds += 5.0
        with pytest.raises(GripperError, match="no joint jaw for more than 1 s; check") as raised:
            made.state()
        said.add(str(raised.value))
    assert len(said) == 1


@pytest.mark.parametrize("position", [math.nan, None, "wide", math.inf])
def test_a_position_that_is_no_number_is_an_error(link: Link, position: Any) -> None:
    made = gripper(link)
    link.hear(position=position)
    with pytest.raises(GripperError, match="the position of jaw is not a number"):
        made.state()


def test_a_result_of_a_goal_that_the_driver_does_not_know_is_an_error(link: Link) -> None:
    made = gripper(link)
    made.close()
    link.hear(what="result", number=1, status=0, values={"stalled": False, "reached_goal": False})
    with pytest.raises(GripperError, match="the status 0 for a result: the driver does not know the goal"):
        made.state()
    assert not made.state().moving, "the error is told once"


def test_an_answer_that_never_comes_is_an_error_after_its_time(link: Link) -> None:
    made = gripper(link)
    made.close()
    link.seconds += 1.9
    link.hear()
    assert made.state().moving
    link.seconds += 0.2
    link.hear()
    with pytest.raises(GripperError, match="/hand/cmd has not answered the goal within 2 s"):
        made.state()


def test_a_server_that_goes_away_is_an_error_that_names_the_domain(link: Link) -> None:
    made = gripper(link)
    link.heard.take({"what": "ready", "ready": False}, link.seconds)
    with pytest.raises(GripperError, match="there is no action /hand/cmd of type GripperCommand"):
        made.state()
    with pytest.raises(GripperError, match=r"compare ROS_DOMAIN_ID with ros\.domain_id"):
        made.open()
    assert link.sent == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"action": "hand/cmd"}, "action"),
        ({"action": "/hand cmd"}, "action"),
        ({"action_type": "Grip"}, "action_type"),
        ({"joint": ""}, "joint"),
        ({"open_position": math.nan}, "finite"),
        ({"closed_position": 0.0}, "open_position and closed_position are both 0"),
        ({"open_width": 0.0}, "open_width"),
        ({"force": [40.0, 5.0]}, "force is"),
        ({"result_timeout_s": 0.0}, "result_timeout_s"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_options_that_make_no_gripper_are_rejected(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        RosOptions.model_validate({**KNUCKLE, **options})
