"""rosbridge v2 without a network: messages as dicts into a connection, texts out of its outbox.

Oracle: the protocol's document (rosbridge_suite, branch ros2, ROSBRIDGE_PROTOCOL.md), by hand.
"""

from __future__ import annotations

import asyncio
import json
import logging
import math
import re
import uuid
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.graph.actions import GoalHandle, GoalStatus, RejectedGoalError
from app.graph.graph import GRAPH_TOPIC, Graph
from app.rosbridge import connection as connections
from app.rosbridge import outbox
from app.rosbridge.connection import MAX_LATCHED, RosbridgeConnection
from app.rosbridge.operations import OPERATIONS
from app.rosbridge.rosapi import DEFINITIONS, add_rosapi
from cobot.errors import ExecutionError, InputError
from cobot.ros.messages import Messages

STRING = "std_msgs/msg/String"


class Client(RosbridgeConnection):
    """A connection whose texts are read at once."""

    def ask(self, op: str, **content: Any) -> None:
        self.take({"op": op, **content})

    def got(self) -> list[dict[str, Any]]:
        return [json.loads(text) for text in self.outbox.texts()]

    async def next(self) -> dict[str, Any]:
        """The one message that comes next."""
        while not (texts := self.got()):
            await asyncio.sleep(0)
        (message,) = texts
        return message

    async def answer(self, op: str, **content: Any) -> dict[str, Any]:
        self.ask(op, **content)
        return await self.next()


class Waiting:
    """An action that is accepted, gives feedback once, and waits to be cancelled."""

    name = "/wait"
    type_ = "aubo_interfaces/action/Wait"
    definition = "bool good\n---\nfloat64 took\n---\nint32 now\n"

    async def execute(self, goal: dict[str, Any], handle: GoalHandle) -> dict[str, Any]:
        if not goal["good"]:
            raise RejectedGoalError("the goal is not good")
        handle.accept()
        handle.feedback({"now": 1})
        await handle.cancel_requested.wait()
        handle.status = GoalStatus.CANCELED
        return {"took": math.nan}


def live(test: Callable[[Graph, Client, Client], Awaitable[None]]) -> None:
    """Run a test in an event loop, with a graph and two clients."""

    async def run() -> None:
        graph = Graph(Messages())
        clients = Client(graph, "one"), Client(graph, "two")
        await asyncio.wait_for(test(graph, *clients), 60.0)
        for client in clients:
            await client.close()
        assert not [
            task for task in asyncio.all_tasks() if "_execute_goal" in repr(task)
        ] or await asyncio.sleep(0.0)
        await graph.close()

    asyncio.run(run())


def errors(client: Client) -> list[str]:
    return [message["msg"] for message in client.got() if message["op"] == "status"]


def test_what_one_publishes_the_other_gets() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        two.ask("subscribe", topic="/chat", type="std_msgs/String")
        one.ask("advertise", topic="chat", type=STRING)
        one.ask("publish", topic="chat", msg={"data": "hello"})
        assert two.got() == [{"op": "publish", "topic": "/chat", "msg": {"data": "hello"}}]
        assert one.got() == []
        two.ask("unsubscribe", topic="/chat")
        one.ask("publish", topic="chat", msg={"data": "hello"})
        assert two.got() == []
        one.ask("unadvertise", topic="chat")
        assert graph.topics().keys() == {GRAPH_TOPIC}

    live(test)


@pytest.mark.parametrize(
    ("op", "content"),
    [
        ("advertise", {"topic": "/wait/goal", "type": "control_msgs/FollowJointTrajectoryActionGoal"}),
        ("advertise", {"topic": "wait/cancel", "type": "actionlib_msgs/GoalID"}),
        ("subscribe", {"topic": "/wait/status", "type": "actionlib_msgs/GoalStatusArray"}),
        ("subscribe", {"topic": "/wait/result"}),
        ("publish", {"topic": "/wait/goal", "msg": {"goal": {}}}),
        ("subscribe", {"topic": "/other/feedback", "type": "control_msgs/PointHeadActionFeedback"}),
    ],
)
def test_a_client_of_ros_1_actions_is_told_the_operation_for_goals(op: str, content: dict[str, Any]) -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        graph.add_action(Waiting())
        one.ask(op, id="asked", **content)
        (status,) = one.got()
        assert (status["op"], status["level"], status["id"]) == ("status", "error", "asked")
        assert "send the operation send_action_goal" in status["msg"]
        assert "/wait" in status["msg"]
        assert content["topic"] not in graph.topics()

    live(test)


