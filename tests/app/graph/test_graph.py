"""Topics, services and actions on the graph, with actions and services made for the test.

Oracle: what ROS 2 says of them, for goals in https://design.ros2.org/articles/actions.html.
"""

from __future__ import annotations

import asyncio
import json
import logging
import uuid
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from app.graph.action_server import MAX_KEPT, MAX_RUNNING
from app.graph.actions import GoalHandle, GoalStatus, RejectedGoalError
from app.graph.graph import GRAPH_TOPIC, Graph
from cobot.errors import CobotError, ConflictError, ExecutionError, InputError, NotFoundError
from cobot.ros.messages import Messages

STRING = "std_msgs/msg/String"
COUNT = "int32 until\n---\nint32 counted\n---\nint32 now\n"


class Count:
    """An action that counts up to what it is told, one with each `step`."""

    name = "/count"
    type_ = "aubo_interfaces/action/Count"
    definition = COUNT

    def __init__(self) -> None:
        self.steps: asyncio.Queue[None] = asyncio.Queue()

    async def execute(self, goal: dict[str, Any], handle: GoalHandle) -> dict[str, Any]:
        if goal["until"] < 0:
            raise RejectedGoalError("until must not be negative")
        handle.accept()
        handle.accept()
        for now in range(goal["until"]):
            step = asyncio.create_task(self.steps.get())
            cancel = asyncio.create_task(handle.cancel_requested.wait())
            await asyncio.wait((step, cancel), return_when=asyncio.FIRST_COMPLETED)
            step.cancel()
            cancel.cancel()
            if handle.cancel_requested.is_set():
                handle.status = GoalStatus.CANCELED
                return {"counted": now}
            handle.feedback({"now": now + 1})
        handle.status = GoalStatus.SUCCEEDED
        return {"counted": goal["until"]}


class Scripted(Count):
    """An action that does what the test says."""

    name = "/scripted"
    type_ = "aubo_interfaces/action/Scripted"

    def __init__(self, script: Callable[[GoalHandle], Awaitable[dict[str, Any]]]) -> None:
        super().__init__()
        self._script = script

    async def execute(self, goal: dict[str, Any], handle: GoalHandle) -> dict[str, Any]:
        return await self._script(handle)


def live(test: Callable[[Graph], Awaitable[None]]) -> None:
    """Run a test in an event loop, with a graph."""

    async def run() -> None:
        graph = Graph(Messages())
        await asyncio.wait_for(test(graph), 60.0)
        await graph.close()

    asyncio.run(run())


async def until(condition: Callable[[], Any]) -> None:
    while not condition():
        await asyncio.sleep(0)


def new_id() -> str:
    return uuid.uuid4().hex


def test_all_subscribers_get_each_message_complete() -> None:
    async def test(graph: Graph) -> None:
        first: list[Any] = []
        second: list[Any] = []
        graph.subscribe("/joints", "sensor_msgs/JointState", first.append, owner=1)
        publisher = graph.advertise("joints", "sensor_msgs/msg/JointState", owner=2)
        end = graph.subscribe("/joints", None, second.append, owner=1)
        assert publisher.subscribers == 2
        publisher.publish({"position": [1]})
        end.close()
        end.close()
        publisher.publish(graph.messages.to_cdr("sensor_msgs/msg/JointState", {"name": ["a"]}))
        assert [message["position"] for message in first] == [[1.0], []]
        assert first[0].keys() == {"header", "name", "position", "velocity", "effort"}
        assert len(second) == 1

    live(test)


def test_a_wrong_message_reaches_nobody() -> None:
    async def test(graph: Graph) -> None:
        got: list[Any] = []
        publisher = graph.advertise("/a", STRING, owner=1)
        graph.subscribe("/a", STRING, got.append, owner=2)
        for wrong in ({"data": 1}, {"text": ""}, b"\0\1\0\0"):
            with pytest.raises(InputError, match="std_msgs/msg/String"):
                publisher.publish(wrong)
        assert not got

    live(test)


