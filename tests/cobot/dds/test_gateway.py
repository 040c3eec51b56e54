"""The gateway between the graph of a real web server and a ROS 2 node on Fast DDS, which is the oracle."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import socket
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import pytest
import uvicorn
from asgi_client import Anybody
from dds_peers import own_domain
from fastapi import FastAPI
from node_rig import DEFINITIONS, NodeRig
from ros_peer import Peer, until
from thorough import few

from app.graph.actions import GoalHandle, GoalStatus, RejectedGoalError
from app.graph.graph import Graph, Message
from app.rosbridge import router as rosbridge
from cobot.access.roles import Role
from cobot.codes import Code
from cobot.dds import gateway as gateway_module
from cobot.dds.gateway import DdsGateway
from cobot.errors import PermissionDenied
from cobot.ros.failures import FjtError
from cobot.ros.messages import Messages

GET_DOF = "aubo_interfaces/srv/GetDof"
MOVE_JOINT = "aubo_interfaces/srv/MoveJoint"
COUNT = "aubo_interfaces/action/Count"
STRING = "std_msgs/msg/String"
BELOW = "/iiwa/count/_action"
GOAL_ID = {"uuid": "AQIDBAUGBwgJCgsMDQ4PEA=="}


class Counting:
    """An action that counts until it is told to go on, or cancelled."""

    name, type_, definition = "/iiwa/count", COUNT, ""

    def __init__(self) -> None:
        self.go_on = asyncio.Event()

    async def execute(self, goal: Message, handle: GoalHandle) -> Message:
        if goal["until"] < 0:
            raise RejectedGoalError("nobody counts backwards")
        handle.accept()
        reached = 0
        while reached < goal["until"] or not self.go_on.is_set():
            if handle.cancel_requested.is_set():
                handle.status = GoalStatus.CANCELED
                return {"reached": reached}
            reached += 1
            handle.feedback({"now": reached})
            await asyncio.sleep(0.01)
        handle.status = GoalStatus.SUCCEEDED
        return {"reached": reached}


class Service:
    """A web server with the real graph and the real rosbridge, and a few things on it."""

    def __init__(self, port: int = 0) -> None:
        self.commands: list[str] = []
        self.heard: list[str] = []
        self.slow_calls = 0
        self.graph: Graph
        self.counting: Counting
        self.loop: asyncio.AbstractEventLoop
        listener = socket.socket()
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        listener.bind(("127.0.0.1", port))
        self.port = listener.getsockname()[1]
        app = FastAPI(lifespan=self._lifespan)
        app.include_router(rosbridge.router)
        app.add_middleware(Anybody)
        config = uvicorn.Config(
            app, log_config=None, ws="websockets-sansio", ws_max_size=1 << 26, timeout_graceful_shutdown=1
        )
        self.server = uvicorn.Server(config)
        self.thread = threading.Thread(target=self.server.run, args=([listener],), daemon=True)
        self.thread.start()
        until(lambda: self.server.started, "the server does not start")

    def close(self) -> None:
        self.server.should_exit = True
        self.thread.join(20.0)

    def do(self, action: Callable[[], Any]) -> Any:
        async def call() -> Any:
            return action()

        return asyncio.run_coroutine_threadsafe(call(), self.loop).result(20.0)

    @contextlib.asynccontextmanager
    async def _lifespan(self, app: FastAPI) -> AsyncIterator[None]:
        self.loop = asyncio.get_running_loop()
        self.graph = app.state.graph = Graph(Messages(DEFINITIONS))
        app.state.large_body = asyncio.Lock()
        app.state.rosbridge_connections = 0
        self.graph.add_service("/iiwa/RobotConfig/getDof", GET_DOF, self._get_dof, owner=self)
        self.graph.add_service("/iiwa/MotionControl/moveJoint", MOVE_JOINT, self._move, owner=self)
        self.graph.add_service("/iiwa/slow", GET_DOF, self._never, owner=self)
        self.counting = Counting()
        self.graph.add_action(self.counting)
        self.graph.subscribe("/iiwa/joint_cmd", STRING, lambda m: self.commands.append(m["data"]), owner=self)
        self.graph.subscribe("/both", STRING, lambda m: self.heard.append(m["data"]), owner=self)
        self.both = self.graph.advertise("/both", STRING, owner=self)
        yield
        await self.graph.close()

    async def _get_dof(self, request: Message) -> Message:
        return {"code": 0, "message": "", "result": 7}

    async def _move(self, request: Message) -> Message:
        return {"code": 0, "message": str(request["q"]), "result": 0}

    async def _never(self, request: Message) -> Message:
        self.slow_calls += 1
        await asyncio.Event().wait()
        raise AssertionError


class Bench:
    """All of it: the service, the gateway, and the foreign node."""

    def __init__(self, domain: int) -> None:
        self.service: Service | None = Service()
        self.port = self.service.port
        # While the service is away no connection of another process may get its port.
        self._reserved = socket.socket()
        self._reserved.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        self._reserved.bind(("127.0.0.1", self.port))
        self.rig = NodeRig(domain)
        url = f"http://127.0.0.1:{self.port}"
        self.gateway = self.rig.do(lambda: DdsGateway(self.rig.node, url, {"/iiwa/status"}))
        self.running = asyncio.run_coroutine_threadsafe(self.gateway.run(), self.rig.loop)
        self.peer = Peer(domain, Messages(DEFINITIONS))

    def get_dof(self) -> Any:
        return self.peer.client("/iiwa/RobotConfig/getDof", GET_DOF).until_ready()

    def stop_service(self) -> None:
        assert self.service is not None
        self.service.close()
        assert not self.service.thread.is_alive(), "the server does not end"
        self.service = None

    def start_service(self) -> Service:
        self.service = Service(self.port)
        return self.service

    def close(self) -> None:
        self.peer.close()
        self.rig.close()  # ends the gateway too
        if self.service is not None:
            self.service.close()
        self._reserved.close()


@pytest.fixture
def bench() -> Iterator[Bench]:
    with own_domain() as domain:
        made = Bench(domain)
        yield made
        made.close()


def test_a_service_of_the_hub_is_one_of_ros(bench: Bench) -> None:
    assert bench.get_dof().call() == {"code": 0, "message": "", "result": 7}
    move = bench.peer.client("/iiwa/MotionControl/moveJoint", MOVE_JOINT).until_ready()
    for number in range(50):
        assert move.call({"q": [0.1 * number] * 7, "a": 0.3})["message"] == str([0.1 * number] * 7)


def test_no_point_of_joint_cmd_is_lost_or_overtaken(bench: Bench) -> None:
    publisher = bench.peer.publisher("/iiwa/joint_cmd", STRING, depth=5000)
    publisher.until_matched()
    points = [f'{{"type":"servo_point","point_id":{number}}}' for number in range(3000)]
    for point in points:
        publisher.publish({"data": point})
    service = bench.service
    assert service is not None
    until(lambda: len(service.commands) >= len(points), "not all points arrived")
    assert service.commands == points


def test_a_topic_goes_both_ways_and_nothing_comes_back(bench: Bench) -> None:
    service = bench.service
    assert service is not None
    outside = bench.peer.subscription("/both", STRING)
    publisher = bench.peer.publisher("/both", STRING)
    outside.until_matched(2)  # of the gateway, and of the peer itself
    bench.rig.until_known("rt/both")
    publisher.until_matched(2)
    publisher.publish({"data": "from ros"})
    until(lambda: "from ros" in service.heard, "nothing arrived at the graph")
    service.do(lambda: service.both.publish({"data": "from the graph"}))
    assert [outside.get()["data"] for _ in range(2)] == ["from ros", "from the graph"]
    publisher.publish({"data": "last"})
    until(lambda: "last" in service.heard, "nothing arrived at the graph")
    assert service.heard == ["from ros", "from the graph", "last"]  # each once
    assert outside.get()["data"] == "last"


def test_a_topic_is_read_with_each_type_that_is_subscribed(bench: Bench) -> None:
    """The first subscription keeps the second from nothing. Oracle: the node on Fast DDS."""
    service = bench.service
    assert service is not None
    heard: dict[str, list[Any]] = {"std_msgs/msg/Int8": [], STRING: []}
    for type_, got in heard.items():
        service.do(partial(service.graph.subscribe, "/demo/x", type_, got.append, owner=type_))
    with Peer(bench.rig.domain, bench.peer.messages) as other:  # in DDS a participant has one type for a name
        for peer, type_, value in ((bench.peer, "std_msgs/msg/Int8", 1), (other, STRING, "x")):
            publisher = peer.publisher("/demo/x", type_)
            publisher.until_matched()
            publisher.publish({"data": value})
            until(partial(heard.get, type_), f"no message of type {type_}")
    assert heard == {"std_msgs/msg/Int8": [{"data": 1}], STRING: [{"data": "x"}]}
    service.do(lambda: service.graph.advertise("/demo/x", STRING, owner=service))
    wrong = ("r", "rt/demo/x", "std_msgs::msg::dds_::Int8_")
    until(lambda: wrong not in bench.peer.found, "the reader of the other type is still there")


def test_topics_services_and_types_come_and_go_with_the_hub(bench: Bench) -> None:
    service = bench.service
    assert service is not None
    graph = service.graph
    bench.get_dof()

    def add() -> Any:
        graph.messages.add({"demo_msgs/msg/Pair": "int32 left\nint32 right\n"})
        return graph.advertise("/demo/pair", "demo_msgs/msg/Pair", owner=service)

    publisher = service.do(add)
    bench.peer.messages.add({"demo_msgs/msg/Pair": "int32 left\nint32 right\n"})
    heard = bench.peer.subscription("/demo/pair", "demo_msgs/msg/Pair")
    heard.until_matched()
    bench.rig.until_known("rt/demo/pair")
    until(lambda: publisher.subscribers > 0, "the gateway does not subscribe")
    service.do(lambda: publisher.publish({"left": 1, "right": 2}))
    assert heard.get() == {"left": 1, "right": 2}
    made = service.do(lambda: graph.services["/iiwa/slow"])
    service.do(publisher.close)
    service.do(lambda: graph.remove_service(made))
    until(lambda: not any("slow" in found[1] for found in bench.peer.found), "the service is still there")
    until(lambda: ("w", "rt/demo/pair") not in {f[:2] for f in bench.peer.found}, "the topic is still there")


def test_own_topics_are_not_mirrored(bench: Bench) -> None:
    service = bench.service
    assert service is not None
    service.do(lambda: service.graph.advertise("/iiwa/status", STRING, owner=service))
    service.do(lambda: service.graph.advertise("/demo/after", STRING, owner=service))
    until(lambda: ("w", "rt/demo/after") in {found[:2] for found in bench.peer.found}, "not mirrored")
    assert ("w", "rt/iiwa/status") not in {found[:2] for found in bench.peer.found}


def test_an_action_is_followed_to_its_result(bench: Bench) -> None:
    service = bench.service
    assert service is not None
    heard = bench.peer.subscription(f"{BELOW}/feedback", f"{COUNT}_FeedbackMessage")
    heard.until_matched()
    bench.rig.until_known(f"rt{BELOW}/feedback")
    send = bench.peer.client(f"{BELOW}/send_goal", f"{COUNT}_SendGoal").until_ready()
    result = bench.peer.client(f"{BELOW}/get_result", f"{COUNT}_GetResult").until_ready()
    assert not send.call({"goal_id": GOAL_ID, "goal": {"until": -1}})["accepted"]
    assert send.call({"goal_id": GOAL_ID, "goal": {"until": 3}})["accepted"]
    waiting = result.begin({"goal_id": GOAL_ID})
    assert [heard.get()["feedback"]["now"] for _ in range(3)] == [1, 2, 3]
    late = bench.peer.subscription(f"{BELOW}/status", "action_msgs/msg/GoalStatusArray", latched=True)
    assert late.until(lambda m: m["status_list"])["status_list"][0]["status"] == GoalStatus.EXECUTING
    service.do(service.counting.go_on.set)
    got = waiting(30.0)
    assert got["status"] == GoalStatus.SUCCEEDED
    assert got["result"]["reached"] >= 3
    late.until(lambda m: m["status_list"][0]["status"] == GoalStatus.SUCCEEDED)


def test_a_goal_is_cancelled(bench: Bench) -> None:
    send = bench.peer.client(f"{BELOW}/send_goal", f"{COUNT}_SendGoal").until_ready()
    result = bench.peer.client(f"{BELOW}/get_result", f"{COUNT}_GetResult").until_ready()
    cancel = bench.peer.client(f"{BELOW}/cancel_goal", "action_msgs/srv/CancelGoal").until_ready()
    assert send.call({"goal_id": GOAL_ID, "goal": {"until": 5}})["accepted"]
    waiting = result.begin({"goal_id": GOAL_ID})
    answer = cancel.call({"goal_info": {"goal_id": GOAL_ID}})
    assert [each["goal_id"] for each in answer["goals_canceling"]] == [GOAL_ID]
    assert waiting(30.0)["status"] == GoalStatus.CANCELED


def test_calls_are_answered_while_the_service_is_away_and_after_it(bench: Bench) -> None:
    get_dof = bench.get_dof()
    slow = bench.peer.client("/iiwa/slow", GET_DOF).until_ready()
    send = bench.peer.client(f"{BELOW}/send_goal", f"{COUNT}_SendGoal").until_ready()
    result = bench.peer.client(f"{BELOW}/get_result", f"{COUNT}_GetResult").until_ready()
    cancel = bench.peer.client(f"{BELOW}/cancel_goal", "action_msgs/srv/CancelGoal").until_ready()
    assert send.call({"goal_id": GOAL_ID, "goal": {"until": 5}})["accepted"]
    waiting, pending = slow.begin({}), result.begin({"goal_id": GOAL_ID})
    # Before it has come to the service the answer would be that the service is away.
    until(lambda: bench.service and bench.service.slow_calls, "the call did not come to the service")
    bench.stop_service()
    lost = waiting(30.0)
    assert (lost["code"], lost["result"]) == (Code.UNAVAILABLE, Code.UNAVAILABLE)
    assert "connection" in lost["message"]
    assert pending(30.0)["status"] == GoalStatus.ABORTED
    away = get_dof.call()
    assert away["code"] == Code.UNAVAILABLE
    assert "not connected" in away["message"]
    assert not send.call({"goal_id": GOAL_ID, "goal": {"until": 5}})["accepted"]
    assert cancel.call({"goal_info": {"goal_id": GOAL_ID}})["return_code"] == gateway_module.CANCEL_REJECTED
    service = bench.start_service()
    until(lambda: get_dof.call()["code"] == Code.OK, "the service does not come back")
    publisher = bench.peer.publisher("/both", STRING)
    publisher.until_matched()
    until(lambda: publisher.publish({"data": "again"}) or service.heard, "topics do not come back")


FJT = "control_msgs/action/FollowJointTrajectory"


class Following:
    """An action of the type of trajectories that arrives when it is told to."""

    name, type_, definition = "/iiwa/follow_joint_trajectory", FJT, ""

    def __init__(self) -> None:
        self.go_on = asyncio.Event()
        self.points: list[Message] = []

    async def execute(self, goal: Message, handle: GoalHandle) -> Message:
        handle.accept()
        self.points = goal["trajectory"]["points"]
        await self.go_on.wait()
        handle.status = GoalStatus.SUCCEEDED
        return {"error_code": 0, "error_string": "arrived"}


class Trajectories:
    """The service's action of trajectories, and a client of it."""

    def __init__(self, bench: Bench) -> None:
        assert bench.service is not None
        self.action = Following()
        bench.service.do(lambda: bench.service.graph.add_action(self.action))  # type: ignore[union-attr]
        below = f"{self.action.name}/_action"
        self._send = bench.peer.client(f"{below}/send_goal", f"{FJT}_SendGoal").until_ready()
        self._result = bench.peer.client(f"{below}/get_result", f"{FJT}_GetResult").until_ready()

    def begin(self, number: int, points: int = 1, rates: bool = True) -> Callable[[float], Message]:
        """Sends a goal, which is accepted; returns what waits for its result."""
        goal_id = {"uuid": base64.b64encode(bytes([number] * 16)).decode()}
        point = {"positions": [0.12345678901234567] * 7}
        if rates:
            point |= {"velocities": [0.12345678901234567] * 7, "accelerations": [-0.1234567890123456] * 7}
        trajectory = {"joint_names": ["joint1"], "points": [point] * points}
        assert self._send.call({"goal_id": goal_id, "goal": {"trajectory": trajectory}})["accepted"]
        return self._result.begin({"goal_id": goal_id})