def test_a_topic_named_goal_of_no_action_is_like_any_other() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        graph.add_action(Waiting())
        one.ask("advertise", topic="/mission/goal", type=STRING)
        one.ask("advertise", topic="/wait/other", type=STRING)
        assert errors(one) == []

    live(test)


def test_subscriptions_and_advertisements_are_counted_by_their_ids() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        for number in ("1", "2"):
            one.ask("advertise", topic="/a", type=STRING, id=number)
            two.ask("subscribe", topic="/a", id=number)
        one.ask("unadvertise", topic="/a", id="1")
        two.ask("unsubscribe", topic="/a", id="1")
        one.ask("publish", topic="/a", msg={"data": "x"})
        assert len(two.got()) == 1
        two.ask("unsubscribe", topic="/a", id="2")
        one.ask("unadvertise", topic="/a", id="2")
        assert graph.type_of("/a") is None

    live(test)


def test_a_topic_that_somebody_has_may_be_published_without_being_advertised() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        two.ask("subscribe", topic="/a", type=STRING)
        one.ask("publish", topic="/a", msg={"data": "x"})
        assert two.got()[0]["msg"] == {"data": "x"}
        one.ask("publish", topic="/b", msg={})
        assert "'/b' is not advertised" in errors(one)[0]

    live(test)


def test_no_type_is_guessed_where_subscriptions_differ_and_a_guess_is_corrected() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        two.ask("subscribe", topic="/a", type="std_msgs/msg/Int8")
        one.ask("publish", topic="/a", msg={"data": 1})  # the one type in use
        one.ask("advertise", topic="/a", type=STRING)
        one.ask("publish", topic="/a", msg={"data": "x"})
        assert errors(one) == []
        got = {each["op"]: each["msg"] for each in two.got()}
        assert got["publish"] == {"data": 1}
        assert "/a is advertised as std_msgs/msg/String" in got["status"]
        two.ask("subscribe", topic="/b", type="std_msgs/msg/Int8")
        one.ask("subscribe", topic="/b", type=STRING)
        one.ask("publish", topic="/b", msg={"data": "x"})
        (refusal,) = errors(one)
        assert "'/b' is subscribed as std_msgs/msg/Int8 and as std_msgs/msg/String: advertise it" in refusal
        one.ask("advertise", topic="/b", type=STRING)
        one.ask("publish", topic="/b", msg={"data": "x"})
        assert [each["msg"] for each in one.got() if each["op"] == "publish"] == [{"data": "x"}]

    live(test)


def test_a_gateway_advertises_a_topic_with_each_type_that_is_subscribed() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        two.ask("subscribe", topic="/a", type=STRING)
        one.ask("cobot_gateway")
        for type_, value in (("std_msgs/msg/Int8", 1), (STRING, "x")):
            one.ask("advertise", topic="/a", type=type_)
            one.ask("publish", topic="/a", type=type_, msg={"data": value})
        assert [each["msg"] for each in two.got()] == [{"data": "x"}]
        one.ask("unadvertise", topic="/a", type="std_msgs/msg/Int8")
        one.ask("publish", topic="/a", type=STRING, msg={"data": "y"})
        assert [each["msg"] for each in two.got()] == [{"data": "y"}]
        one.ask("unadvertise", topic="/a")
        assert graph.ends_of("/a") == (0, 1)
        assert errors(one) == []

    live(test)


def test_latched_messages_are_bounded_and_given_back() -> None:
    async def test(graph: Graph, one: Client, other: Client) -> None:
        for number in range(2):
            one.ask("advertise", topic=f"/a{number}", type=STRING, latch=True)
        message = {"op": "publish", "topic": "/a0", "msg": {"data": "first"}}
        one.take(message, MAX_LATCHED)
        one.take(message, MAX_LATCHED)  # in place of the first one
        assert one.got() == []
        one.take({**message, "topic": "/a1"}, 1)
        (refused,) = one.got()
        assert f"{MAX_LATCHED} are already stored, and this message has 1" in refused["msg"]
        publisher, _ = one._publishers["/a0", None]
        assert publisher.last == {"data": "first"}
        one.ask("unadvertise", topic="/a0")
        assert publisher.last is None
        one.take({**message, "topic": "/a1"}, MAX_LATCHED)
        assert one.got() == []

    live(test)