def test_a_late_subscriber_gets_what_is_latched() -> None:
    async def test(graph: Graph) -> None:
        got: list[Any] = []
        latched = graph.advertise("/a", STRING, latch=True, owner=1)
        plain = graph.advertise("/a", STRING, owner=2)
        latched.publish({"data": "old"})
        latched.publish({"data": "new"})
        plain.publish({"data": "gone"})
        graph.subscribe("/a", None, got.append, owner=3)
        assert got == [{"data": "new"}]
        latched.close()
        graph.subscribe("/a", None, got.append, owner=3)
        assert len(got) == 1

    live(test)


def test_a_failing_subscriber_takes_nothing_from_the_others(caplog: pytest.LogCaptureFixture) -> None:
    async def test(graph: Graph) -> None:
        got: list[Any] = []
        graph.subscribe("/a", STRING, lambda _: [][0], owner=1)
        graph.subscribe("/a", STRING, got.append, owner=1)
        with caplog.at_level(logging.ERROR, "cobot.graph"):
            graph.advertise("/a", STRING, owner=1).publish({"data": "x"})
        assert got == [{"data": "x"}]
        assert "a subscriber of /a failed" in caplog.text

    live(test)


def test_a_publisher_is_told_whether_anybody_listens() -> None:
    async def test(graph: Graph) -> None:
        counts: list[int] = []
        publisher = graph.advertise("/a", STRING, owner=1, on_demand=counts.append)
        first = graph.subscribe("/a", STRING, print, owner=2)
        second = graph.subscribe("/a", STRING, print, owner=3)
        first.close()
        second.close()
        assert counts == [0, 1, 2, 1, 0]
        publisher.close()
        assert graph.type_of("/a") is None

    live(test)


@pytest.mark.parametrize("name", ["", "/", "a b", "/a//b", "/a/", "/ä", "/" + "a" * 255, "/a\n"])
def test_a_name_that_is_none_is_refused(name: str) -> None:
    async def test(graph: Graph) -> None:
        with pytest.raises(InputError, match="is not a name such as"):
            graph.advertise(name, STRING, owner=1)
        with pytest.raises(InputError, match="is not a name such as"):
            await graph.call_service(name, {})

    live(test)


def test_a_topic_has_one_type() -> None:
    async def test(graph: Graph) -> None:
        graph.advertise("/a", STRING, owner=1)
        with pytest.raises(InputError, match="/a is of type std_msgs/msg/String, not std_msgs/msg/Bool"):
            graph.subscribe("/a", "std_msgs/msg/Bool", print, owner=1)
        with pytest.raises(InputError, match="there is no type 'x/msg/Y' here"):
            graph.advertise("/b", "x/msg/Y", owner=1)
        with pytest.raises(InputError, match="/c has no publisher"):
            graph.subscribe("/c", None, print, owner=1)

    live(test)


def test_a_subscription_fixes_no_type_for_others() -> None:
    """Oracle: DDS, where a reader and a writer of different types do not see each other."""

    async def test(graph: Graph) -> None:
        wrong: list[Any] = []
        right: list[Any] = []
        told: list[str] = []
        graph.subscribe("/a", "std_msgs/msg/Int8", wrong.append, owner=1, on_other_type=told.append)
        assert graph.topics()["/a"] == "std_msgs/msg/Int8"
        assert graph.type_of("/a") is None
        publisher = graph.advertise("/a", STRING, owner=2)
        (sentence,) = told
        assert sentence.startswith(
            "/a is advertised as std_msgs/msg/String: the subscription of type std_msgs"
        )
        graph.subscribe("/a", STRING, right.append, owner=3)
        assert (graph.topics()["/a"], graph.type_of("/a")) == (STRING, STRING)
        assert publisher.subscribers == 1
        publisher.publish({"data": "x"})
        assert (wrong, right) == ([], [{"data": "x"}])
        publisher.close()
        assert graph.type_of("/a") is None
        graph.advertise("/a", "std_msgs/msg/Int8", owner=2).publish({"data": 3})
        assert (wrong, len(right)) == ([{"data": 3}], 1)

    live(test)


