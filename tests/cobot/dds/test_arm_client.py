"""The facts of the process that speaks DDS for an arm, without a network.

Oracle: the sizes of what the test makes up, as a driver might.
"""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest

from cobot.dds import arm_client
from cobot.dds.arm_client import MAX_LISTED, MAX_TEXT, ArmClient, TrajectoryGoal
from rtloop.backends.ros2_control import words
from rtloop.backends.ros2_control.link import MAX_LINE, facts_of

CHARACTER = "\u4e2d"  # six bytes in JSON
SETTINGS: dict[str, Any] = {
    "joints": ["a", "b"],
    "action": None,
    "controller": None,
    "controller_manager": "/controller_manager",
    "joint_states": "/joint_states",
    "speed_scaling": "/scaling",
    "gpio": {"interfaces": []},
    "namespace": "",
}


@pytest.fixture
def client(monkeypatch: pytest.MonkeyPatch) -> ArmClient:
    class Messages:
        def to_cdr(self, *_: object) -> None: ...

    class Node:
        messages = Messages()

        def subscription(self, *_: object, **__: object) -> None: ...

    monkeypatch.setattr(arm_client, "ControllerLister", lambda *_: None)
    node: Any = Node()
    return ArmClient(SETTINGS, node)


def test_the_facts_stay_short_whatever_the_driver_says(client: ArmClient) -> None:
    """A longer line would end the process, and with it the motion."""
    kinds = {
        "type": "x" * 10_000,
        "state": "inactive",
        "joints": [CHARACTER * 1000] * 1000,
        "interfaces": ["i"],
    }
    named = [{**kinds, "name": f"{number}{CHARACTER * 10_000}"} for number in range(1000)]
    client._controllers = [*named, {**kinds, "name": "chosen"}]
    client._controller, client._listed_s = "chosen", float("inf")
    client._choices = ["/a" * 10_000] * 1000
    client._take_joints({"name": ["n" * 1000] * 1000, "position": [0.0] * 1000})
    client._goal = TrajectoryGoal()
    client._goal.facts |= {"status": 6, "error_code": -4, "error_string": "e" * 3_000_000}
    answer = asyncio.run(client._answer({"ask": "facts"}, b""))
    assert len(json.dumps(answer)) < MAX_LINE
    facts = facts_of(answer)
    assert facts.goal is not None
    assert facts.goal.error_string == "e" * MAX_TEXT
    assert facts.controllers is not None
    assert (facts.controllers[0]["name"], len(facts.controllers)) == ("chosen", MAX_LISTED)
    assert len(words.of_connection(facts, "")) < 2000