def test_what_is_latched_comes_late() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        one.ask("advertise", topic="/a", type=STRING, latch=True)
        one.ask("publish", topic="/a", msg={"data": "x"})
        two.ask("subscribe", topic="/a")
        assert len(two.got()) == 1

    live(test)


def test_numbers_that_are_none_are_null_both_ways() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        two.ask("subscribe", topic="/a", type="std_msgs/msg/Float64MultiArray")
        one.ask("publish", topic="/a", msg={"data": [None, 1.0]})
        assert two.got()[0]["msg"]["data"] == [None, 1.0]

    live(test)


def test_the_oldest_of_a_topic_is_dropped_and_no_answer() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        add_rosapi(graph)
        two.ask("subscribe", topic="/a", type=STRING, queue_length=3)
        two.ask("call_service", service="/rosapi/nodes", id="1")
        for number in range(1000):
            one.ask("publish", topic="/a", msg={"data": str(number)})
        await asyncio.sleep(0.01)
        answer, *messages = two.got()
        assert answer == {
            "op": "service_response",
            "id": "1",
            "service": "/rosapi/nodes",
            "values": {"nodes": ["/cobot"]},
            "result": True,
        }
        assert [message["msg"]["data"] for message in messages] == ["997", "998", "999"]

    live(test)


def test_a_throttled_topic_comes_at_its_rate() -> None:
    """Against the event loop's own clock, which the test moves, by numbers that a float has exactly."""

    async def test(graph: Graph, one: Client, two: Client) -> None:
        loop = asyncio.get_running_loop()
        now_s = float(int(loop.time()))
        loop.time = lambda: now_s  # type: ignore[method-assign]
        one.ask("subscribe", topic="/a", type=STRING, throttle_rate=15.625)
        two.ask("subscribe", topic="/a", type=STRING, throttle_rate=15.625, queue_length=5)
        publisher = graph.advertise("/a", STRING, owner=0)
        sparse, queued = [], []
        for number in range(100):
            publisher.publish({"data": str(number)})
            sparse += [int(message["msg"]["data"]) for message in one.got()]
            queued += [int(message["msg"]["data"]) for message in two.got()]
            now_s += 1.0 / 256.0
        assert sparse == list(range(0, 100, 4))
        assert len(queued) == 25
        assert queued[-1] >= 99 - 5 - 4
        del loop.time  # type: ignore[method-assign]

    live(test)


def test_what_waits_because_of_its_rate_is_sent_by_itself() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        two.ask("subscribe", topic="/a", type=STRING, throttle_rate=5, queue_length=5)
        for number in range(3):
            one.ask("publish", topic="/a", msg={"data": str(number)})
        got: list[str] = []
        while len(got) < 3:
            await two.outbox.wake.wait()
            two.outbox.wake.clear()
            got += [message["msg"]["data"] for message in two.got()]
        assert got == ["0", "1", "2"]

    live(test)


def test_services_are_called_with_names_or_without() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        async def answer(request: dict[str, Any]) -> dict[str, Any]:
            return {"success": request["data"], "message": "done"}

        graph.add_service("/s", "std_srvs/srv/SetBool", answer, owner=0)
        for args, success in (
            ({"data": True}, True),
            ([True], True),
            ({}, False),
            (None, False),
            ([], False),
        ):
            got = await one.answer("call_service", service="/s", args=args, id=7)
            assert got["values"] == {"success": success, "message": "done"}
            assert (got["result"], got["id"]) == (True, 7)

    live(test)


def test_a_call_that_fails_says_why() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        async def fail(request: dict[str, Any]) -> dict[str, Any]:
            raise ExecutionError("it does not work")

        async def broken(request: dict[str, Any]) -> dict[str, Any]:
            raise RuntimeError("secret")

        async def silent(request: dict[str, Any]) -> dict[str, Any]:
            await asyncio.Event().wait()
            return {}

        for name, function in (("/fail", fail), ("/broken", broken), ("/silent", silent)):
            graph.add_service(name, "std_srvs/srv/SetBool", function, owner=0)
        for content, sentence in (
            ({"service": "/fail"}, "it does not work"),
            ({"service": "/broken"}, "its log has the details"),
            ({"service": "/silent", "timeout": 0.01}, "has not answered within 0.01 s"),
            ({"service": "/none"}, "there is no service '/none'"),
            ({"service": "/fail", "args": {"x": 1}}, "unknown key 'x'"),
            ({"service": "/fail", "args": [1, 2]}, "has 1 fields, got 2 values"),
            ({"service": "/fail", "args": [1]}, "must be true or false"),
        ):
            got = await one.answer("call_service", **content)
            assert got["op"] == "service_response"
            assert sentence in got["values"]
            assert got["result"] is False
            assert "id" not in got

    live(test)