def test_what_a_gateway_mirrors_fixes_no_type_for_others() -> None:
    """It advertises what somebody has subscribed, with the type of that subscription."""

    async def test(graph: Graph) -> None:
        got: list[Any] = []
        graph.gateways.add("dds")
        graph.subscribe("/a", "std_msgs/msg/Int8", got.append, owner="observer")
        mirror = graph.advertise("/a", "std_msgs/msg/Int8", owner="dds")
        publisher = graph.advertise("/a", STRING, owner="operator")
        assert graph.type_of("/a") == STRING
        publisher.publish({"data": "x"})
        mirror.publish({"data": 1})
        assert got == [{"data": 1}]
        with pytest.raises(InputError, match="/a is of type std_msgs/msg/String, not std_msgs/msg/Int8"):
            graph.advertise("/a", "std_msgs/msg/Int8", owner="dds")

    live(test)


def test_another_network_may_mirror_each_type_that_a_topic_is_subscribed_with() -> None:
    """Until it is advertised: then it has that type alone. What a gateway has made itself does not count."""

    async def test(graph: Graph) -> None:
        def mirrored() -> list[tuple[str, int, int]]:
            listed = [topic for topic in graph.graph_of_topics() if topic["name"] == "/a"]
            return [(each["type"], each["publishers"], each["subscribers"]) for each in listed]

        graph.gateways.add("dds")
        first = graph.subscribe("/a", "std_msgs/msg/Int8", print, owner="observer")
        graph.subscribe("/a", STRING, print, owner="operator")
        graph.advertise("/a", "std_msgs/msg/Int8", owner="dds")
        assert mirrored() == [("std_msgs/msg/Int8", 0, 1), (STRING, 0, 1)]
        first.close()
        assert mirrored() == [(STRING, 0, 1)]
        graph.subscribe("/a", "std_msgs/msg/Int8", print, owner="observer")
        graph.advertise("/a", STRING, owner="operator")
        assert mirrored() == [(STRING, 1, 1)]

    live(test)


def test_a_topic_of_the_service_has_its_type_whoever_publishes() -> None:
    async def test(graph: Graph) -> None:
        graph.subscribe("/command", STRING, print, owner=1, declares=True)
        assert graph.type_of("/command") == STRING
        for ask in (graph.advertise, lambda *a, owner: graph.subscribe(*a, print, owner=owner)):
            with pytest.raises(InputError, match="/command is of type std_msgs/msg/String"):
                ask("/command", "std_msgs/msg/Int8", owner=2)

    live(test)


def test_a_service_gets_a_complete_request_and_answers_completely() -> None:
    async def test(graph: Graph) -> None:
        async def answer(request: dict[str, Any]) -> dict[str, Any]:
            return {"success": request["data"]}

        service = graph.add_service("/s", "std_srvs/SetBool", answer, owner=1)
        assert await graph.call_service("s", {"data": True}) == {"success": True, "message": ""}
        assert await graph.call_service("/s", {}) == {"success": False, "message": ""}
        with pytest.raises(InputError, match="SetBool_Request: data: must be true or false"):
            await graph.call_service("/s", {"data": 1})
        with pytest.raises(ConflictError, match="the service /s already exists"):
            graph.add_service("s", "std_srvs/srv/SetBool", answer, owner=1)
        graph.remove_service(service)
        graph.remove_service(service)
        with pytest.raises(NotFoundError, match="there is no service '/s'"):
            await graph.call_service("/s", {})

    live(test)