def test_a_message_too_large_for_the_service_is_rejected_alone(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    """Another client's goal, whose connection it shares, goes on to its end."""
    service = bench.service
    assert service is not None
    trajectories = Trajectories(bench)
    waiting = trajectories.begin(1)
    publisher = bench.peer.publisher("/both", STRING)
    publisher.until_matched()
    with caplog.at_level("WARNING", "cobot.ros2"):
        publisher.publish({"data": "x" * 9_000_000})
        publisher.publish({"data": "after it"})
        until(lambda: service.heard == ["after it"], "the message after the large one did not arrive")
    assert "/both" in caplog.text
    assert "allowed: 4194304" in caplog.text
    service.do(trajectories.action.go_on.set)
    got = waiting(30.0)
    assert got["status"] == GoalStatus.SUCCEEDED
    assert got["result"]["error_string"] == "arrived"


@pytest.mark.parametrize(("points", "rates"), few([(7_400, True), (14_800, False)]))
def test_a_goal_as_large_as_the_documents_say_arrives_whole(bench: Bench, points: int, rates: bool) -> None:
    """The limits of docs/fjt.md, with numbers of full precision."""
    trajectories = Trajectories(bench)
    service = bench.service
    assert service is not None
    service.do(trajectories.action.go_on.set)
    got = trajectories.begin(2, points, rates)(30.0)
    assert got["status"] == GoalStatus.SUCCEEDED
    received = trajectories.action.points
    assert len(received) == points
    assert all(len(point["positions"]) == 7 for point in received)
    assert all(len(point["accelerations"]) == 7 * rates for point in received)


@pytest.mark.parametrize("points", few([9_000, 15_000]))
def test_a_goal_with_too_many_points_is_aborted_with_the_reason(bench: Bench, points: int) -> None:
    got = Trajectories(bench).begin(2, points)(30.0)
    assert got["status"] == GoalStatus.ABORTED
    assert got["result"]["error_code"] == FjtError.INVALID_GOAL
    assert "allowed:" in got["result"]["error_string"]


def test_a_result_that_is_lost_with_the_connection_says_so(bench: Bench) -> None:
    waiting = Trajectories(bench).begin(3)
    bench.stop_service()
    got = waiting(30.0)
    assert got["status"] == GoalStatus.ABORTED
    assert got["result"]["error_code"] == FjtError.INTERRUPTED
    assert got["result"]["error_string"]


class Nodes:
    """A node that notes what it is asked for."""

    def __init__(self) -> None:
        self.messages = Messages(DEFINITIONS)
        self.made: list[tuple[str, str]] = []

    def __getattr__(self, kind: str) -> Callable[..., Any]:
        def make(name: str, type_: str, *_: Any, **__: Any) -> Any:
            self.made.append((kind, name))
            return SimpleNamespace(topic=name, type=type_, close=lambda: None)

        return make


@pytest.mark.parametrize("role", [Role.OBSERVER, Role.OPERATOR])
def test_who_may_only_look_is_not_listened_to(role: Role) -> None:
    node = Nodes()
    gateway = DdsGateway(cast(Any, node), "http://localhost:1", set(), "", role)
    topics = [
        {"name": "/iiwa/joint_cmd", "type": STRING, "publishers": 0, "subscribers": 1},
        {"name": "/iiwa/status", "type": STRING, "publishers": 1, "subscribers": 0},
    ]
    services = [{"name": "/iiwa/RobotConfig/getDof", "type": GET_DOF}]
    gateway._mirror({"definitions": {}, "topics": topics, "services": services})
    listening = [("subscription", "/iiwa/joint_cmd")] if role is Role.OPERATOR else []
    assert node.made == [*listening, ("publisher", "/iiwa/status"), ("service", "/iiwa/RobotConfig/getDof")]
    if role is Role.OBSERVER:
        with pytest.raises(PermissionDenied, match="ros2 has the role observer"):
            gateway.publish("/iiwa/joint_cmd", STRING, {"data": "{}"})