def test_calls_under_way_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "MAX_PENDING", 3)

    async def test(graph: Graph, one: Client, two: Client) -> None:
        go = asyncio.Event()

        async def slow(request: dict[str, Any]) -> dict[str, Any]:
            await go.wait()
            return {}

        graph.add_service("/slow", "std_srvs/srv/Empty", slow, owner=0)
        for number in range(4):
            one.ask("call_service", service="/slow", id=number)
        assert "this client has 3 calls in progress, which is the maximum" in errors(one)[0]
        go.set()
        await asyncio.sleep(0.01)
        assert [message["id"] for message in one.got()] == [0, 1, 2]

    live(test)


def test_a_client_offers_a_service_to_another() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        one.ask("advertise_service", service="/s", type="std_srvs/SetBool")
        two.ask("call_service", service="/s", args={"data": True}, id="a")
        asked = await one.next()
        assert (asked["op"], asked["service"], asked["args"]) == ("call_service", "/s", {"data": True})
        one.ask("service_response", service="/s", id="no", values={}, result=True)
        assert "no call 'no' of /s is waiting for an answer" in errors(one)[0]
        one.ask("service_response", service="/s", id=asked["id"], values={"message": "m"}, result=True)
        assert (await two.next())["values"] == {"success": False, "message": "m"}
        for values, result, sentence in (
            ("broken", False, "/s failed: 'broken'"),
            ({"success": 3}, True, "success: must be true or false"),
            (None, True, "must be an object"),
        ):
            two.ask("call_service", service="/s")
            one.ask(
                "service_response", service="/s", id=(await one.next())["id"], values=values, result=result
            )
            assert sentence in (await two.next())["values"]
        two.ask("call_service", service="/s")
        await one.next()
        one.ask("unadvertise_service", service="/s")
        assert "is no longer offered" in (await two.next())["values"]
        assert "/s" not in graph.services

    live(test)


def test_what_a_client_had_ends_with_it() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        graph.add_action(Waiting())
        one.ask("advertise", topic="/a", type=STRING)
        one.ask("subscribe", topic="/b", type=STRING)
        one.ask("advertise_service", service="/s", type="std_srvs/SetBool")
        one.ask("advertise_action", action="/act", type="control_msgs/action/FollowJointTrajectory")
        one.ask("cobot_gateway")
        one.ask("send_action_goal", action="/wait", args={"good": True}, id="g")
        two.ask("call_service", service="/s")
        two.ask("send_action_goal", action="/act", id="h")
        asked: set[str] = set()
        while asked != {"call_service", "send_action_goal"}:
            asked |= {message["op"] for message in one.got()}
            await asyncio.sleep(0)
        statuses: list[int] = []
        graph.subscribe(
            "/wait/_action/status", None, lambda m: statuses.append(m["status_list"][0]["status"]), owner=0
        )
        await one.close()
        while statuses[-1:] != [5]:
            await asyncio.sleep(0)
        answers = {}
        while len(answers) < 2:
            answers |= {message["op"]: message for message in two.got()}
            await asyncio.sleep(0)
        assert "is no longer offered" in answers["service_response"]["values"]
        assert (answers["action_result"]["status"], answers["action_result"]["result"]) == (6, True)
        assert not graph.gateways
        assert not [name for name in graph.topics() if name in "/a /b" or "/act" in name]
        assert not [name for name in graph.services if "/wait" not in name]

    live(test)