def test_a_goal_is_worked_on_with_feedback_to_its_result() -> None:
    async def test(graph: Graph) -> None:
        action = Count()
        graph.add_action(action)
        topic: list[Any] = []
        statuses: list[Any] = []
        graph.subscribe("/count/_action/feedback", None, topic.append, owner=1)
        graph.subscribe("/count/_action/status", None, statuses.append, owner=1)
        told: list[Any] = []
        goal_id = new_id()
        for _ in range(3):
            action.steps.put_nowait(None)
        assert await graph.send_goal("/count", goal_id, {"until": 3}, told.append) == (4, {"counted": 3})
        assert told == [{"now": 1}, {"now": 2}, {"now": 3}]
        assert [message["feedback"]["now"] for message in topic] == [1, 2, 3]
        assert graph.messages.octets(topic[0]["goal_id"]["uuid"]).hex() == goal_id
        assert [message["status_list"][0]["status"] for message in statuses] == [2, 4]
        assert statuses[0]["status_list"][0]["goal_info"]["stamp"]["sec"] > 0

    live(test)


def test_a_cancelled_goal_ends_as_the_action_says() -> None:
    async def test(graph: Graph) -> None:
        graph.add_action(Count())
        goal_id = new_id()
        statuses: list[int] = []
        graph.subscribe(
            "/count/_action/status",
            None,
            lambda message: statuses.append(message["status_list"][0]["status"]),
            owner=1,
        )
        running = asyncio.create_task(graph.send_goal("/count", goal_id, {"until": 3}))
        await until(lambda: statuses)
        graph.cancel("/count", goal_id)
        graph.cancel("/count", goal_id)
        assert await running == (GoalStatus.CANCELED, {"counted": 0})
        assert statuses == [2, 3, 5]
        with pytest.raises(InputError, match="cannot be cancelled: goal_terminated"):
            graph.cancel("/count", goal_id)
        with pytest.raises(InputError, match="cannot be cancelled: unknown_goal_id"):
            graph.cancel("/count", new_id())

    live(test)


def test_a_goal_may_be_cancelled_before_it_was_accepted() -> None:
    async def test(graph: Graph) -> None:
        graph.add_action(Count())
        goal_id = new_id()
        running = asyncio.create_task(graph.send_goal("/count", goal_id, {"until": 3}))
        await asyncio.sleep(0)  # it has been sent; the action has not had its turn
        graph.cancel("/count", goal_id)
        assert await running == (GoalStatus.CANCELED, {"counted": 0})

    live(test)


def test_a_goal_is_refused_with_the_reason() -> None:
    async def test(graph: Graph) -> None:
        graph.add_action(Count())
        for arguments, sentence in (
            ({"until": -1}, "until must not be negative"),
            ({"until": "x"}, "until: must be an integer"),
            ({"untl": 1}, "did you mean 'until'"),
        ):
            with pytest.raises(InputError, match=sentence):
                await graph.send_goal("/count", new_id(), arguments)
        with pytest.raises(NotFoundError, match="there is no action '/cuont'; valid names: /count"):
            await graph.send_goal("/cuont", new_id(), {})
        with pytest.raises(InputError, match="32 hexadecimal digits"):
            await graph.send_goal("/count", "one", {})
        goal_id = new_id()
        await graph.send_goal("/count", goal_id, {"until": 0})
        with pytest.raises(ConflictError, match="was already sent"):
            await graph.send_goal("/count", goal_id, {"until": 0})
        with pytest.raises(ConflictError, match="the action /count already exists"):
            graph.add_action(Count())

    live(test)


@pytest.mark.parametrize("error", [ExecutionError("it broke"), RuntimeError("a programming error")])
def test_an_action_that_fails_aborts_its_goal_or_refuses_it(error: Exception) -> None:
    async def test(graph: Graph) -> None:
        accepted = False

        async def fail(handle: GoalHandle) -> dict[str, Any]:
            if accepted:
                handle.accept()
            raise error

        graph.add_action(Scripted(fail))
        sentence = "it broke" if isinstance(error, ExecutionError) else "its log has the details"
        with pytest.raises(CobotError, match=sentence) as refused:
            await graph.send_goal("/scripted", new_id(), {})
        assert refused.type is (ExecutionError if isinstance(error, ExecutionError) else CobotError)
        accepted = True
        assert await graph.send_goal("/scripted", new_id(), {}) == (GoalStatus.ABORTED, {"counted": 0})

    live(test)


