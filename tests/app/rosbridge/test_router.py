"""The WebSocket /rosbridge of the whole service, on virtual time; over a network: tests/e2e/realtime.

Oracle: a client made of `json`.
"""

from __future__ import annotations

import contextlib
import json
from typing import Any

import pytest
from asgi_client import Refused
from cobot_run import WAIT_S
from virtual_service import VirtualService


@pytest.fixture(scope="module")
def run(service: VirtualService) -> VirtualService:
    return service


class Client:
    """A client of rosbridge that may do anything."""

    def __init__(self, run: VirtualService, **headers: str) -> None:
        self.socket = run.connect("/rosbridge", **headers)

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def send(self, op: str, **content: Any) -> None:
        self.socket.send(json.dumps({"op": op, **content}))

    def next(self, op: str) -> dict[str, Any]:
        """The next message of this kind."""
        while True:
            message: dict[str, Any] = json.loads(self.socket.recv(WAIT_S))
            if message["op"] == op:
                return message

    def call(self, name: str, args: Any = None) -> dict[str, Any]:
        self.send("call_service", service=name, args=args)
        return self.next("service_response")


def test_the_graph_for_gateways_follows_what_clients_do(run: VirtualService) -> None:
    with Client(run) as gateway, Client(run) as other:
        gateway.send("cobot_gateway")
        gateway.send("subscribe", topic="/cobot/graph", type="std_msgs/String")

        def graph() -> dict[str, Any]:
            return json.loads(gateway.next("publish")["msg"]["data"])

        first = graph()
        topics = {topic["name"]: topic for topic in first["topics"]}
        assert topics[f"/{run.name}/joint_cmd"]["subscribers"] == 1
        assert f"/{run.name}/joint_states" not in topics
        services = {service["name"]: service["type"] for service in first["services"]}
        assert services[f"/{run.name}/RobotConfig/getDof"] == "aubo_interfaces/srv/GetDof"
        assert "int32 result" in first["definitions"]["aubo_interfaces/srv/GetDof"]
        assert {"name": f"/{run.name}/servo_mode", "type": "aubo_interfaces/action/ServoMode"} in first[
            "actions"
        ]
        gateway.send("advertise", topic="/mirrored", type="std_msgs/String")
        other.send("subscribe", topic="/wanted", type="std_msgs/Bool")
        seen = graph()
        while "/wanted" not in {topic["name"] for topic in seen["topics"]}:
            seen = graph()
        assert "/mirrored" not in {topic["name"] for topic in seen["topics"]}


def test_what_is_wrong_is_answered_and_the_connection_lives(run: VirtualService) -> None:
    with Client(run) as client:
        for frame, sentence in (
            ("{", "the message is not valid JSON"),
            ("[1, 2]", "a message must be a JSON object"),
            ('{"op": "fly"}', "there is no op 'fly'"),
            ('{"op": "subscribe", "op": "publish"}', "the key 'op' occurs twice"),
            ("[" * 100_000, "nested too deeply"),
            (b"\x00\x01", "CBOR is not supported"),
            (" " * (4 * 2**20 + 1), "the message has 4194305 characters, allowed: 4194304"),
            ("[" + "0," * 200_001 + "0]", "the message has 200001 commas, allowed: 200000"),
        ):
            client.socket.send(frame)
            status = client.next("status")
            assert status["level"] == "error"
            assert sentence in status["msg"]
        assert client.call("/rosapi/nodes")["values"] == {"nodes": ["/cobot"]}


@pytest.mark.parametrize(
    ("operation", "answer"),
    [
        ({"op": "call_service", "service": "/rosapi/nodes"}, "service_response"),
        ({"op": "send_action_goal", "action": "/iiwa/follow_joint_trajectory"}, "action_result"),
        ({"op": "publish", "topic": "/demo"}, "status"),
    ],
)
def test_a_message_too_large_to_be_read_is_answered_with_its_id(
    run: VirtualService, operation: dict[str, Any], answer: str
) -> None:
    with Client(run) as client:
        client.socket.send(json.dumps({**operation, "id": 'mine "7"', "args": [0] * 200_001}))
        got = client.next(answer)
        assert got["id"] == 'mine "7"'
        assert "commas, allowed: 200000" in str(got.get("values", got.get("msg")))
        assert got.get("result", False) is False
        assert client.call("/rosapi/nodes")["result"]


def test_nobody_else_tells_what_the_service_knows(run: VirtualService) -> None:
    """Whoever follows /ROBOT/joint_states is told where the arm is by it alone. Frames are everybody's."""

    def published(client: Client, topic: str) -> str:
        type_ = run.app.state.graph.type_of(topic)
        client.send("advertise", topic=topic, type=type_, id="x")
        client.send("publish", topic=topic, msg={}, id="x")
        client.send("call_service", service="/rosapi/get_time", id="end")
        said = []
        while (message := json.loads(client.socket.recv(WAIT_S))).get("id") != "end":
            said.append(message.get("msg", ""))
        return " ".join(map(str, said))

    own = ("joint_states", "tcp_pose", "wrench", "status", "robot_description")
    of_actions = (f"{name}/_action/{what}" for name in ("servo_mode",) for what in ("feedback", "status"))
    with Client(run) as follower, Client(run) as client:
        follower.send("subscribe", topic=f"/{run.name}/tcp_pose")
        for topic in ("/cobot/graph", *(f"/{run.name}/{name}" for name in (*own, *of_actions))):
            said = published(client, topic)
            assert said.count(f"{topic} belongs to its publisher; no other client") == 2, said
        for topic in ("/tf", "/tf_static", f"/{run.name}/joint_cmd"):
            assert "belongs to its publisher" not in published(client, topic)
        graph = {topic["name"]: topic for topic in run.app.state.graph.graph()["topics"]}
        follower.send("subscribe", topic=f"/{run.name}/status")
        follower.call("/rosapi/get_time")
        graph = {topic["name"]: topic for topic in run.app.state.graph.graph()["topics"]}
        assert graph[f"/{run.name}/status"]["subscribers"] == 0, "nobody waits for another network's word"


def test_no_route_is_404_for_a_websocket_too(run: VirtualService) -> None:
    for path in ("/nowhere", "/robot/streams", "/health"):
        with pytest.raises(Refused, match="404") as refused:
            run.connect(path)
        assert json.loads(refused.value.body)["code"] == "not_found"


def test_a_page_from_elsewhere_is_refused(run: VirtualService) -> None:
    with pytest.raises(Refused, match="403"):
        Client(run, origin="http://elsewhere.example")
    with Client(run, origin=run.url) as own:
        assert own.call("/rosapi/nodes")["result"]


def test_there_are_only_so_many_clients(run: VirtualService) -> None:
    with contextlib.ExitStack() as stack:
        for _ in range(31):
            stack.enter_context(Client(run))
        run.until(lambda: refused(run, stack))
    run.until(lambda: not refused(run))


def refused(run: VirtualService, stack: contextlib.ExitStack | None = None) -> bool:
    """Whether another client is; one that is not goes, or stays with the stack."""
    with contextlib.ExitStack() as own:
        try:
            (stack or own).enter_context(Client(run))
        except Refused as exc:
            return exc.status == 503
    return False