def test_a_goal_with_feedback_and_cancel() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        graph.add_action(Waiting())
        one.ask("send_action_goal", action="/wait", args=[True], feedback=True, id="g")
        told = await one.next()
        assert told == {"op": "action_feedback", "action": "/wait", "id": "g", "values": {"now": 1}}
        one.ask("send_action_goal", action="/wait", args=[True], id="g")
        assert "the goal 'g' is already in progress" in errors(one)[0]
        two.ask("cancel_action_goal", action="/wait", id="g")
        assert "no goal 'g' of /wait is running" in errors(two)[0]
        one.ask("cancel_action_goal", action="/wait", id="g")
        result = await one.next()
        assert result == {
            "op": "action_result",
            "action": "/wait",
            "id": "g",
            "values": {"took": None},
            "status": 5,
            "result": True,
        }

    live(test)


def test_goals_that_were_asked_for_by_services_end_with_their_client_and_no_others() -> None:
    """As those do that come over DDS, by way of one client for all."""

    async def test(graph: Graph, one: Client, two: Client) -> None:
        server = graph.add_action(Waiting())
        for number, client in ((1, one), (2, two)):
            asked = {"goal_id": {"uuid": [number] * 16}, "goal": {"good": True}}
            client.ask("call_service", service="/wait/_action/send_goal", args=asked)
            assert (await client.next())["values"]["accepted"]
        first, second = (server._goals[uuid.UUID(bytes=bytes([number] * 16))] for number in (1, 2))
        await one.close()
        await asyncio.wait_for(first.ended.wait(), 10.0)
        assert first.status is GoalStatus.CANCELED
        assert second.running

    live(test)


def test_a_goal_that_is_refused_says_why() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        graph.add_action(Waiting())
        for content, sentence in (
            ({"action": "/wait", "args": {}}, "the goal is not good"),
            ({"action": "/wait", "args": {"god": 1}}, "did you mean 'good'"),
            ({"action": "/none"}, "there is no action '/none'"),
        ):
            got = await one.answer("send_action_goal", id="x", **content)
            assert (got["op"], got["result"], got["status"]) == ("action_result", False, 0)
            assert sentence in got["values"]

    live(test)


def test_a_client_offers_an_action_to_another() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        graph.messages.add({Waiting.type_: Waiting.definition})
        one.ask("advertise_action", action="/act", type=Waiting.type_)
        two.ask("send_action_goal", action="/act", args={"good": True}, feedback=True, id="g")
        goal = await one.next()
        assert (goal["op"], goal["action"], goal["args"]) == ("send_action_goal", "/act", {"good": True})
        one.ask("action_feedback", action="/act", id=goal["id"], values={"now": 3})
        assert (await two.next())["values"] == {"now": 3}
        one.ask("action_feedback", action="/act", id=goal["id"], values={"then": 3})
        assert "unknown key 'then'" in errors(one)[0]
        two.ask("cancel_action_goal", action="/act", id="g")
        assert (await one.next()) == {"op": "cancel_action_goal", "id": goal["id"], "action": "/act"}
        one.ask("action_result", action="/act", id=goal["id"], values={"took": 2}, status=5, result=True)
        result = await two.next()
        assert (result["status"], result["values"]) == (5, {"took": 2.0})
        one.ask("action_result", action="/act", id=goal["id"], values={}, status=5)
        assert "is running" in errors(one)[0]
        one.ask("unadvertise_action", action="/act")
        await asyncio.sleep(0.01)
        assert "/act" not in graph.actions

    live(test)


@pytest.mark.parametrize("kind", ["taken", "prepared"])
def test_what_another_thread_has_looked_at_is_not_looked_at_again(kind: str) -> None:
    async def test(graph: Graph, client: Client, other: Client) -> None:
        graph.add_action(Waiting())
        client.ask("advertise", topic="/j", type="sensor_msgs/msg/JointState")
        other.ask("subscribe", topic="/j")
        client.ask("advertise_service", service="/set", type="std_srvs/srv/SetBool")

        async def told(who: Client, op: str, **content: Any) -> dict[str, Any]:
            message = {"op": op, "id": "7", **content}
            who.take(await asyncio.to_thread(who.prepared, message) if kind == "prepared" else message)
            return await (other if op == "publish" and "name" in content["msg"] else who).next()

        message = await told(client, "publish", topic="/j", msg={"name": ["a"], "position": [1, None]})
        assert (message["msg"]["name"], message["msg"]["position"]) == (["a"], [1.0, None])
        message = await told(client, "publish", topic="/j", msg={"position": [1, "x"]})
        assert (message["id"], message["msg"]) == (
            "7",
            "sensor_msgs/msg/JointState: position[1]: must be a number, got 'x'",
        )
        message = await told(other, "call_service", service="/set", args={"data": 3})
        assert (message["result"], message["id"]) == (False, "7")
        assert message["values"] == "std_srvs/srv/SetBool_Request: data: must be true or false, got 3"
        message = await told(other, "call_service", service="/set", args=[1, 2])
        assert message["values"] == "std_srvs/srv/SetBool_Request has 1 fields, got 2 values"
        message = await told(other, "call_service", service="/nowhere", args={})
        assert "there is no service '/nowhere'" in message["values"]
        message = await told(other, "send_action_goal", action="/wait", args={"good": "no"})
        assert message["values"].endswith("good: must be true or false, got 'no'")
        message = await told(other, "send_action_goal", action="/wait", args={})
        assert message["values"] == "the goal is not good"
        assert "there is no op 'jump'" in (await told(other, "jump"))["msg"]

    live(test)