def test_a_careless_action_harms_nobody() -> None:
    async def test(graph: Graph) -> None:
        async def silent(handle: GoalHandle) -> dict[str, Any]:
            handle.feedback({"now": 1})
            return {}

        async def undecided(handle: GoalHandle) -> dict[str, Any]:
            handle.accept()
            return {}

        async def babbling(handle: GoalHandle) -> dict[str, Any]:
            handle.accept()
            handle.status = GoalStatus.SUCCEEDED
            return {"nonsense": 1}

        action = Scripted(silent)
        graph.add_action(action)
        with pytest.raises(RejectedGoalError, match="has not accepted the goal"):
            await graph.send_goal("/scripted", new_id(), {})
        for script in (undecided, babbling):
            action._script = script
            assert (await graph.send_goal("/scripted", new_id(), {}))[0] is GoalStatus.ABORTED

    live(test)


def test_goals_and_results_are_bounded() -> None:
    async def test(graph: Graph) -> None:
        graph.add_action(Count())
        running = [
            asyncio.create_task(graph.send_goal("/count", new_id(), {"until": 1})) for _ in range(MAX_RUNNING)
        ]
        statuses: list[Any] = []
        graph.subscribe("/count/_action/status", None, statuses.append, owner=1)
        await until(lambda: statuses and len(statuses[-1]["status_list"]) == MAX_RUNNING)
        with pytest.raises(
            ConflictError, match=f"already has {MAX_RUNNING} running goals, which is the maximum"
        ):
            await graph.send_goal("/count", new_id(), {"until": 0})
        await graph.close()
        assert {status for status, _ in await asyncio.gather(*running)} == {GoalStatus.ABORTED}

    async def kept(graph: Graph) -> None:
        graph.add_action(Count())
        statuses: list[Any] = []
        graph.subscribe("/count/_action/status", None, statuses.append, owner=1)
        for _ in range(MAX_KEPT + 20):
            await graph.send_goal("/count", new_id(), {"until": 0})
        assert len(statuses[-1]["status_list"]) == MAX_KEPT + 1

    live(test)
    live(kept)


def ros_id(goal_id: str) -> dict[str, Any]:
    return {"goal_id": {"uuid": list(bytes.fromhex(goal_id))}}


def test_the_action_as_ros_takes_it_apart() -> None:
    """send_goal, get_result and cancel_goal as services: what a transport of services needs."""

    async def test(graph: Graph) -> None:
        action = Count()
        graph.add_action(action)
        goal_id = new_id()
        sent = await graph.call_service("/count/_action/send_goal", {**ros_id(goal_id), "goal": {"until": 1}})
        assert sent["accepted"]
        assert sent["stamp"]["sec"] > 0
        waiting = asyncio.create_task(graph.call_service("/count/_action/get_result", ros_id(goal_id)))
        await asyncio.sleep(0)
        assert not waiting.done()
        action.steps.put_nowait(None)
        assert await waiting == {"status": 4, "result": {"counted": 1}}
        late = await graph.call_service("/count/_action/get_result", ros_id(goal_id))
        assert late == {"status": 4, "result": {"counted": 1}}
        unknown = await graph.call_service("/count/_action/get_result", ros_id(new_id()))
        assert unknown == {"status": 0, "result": {"counted": 0}}
        refused = {**ros_id(new_id()), "goal": {"until": -1}}
        assert not (await graph.call_service("/count/_action/send_goal", refused))["accepted"]

    live(test)


