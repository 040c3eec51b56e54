"""`ros2 param` against our node, by a node on Fast DDS. Oracle: rcl_interfaces' messages as `rosbags` defines
them, and what rclcpp answers (types, ranges, one result per parameter)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from dds_peers import own_domain
from node_rig import NodeRig
from ros_peer import Peer

from cobot.config import Settings
from cobot.dds.options import options
from cobot.dds.parameters import Parameters, ParameterType

MANUAL = {
    "ament_prefix_env",
    "ld_library_env",
    "rmw_imp",
    "domin_id",
    "localhost_only",
    "legacy_names",
    "debug",
    "enable_fjt_action",
    "fjt_mode",
    "fjt_time",
    "fjt_send_period",
    "rmw_qos_file",
}
"""The options of the manual's chapter 2.5."""


class Sent:
    """In the gateway's place: what is published on the graph."""

    def __init__(self) -> None:
        self.there = True
        self.messages: list[tuple[str, str]] = []

    def publish(self, topic: str, type_: str, message: dict[str, Any]) -> bool:
        self.messages.append((topic, message["data"]))
        return self.there


class Tool:
    """What `ros2 param` calls."""

    def __init__(self, rig: NodeRig, peer: Peer, sent: Sent) -> None:
        self.rig = rig
        self.peer = peer
        self.sent = sent

    def call(self, name: str, type_: str, request: dict[str, Any]) -> dict[str, Any]:
        client = self.peer.client(f"/cobot/{name}", f"rcl_interfaces/srv/{type_}").until_ready()
        return client.call(request)

    def set(self, **values: Any) -> list[dict[str, Any]]:
        parameters = [{"name": name, "value": value(each)} for name, each in values.items()]
        return self.call("set_parameters", "SetParameters", {"parameters": parameters})["results"]

    def get(self, *names: str) -> list[dict[str, Any]]:
        return self.call("get_parameters", "GetParameters", {"names": list(names)})["values"]


def value(content: Any) -> dict[str, Any]:
    """rcl_interfaces/msg/ParameterValue."""
    match content:
        case bool():
            return {"type": 1, "bool_value": content}
        case int():
            return {"type": 2, "integer_value": content}
        case float():
            return {"type": 3, "double_value": content}
    return {"type": 4, "string_value": content}


@pytest.fixture(scope="module")
def tool(settings: Settings) -> Iterator[Tool]:
    sent: Any = Sent()
    with own_domain() as domain, NodeRig(domain) as rig, Peer(domain, rig.messages) as peer:
        rig.do(lambda: Parameters(rig.node, options(settings, [], sent)))
        yield Tool(rig, peer, sent)


def test_all_options_of_the_manual_are_parameters(tool: Tool) -> None:
    names = tool.call("list_parameters", "ListParameters", {})["result"]["names"]
    assert set(names) >= MANUAL
    assert names == sorted(names)
    listed = tool.call("list_parameters", "ListParameters", {"prefixes": ["fjt_mode", "fjt"]})
    assert listed["result"]["names"] == ["fjt_mode"]


def test_values_have_their_types(tool: Tool, settings: Settings) -> None:
    got = tool.get("domin_id", "localhost_only", "debug", "fjt_time", "rmw_imp", "nothing")
    types = [
        ParameterType.INTEGER,
        ParameterType.INTEGER,
        ParameterType.BOOL,
        ParameterType.DOUBLE,
        ParameterType.STRING,
        ParameterType.NOT_SET,
    ]
    assert [each["type"] for each in got] == types
    assert (got[0]["integer_value"], got[1]["integer_value"]) == (settings.ros.domain_id, 1)
    names = {"names": ["debug", "fjt_mode", "nothing"]}
    packed = tool.call("get_parameter_types", "GetParameterTypes", names)["types"]
    assert tool.peer.messages.octets(packed) == bytes(
        [ParameterType.BOOL, ParameterType.INTEGER, ParameterType.NOT_SET]
    )