def test_what_is_examined_is_taken_as_it_is() -> None:
    messages = Messages()
    goal = messages.examine("std_srvs/srv/SetBool_Request", {"data": True})
    assert messages.checked("std_srvs/srv/SetBool_Request", goal) is goal
    with pytest.raises(InputError, match="unknown key 'data'"):
        messages.checked("std_srvs/srv/Trigger_Response", goal)


def test_one_topic_is_subscribed_and_advertised_only_so_often() -> None:
    async def test(graph: Graph, client: Client, other: Client) -> None:
        for op in ("subscribe", "advertise"):
            for number in range(outbox.MAX_PER_TOPIC):
                client.ask(op, topic="/t", type=STRING, id=str(number))
            client.ask(op, topic="/t", type=STRING, id="0")  # said again
            assert not errors(client)
            client.ask(op, topic="/t", type=STRING, id="more")
            assert "a topic at most" in errors(client)[0]

    live(test)


def test_fragments_are_put_together_in_any_order() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        text = json.dumps({"op": "advertise", "topic": "/a", "type": STRING})
        pieces = [text[start : start + 10] for start in range(0, len(text), 10)]
        whole = None
        for number in reversed(range(len(pieces))):
            fragment = {
                "op": "fragment",
                "id": "f",
                "data": pieces[number],
                "num": number,
                "total": len(pieces),
            }
            assert whole is None
            whole = one.take(fragment)
        assert whole == text

    live(test)


def test_large_answers_come_in_fragments_if_wished() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        add_rosapi(graph)
        one.ask("call_service", service="/rosapi/interfaces", fragment_size=200)
        pieces: list[dict[str, Any]] = []
        while not pieces:
            await asyncio.sleep(0)
            pieces = one.got()
        assert {piece["op"] for piece in pieces} == {"fragment"}
        assert max(len(piece["data"]) for piece in pieces) == 200
        two.ask("subscribe", topic="/x", type=STRING)
        for piece in pieces:
            whole = two.take(piece)
        assert "std_msgs/msg/String" in json.loads(whole or "")["values"]["interfaces"]

    live(test)