def test_cancel_goal_by_id_by_time_and_all() -> None:
    async def test(graph: Graph) -> None:
        graph.add_action(Count())

        async def begin() -> tuple[str, dict[str, int]]:
            goal_id = new_id()
            sent = await graph.call_service(
                "/count/_action/send_goal", {**ros_id(goal_id), "goal": {"until": 1}}
            )
            return goal_id, sent["stamp"]

        async def cancel(goal_id: str, stamp: dict[str, int] | None = None) -> tuple[int, set[str]]:
            info = {**ros_id(goal_id), "stamp": stamp or {}}
            answer = await graph.call_service("/count/_action/cancel_goal", {"goal_info": info})
            ids = {graph.messages.octets(goal["goal_id"]["uuid"]).hex() for goal in answer["goals_canceling"]}
            return answer["return_code"], ids

        goals = [await begin() for _ in range(5)]
        ids = [goal_id for goal_id, _ in goals]
        nobody = "0" * 32
        assert await cancel(ids[4]) == (0, {ids[4]})
        assert (await graph.call_service("/count/_action/get_result", ros_id(ids[4])))["status"] == 5
        assert await cancel(ids[4]) == (3, set())
        assert await cancel(new_id()) == (2, set())
        assert await cancel(nobody, goals[1][1]) == (0, set(ids[:2]))
        code, cancelled = await cancel(nobody)
        assert code == 0
        assert cancelled >= {ids[2], ids[3]}

    live(test)


def test_the_graph_shows_what_others_may_mirror() -> None:
    async def test(graph: Graph) -> None:
        graphs: list[dict[str, Any]] = []
        gateway = object()
        graph.gateways.add(gateway)
        graph.subscribe(
            GRAPH_TOPIC, STRING, lambda message: graphs.append(json.loads(message["data"])), owner=gateway
        )
        await until(lambda: graphs)
        assert graphs[-1]["topics"] == []
        graph.advertise("/own", STRING, owner=1, local=True)
        graph.subscribe("/own", STRING, print, owner=2)
        graph.advertise("/theirs", STRING, owner=gateway)
        publisher = graph.advertise("/ours", STRING, owner=1)
        graph.subscribe("/ours", STRING, print, owner=gateway)
        graph.subscribe("/both", STRING, print, owner=2)
        graph.advertise("/both", STRING, owner=gateway)

        async def answer(request: dict[str, Any]) -> dict[str, Any]:
            return {}

        graph.add_service("/s", "std_srvs/srv/Empty", answer, owner=1)
        graph.add_service("/local", "std_srvs/srv/Empty", answer, owner=1, local=True)
        graph.add_service("/t", "std_srvs/srv/Empty", answer, owner=gateway)
        graph.add_action(Count())
        await until(lambda: graphs[-1]["actions"])
        shown = graphs[-1]
        below = "/count/_action"
        assert {topic["name"]: (topic["publishers"], topic["subscribers"]) for topic in shown["topics"]} == {
            "/ours": (1, 0),
            "/both": (0, 1),
            f"{below}/feedback": (1, 0),
            f"{below}/status": (1, 0),
        }
        services = {service["name"]: service["type"] for service in shown["services"]}
        assert services["/s"] == "std_srvs/srv/Empty"
        assert services.keys() == {
            "/s",
            *(f"{below}/{each}" for each in ("send_goal", "get_result", "cancel_goal")),
        }
        assert shown["actions"] == [{"name": "/count", "type": "aubo_interfaces/action/Count"}]
        assert shown["definitions"] == {"aubo_interfaces/action/Count": COUNT}
        count = len(graphs)
        publisher.close()
        await until(lambda: len(graphs) > count)
        assert "/ours" not in {topic["name"] for topic in graphs[-1]["topics"]}

    live(test)


def test_a_gateway_does_not_get_back_what_it_brought() -> None:
    async def test(graph: Graph) -> None:
        gateway, ordinary = object(), object()
        graph.gateways.add(gateway)
        got: list[str] = []
        for owner, name in ((gateway, "gateway"), (ordinary, "ordinary")):
            graph.subscribe(
                "/a", STRING, lambda message, name=name: got.append(name + message["data"]), owner=owner
            )
        graph.advertise("/a", STRING, owner=gateway).publish({"data": " 1"})
        graph.advertise("/a", STRING, owner=ordinary).publish({"data": " 2"})
        assert got == ["ordinary 1", "gateway 2", "ordinary 2"]

    live(test)