def test_descriptions_tell_what_may_be_set(tool: Tool) -> None:
    names = ["fjt_mode", "joint_states_rate_hz", "domain_id", "nothing"]
    mode, rate, domain, nothing = tool.call("describe_parameters", "DescribeParameters", {"names": names})[
        "descriptors"
    ]
    assert mode["integer_range"] == [{"from_value": 0, "to_value": 7, "step": 1}]
    assert rate["floating_point_range"] == [{"from_value": 1.0, "to_value": 1000.0, "step": 0.0}]
    assert [mode["read_only"], domain["read_only"]] == [False, True]
    assert "ros.domain_id" in domain["additional_constraints"]
    assert (nothing["name"], nothing["type"]) == ("nothing", ParameterType.NOT_SET)


@pytest.mark.parametrize(
    "name", sorted(MANUAL - {"debug", "enable_fjt_action", "fjt_mode", "fjt_time", "fjt_send_period"})
)
def test_what_is_fixed_says_why(tool: Tool, name: str) -> None:
    before = tool.get(name)
    (result,) = tool.set(**{name: 3})
    assert not result["successful"]
    assert result["reason"].startswith(f"{name} cannot be set while cobot runs: ")
    assert tool.get(name) == before


@pytest.mark.parametrize(
    ("name", "wrong", "reason"),
    [
        ("fjt_mode", -1, "fjt_mode must be from 0 to 7, got -1"),
        ("fjt_mode", 8, "fjt_mode must be from 0 to 7, got 8"),
        ("fjt_mode", 1.0, "fjt_mode is of type INTEGER, got DOUBLE"),
        ("fjt_time", -0.1, "fjt_time must be from 0 to 10, got -0.1"),
        ("fjt_time", float("nan"), "fjt_time must be from 0 to 10, got nan"),
        ("joint_states_rate_hz", 2000.0, "joint_states_rate_hz must be from 1 to 1000, got 2000"),
        ("enable_fjt_action", "yes", "enable_fjt_action is of type BOOL, got STRING"),
        ("nothing", 1, "there is no parameter 'nothing'; valid names: "),
    ],
)
def test_a_wrong_value_is_refused_with_the_reason(tool: Tool, name: str, wrong: Any, reason: str) -> None:
    (result,) = tool.set(**{name: wrong})
    assert not result["successful"]
    assert result["reason"].startswith(reason)


def test_the_action_s_options_reach_the_robot_as_fjt_control_and_are_told(
    tool: Tool, settings: Settings
) -> None:
    events = tool.peer.subscription("/parameter_events", "rcl_interfaces/msg/ParameterEvent")
    events.until_matched()
    tool.rig.until_known("rt/parameter_events")
    tool.sent.messages.clear()
    results = tool.set(enable_fjt_action=True, fjt_mode=5, fjt_time=0.02, fjt_send_period=0.004)
    assert [each["successful"] for each in results] == [True] * 4
    topic = f"/{settings.robot.name}/joint_cmd"
    assert tool.sent.messages == [
        (topic, '{"type": "fjt_control", "enable_fjt_action": true}'),
        (topic, '{"type": "fjt_control", "fjt_mode": 5}'),
        (topic, '{"type": "fjt_control", "fjt_time": 0.02}'),
        (topic, '{"type": "fjt_control", "fjt_send_period": 0.004}'),
    ]
    told = [events.get()["changed_parameters"][0]["name"] for _ in range(4)]
    assert told == ["enable_fjt_action", "fjt_mode", "fjt_time", "fjt_send_period"]
    assert tool.get("fjt_mode")[0]["integer_value"] == 5


def test_all_or_none_are_set_atomically(tool: Tool) -> None:
    before = tool.get("debug", "fjt_mode")
    parameters = [{"name": "debug", "value": value(True)}, {"name": "fjt_mode", "value": value(9)}]
    answer = tool.call("set_parameters_atomically", "SetParametersAtomically", {"parameters": parameters})
    assert not answer["result"]["successful"]
    assert tool.get("debug", "fjt_mode") == before


def test_what_did_not_reach_the_robot_is_not_set(tool: Tool) -> None:
    before = tool.get("fjt_mode")
    tool.sent.there = False
    (result,) = tool.set(fjt_mode=2)
    tool.sent.there = True
    assert not result["successful"]
    assert "not connected" in result["reason"]
    assert tool.get("fjt_mode") == before