def test_fragments_that_contradict_each_other_or_pile_up_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "MAX_MESSAGE", 5000)

    async def test(graph: Graph, one: Client, two: Client) -> None:
        limited = Client(graph, "three")
        piece = {"id": "f", "data": "x" * 100, "num": 0, "total": 100}
        limited.ask("fragment", **piece)
        limited.ask("fragment", **{**piece, "total": 3})
        limited.ask("fragment", **{**piece, "num": 100})
        for number in range(99):
            limited.ask("fragment", **{**piece, "num": number})
        found = errors(limited)
        await limited.close()
        assert "fragment 0 of 3 does not fit a message of 100" in found[0]
        assert "fragment 100 of 100 does not fit" in found[1]
        assert any("incomplete messages hold more than 5000 characters" in error for error in found)
        for number in range(9):
            one.ask("fragment", **{**piece, "id": number})
        assert "more than 8 messages are incomplete" in errors(one)[0]
        one.ask("fragment", **{**piece, "id": 8, "num": 0, "total": 3})
        assert "does not fit a message of 100" in errors(one)[0]

    live(test)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ([], r"a message must be a JSON object, got \[\]"),
        (None, "a message must be a JSON object"),
        ({}, "there is no op null; valid names: advertise, unadvertise"),
        ({"op": "fly"}, "there is no op 'fly'"),
        ({"op": []}, r"there is no op \[\]"),
        ({"op": "subscribe"}, "subscribe: topic: is missing"),
        ({"op": "subscribe", "topic": 3}, "subscribe: topic: must be a string, got 3"),
        ({"op": "subscribe", "topic": "/a"}, "/a has no publisher, so its type must be given"),
        ({"op": "subscribe", "topic": "/a", "type": "x/Y"}, "there is no type 'x/msg/Y' here"),
        ({"op": "subscribe", "topic": "/a", "type": STRING, "compression": "png"}, "'png' is not supported"),
        (
            {"op": "subscribe", "topic": "/a", "type": STRING, "compression": "cbor"},
            "'cbor' is not supported",
        ),
        ({"op": "subscribe", "topic": "/a", "type": STRING, "throttle_rate": -1}, "throttle_rate"),
        ({"op": "subscribe", "topic": "/a", "type": STRING, "throttle_rate": math.nan}, "throttle_rate"),
        ({"op": "call_service", "service": "/a", "compression": "png"}, "'png' is not supported"),
        ({"op": "unsubscribe", "topic": "/a"}, "/a is not subscribed"),
        ({"op": "unadvertise", "topic": "/a"}, "/a is not advertised"),
        ({"op": "unadvertise_service", "service": "/a"}, "/a is not advertised"),
        ({"op": "advertise", "topic": "/a b", "type": STRING}, "is not a name"),
        ({"op": "publish", "topic": "/theirs", "msg": {"data": 3}}, "data: must be a string"),
        ({"op": "publish", "topic": "/cobot/graph", "msg": {}}, "/cobot/graph belongs to its publisher"),
        ({"op": "set_level", "level": "loud"}, "set_level: level"),
        ({"op": "fragment", "data": "", "num": -1, "total": 1}, "fragment: num"),
        ({"op": "service_response", "service": "/a", "values": {}}, "no call null of /a is waiting"),
    ],
)
def test_what_is_wrong_is_told_and_the_connection_lives(content: Any, sentence: str) -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        two.ask("subscribe", topic="/theirs", type=STRING)
        one.take(content)
        (status,) = one.got()
        assert (status["op"], status["level"]) == ("status", "error")
        with pytest.raises(AssertionError, match=sentence):
            raise AssertionError(status["msg"])
        one.ask("subscribe", topic="/fine", type=STRING, id="s")
        assert one.got() == []

    live(test)


def test_an_error_names_the_message_it_is_about_unless_nobody_wants_to_know() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        one.ask("unsubscribe", topic="/a", id="u7")
        assert one.got()[0]["id"] == "u7"
        one.ask("set_level", level="none")
        one.ask("unsubscribe", topic="/a", id="u7")
        assert one.got() == []

    live(test)


def test_what_a_client_says_is_logged_without_line_breaks(caplog: pytest.LogCaptureFixture) -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        with caplog.at_level(logging.INFO, "cobot.rosbridge"):
            one.ask("status", level="info", msg="hello\nworld")
        assert caplog.messages == ["one says 'info': 'hello\\nworld'"]

    live(test)


def test_one_who_does_not_read_his_answers_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outbox, "MAX_BYTES", 20_000)

    async def test(graph: Graph, one: Client, two: Client) -> None:
        add_rosapi(graph)
        for _ in range(1000):
            one.ask("fly")  # errors are left out when too many wait
        assert not one.outbox.overfull.is_set() or len(errors(one)) <= outbox.MAX_OPTIONAL
        for _ in range(20):
            one.ask("call_service", service="/rosapi/interfaces")
        await asyncio.sleep(0.01)
        assert one.outbox.overfull.is_set()

    live(test)


def test_rosapi_knows_what_there_is() -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        add_rosapi(graph)
        graph.add_action(Waiting())
        two.ask("subscribe", topic="/a", type="sensor_msgs/JointState")

        async def ask(service: str, /, **args: Any) -> Any:
            answer = await one.answer("call_service", service=f"/rosapi/{service}", args=args)
            return next(iter(answer["values"].values())) if answer["result"] else answer["values"]

        joint_state = "sensor_msgs/msg/JointState"
        topics = (await one.answer("call_service", service="/rosapi/topics"))["values"]
        assert dict(zip(topics["topics"], topics["types"], strict=True))["/a"] == joint_state
        assert await ask("topic_type", topic="/a") == joint_state
        assert await ask("topic_type", topic="/none") == ""
        assert await ask("topics_for_type", type=joint_state) == ["/a"]
        assert await ask("publishers", topic="/a") == []
        assert await ask("subscribers", topic="/a") == ["/cobot"]
        assert "/rosapi/topics" in await ask("services")
        assert await ask("service_type", service="/rosapi/topics") == "rosapi_msgs/srv/Topics"
        assert await ask("services_for_type", type="rosapi_msgs/srv/Topics") == ["/rosapi/topics"]
        assert await ask("nodes") == ["/cobot"]
        details = (await one.answer("call_service", service="/rosapi/node_details", args=["/cobot"]))[
            "values"
        ]
        assert "/a" in details["subscribing"]
        assert "/a" not in details["publishing"]
        assert "/rosapi/nodes" in details["services"]
        assert "there is no node '/x'" in await ask("node_details", node="/x")
        assert await ask("action_servers") == ["/wait"]
        assert await ask("action_type", action="/wait") == Waiting.type_
        assert joint_state in await ask("interfaces")
        assert (await ask("get_time"))["sec"] > 1_700_000_000
        assert await ask("get_ros_version") == 2
        typedefs = await ask("message_details", type="sensor_msgs/JointState")
        assert [typedef["type"] for typedef in typedefs] == [
            joint_state,
            "std_msgs/msg/Header",
            "builtin_interfaces/msg/Time",
        ]
        assert typedefs[0]["fieldnames"] == ["header", "name", "position", "velocity", "effort"]
        assert typedefs[0]["fieldtypes"][:3] == ["std_msgs/msg/Header", "string", "float64"]
        assert typedefs[0]["fieldarraylen"] == [-1, 0, 0, 0, 0]
        assert (await ask("service_request_details", type="std_srvs/SetBool"))[0]["fieldnames"] == ["data"]
        assert (await ask("service_response_details", type="std_srvs/srv/SetBool"))[0]["fieldnames"] == [
            "success",
            "message",
        ]
        assert (await ask("action_goal_details", type=Waiting.type_))[0]["fieldnames"] == ["good"]
        assert (await ask("action_feedback_details", type=Waiting.type_))[0]["fieldtypes"] == ["int32"]
        assert (await ask("action_result_details", type=Waiting.type_))[0]["fieldtypes"] == ["float64"]
        assert "there is no type 'x/msg/Y'" in await ask("message_details", type="x/Y")
        assert await ask("get_param_names") == []
        assert await ask("has_param", name="x") is False
        assert "there is no parameter 'x'" in await ask("get_param", name="x")

    live(test)


JSON = st.recursive(
    st.none() | st.booleans() | st.floats(allow_nan=False) | st.integers() | st.text(max_size=10),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)
KEYS = ("id", "topic", "type", "msg", "service", "args", "action", "values", "status", "data", "num", "total")
USUAL = st.sampled_from(["/a", "/s", "/wait", STRING, "std_srvs/srv/SetBool", "g", 0, 1, {}, True])


@given(
    st.lists(
        st.builds(
            lambda op, content: {"op": op, **content},
            st.sampled_from(sorted(OPERATIONS)),
            st.dictionaries(st.sampled_from(KEYS), USUAL | JSON, max_size=6),
        )
        | JSON,
        max_size=30,
    )
)
@settings(max_examples=150)
def test_no_messages_break_a_connection(contents: list[Any]) -> None:
    async def test(graph: Graph, one: Client, two: Client) -> None:
        graph.add_action(Waiting())
        for content in contents:
            one.take(content)
        await asyncio.sleep(0)
        found = one.got()
        assert not [message for message in found if "its log has the details" in json.dumps(message)]
        two.ask("subscribe", topic="/fine", type=STRING)
        one.ask("publish", topic="/fine", msg={"data": "x"})
        assert two.got()[0]["msg"] == {"data": "x"}

    live(test)


def test_the_definitions_of_rosapi_are_valid() -> None:
    messages = Messages(DEFINITIONS)
    for name in filter(re.compile("rosapi_msgs/").match, messages):
        assert messages.checked(name, messages.default(name)) == messages.default(name)
