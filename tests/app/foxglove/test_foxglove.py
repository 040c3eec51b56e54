"""Live data for Foxglove, on virtual time.

Oracles: a client of the published protocol, written here with `json` and `struct` alone; rosbags, which reads
the messages by the definitions that came over the wire; what REST says about the same arm.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asgi_client import Refused, Socket
from plant_service import THE_CELL, ServiceOfPlant
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from virtual_service import VirtualService, virtual_service

from app.foxglove import router

PROTOCOL = "foxglove.sdk.v1"
AWAY = [0.3, 0.2, 0.0, -1.2, 0.0, 1.4, 0.0]
TOPICS = ["/joint_states", "/commanded", "/wrench", "/cycle", "/events"]


class Foxglove:
    """The other end."""

    def __init__(
        self, service: VirtualService, path: str = "/foxglove?rate_hz=50", protocol: str = PROTOCOL
    ) -> None:
        self.socket: Socket = service.connect(path, subprotocols=protocol)
        self.info = self.told("serverInfo")
        self.channels = {each["topic"]: each for each in self.told("advertise")["channels"]}
        self.store = get_typestore(Stores.EMPTY)
        for each in self.channels.values():
            assert (each["encoding"], each["schemaEncoding"]) == ("cdr", "ros2msg")
            types = get_types_from_msg(each["schema"], each["schemaName"])
            self.store.register(
                {name: kind for name, kind in types.items() if name not in self.store.fielddefs}
            )

    def __enter__(self) -> Foxglove:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def send(self, **message: Any) -> None:
        self.socket.send(json.dumps(message))

    def told(self, op: str) -> dict[str, Any]:
        while True:
            message = self.socket.recv()
            if isinstance(message, str) and (found := json.loads(message))["op"] == op:
                return dict(found)

    def subscribe(self, topic: str, number: int) -> None:
        asked = {"id": number, "channelId": self.channels[topic]["id"]}
        self.send(op="subscribe", subscriptions=[asked])

    def data(self, number: int) -> tuple[int, bytes]:
        """The time and the content of the next message of a subscription."""
        while True:
            message = self.socket.recv()
            if isinstance(message, str):
                assert json.loads(message)["op"] != "status", message
                continue
            kind, subscription, moment_ns = struct.unpack_from("<BIQ", message)
            assert kind == 1
            if subscription == number:
                return moment_ns, message[13:]

    def read(self, topic: str, number: int) -> Any:
        return self.store.deserialize_cdr(self.data(number)[1], self.channels[topic]["schemaName"])


@pytest.fixture
def run(service: VirtualService) -> VirtualService:
    service.go_home()
    return service


@pytest.mark.parametrize("protocol", [PROTOCOL, "foxglove.websocket.v1", f"other, {PROTOCOL}"])
def test_it_says_what_there_is_with_the_definitions_of_the_recordings(
    run: VirtualService, protocol: str
) -> None:
    with Foxglove(run, protocol=protocol) as client:
        assert client.socket.subprotocol == protocol.rpartition(" ")[2]
        assert client.info["name"] == "cobot"
        assert list(client.channels) == TOPICS


def test_who_speaks_another_protocol_is_refused(run: VirtualService) -> None:
    for offered in ("", "rosbridge"):
        with pytest.raises(Refused) as refused:
            run.connect("/foxglove", subprotocols=offered)
        assert refused.value.status == 422
    for rate in ("0", "nan", "x", "1000"):
        with pytest.raises(Refused) as refused:
            run.connect(f"/foxglove?rate_hz={rate}", subprotocols=PROTOCOL)
        assert refused.value.status == 422


def test_the_state_comes_as_rest_has_it(run: VirtualService) -> None:
    with Foxglove(run) as client:
        client.subscribe("/joint_states", 7)
        joints = client.read("/joint_states", 7)
        assert joints.name == run.get("/robot/joint_states").json()["name"]
        np.testing.assert_allclose(joints.position, run.joints(), atol=1e-3)
        client.subscribe("/cycle", 8)
        cycle = client.read("/cycle", 8)
        pose = run.get("/robot/pose").json()["position"]
        assert [cycle.tcp.position.x, cycle.tcp.position.z] == pytest.approx([pose["x"], pose["z"]], abs=1e-3)
        assert cycle.mode == cycle.MODE_HOLD
        assert cycle.header.frame_id == run.app.state.services.robot.base_frame
        client.subscribe("/wrench", 9)
        assert np.isfinite(client.read("/wrench", 9).wrench.force.x)


def test_the_gripper_has_a_topic_which_reports_what_rest_reports(tmp_path: Path) -> None:
    with ServiceOfPlant(tmp_path, of_robot=THE_CELL).serving() as run:
        run.go_home()
        run.post("/robot/gripper/move", {"width": 0.06}).raise_for_status()
        run.sleep(0.3)
        with Foxglove(run) as client:
            assert list(client.channels) == [*TOPICS, "/gripper"]
            client.subscribe("/gripper", 3)
            seen = client.read("/gripper", 3)
        state = run.get("/robot/gripper").json()["state"]
        names = ("width", "commanded_width", "force", "moving")
        assert [getattr(seen, f"gripper_{name}") for name in names] == pytest.approx(
            [state[name] for name in names], abs=1e-4
        )
        assert (state["object"], seen.gripper_object) == ("none", seen.OBJECT_NONE)


def test_a_motion_is_seen_and_told(run: VirtualService) -> None:
    with Foxglove(run) as client:
        for number, topic in enumerate(TOPICS):
            client.subscribe(topic, number)
        client.data(0)
        moving = run.begin(run.asking("POST", "/robot/move/joints", json={"joints": AWAY, "speed": 0.5}))
        kinds = []
        while "motion" not in kinds:
            event = client.read("/events", 4)
            kinds.append(event.kind)
        assert json.loads(event.text)["what"] == "begun"
        speeds = [np.abs(client.read("/joint_states", 0).velocity).max() for _ in range(20)]
        assert max(speeds) > 0.05
        commanded = client.read("/commanded", 1)
        assert np.abs(np.array(commanded.position) - AWAY).max() < 1.5
        run.end(moving)


def test_it_comes_at_the_rate_that_was_asked_for_and_no_more_after_unsubscribe(run: VirtualService) -> None:
    with Foxglove(run, "/foxglove?rate_hz=10") as client:
        client.subscribe("/joint_states", 1)
        moments = [client.data(1)[0] for _ in range(6)]
        np.testing.assert_allclose(np.diff(moments) * 1e-9, 0.1, atol=0.02)
        client.send(op="unsubscribe", subscriptionIds=[1])
        client.subscribe("/wrench", 2)
        client.data(2)
        run.sleep(0.5)
        client.data(2)


@pytest.mark.parametrize(
    ("message", "said"),
    [
        ({"op": "advertise", "channels": []}, "op: 'advertise' is not served"),
        ({"op": "subscribe"}, "subscriptions: must be a list"),
        ({"op": "subscribe", "subscriptions": [3]}, "each must be an object"),
        ({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 99}]}, "there is no channel 99"),
        ({"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 1}]}, "id: must be a whole number"),
        (
            {"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 1}] * 2},
            "subscription 1 already exists",
        ),
        ({"op": "unsubscribe", "subscriptionIds": ["x"]}, "subscriptionIds: must be a whole number"),
        ("no JSON", "is not valid JSON"),
        (["a", "list"], "op:"),
        (b"\1binary", "binary messages are not supported"),
    ],
)
def test_what_is_not_understood_is_said_and_the_rest_goes_on(
    run: VirtualService, message: Any, said: str
) -> None:
    with Foxglove(run) as client:
        client.socket.send(message if isinstance(message, str | bytes) else json.dumps(message))
        status = client.told("status")
        assert status["level"] == 2
        assert said in status["message"]
        client.subscribe("/joint_states", 50)
        client.data(50)


def test_nobody_has_the_service_send_the_same_a_thousand_times(run: VirtualService) -> None:
    """A thousand subscriptions of one topic, at 100 Hz, by 16 clients: 1.6 million messages a second."""
    with Foxglove(run) as client:
        channel = client.channels["/joint_states"]["id"]
        wanted = [{"id": number, "channelId": channel} for number in range(65)]
        client.send(op="subscribe", subscriptions=wanted)
        assert client.told("status")["message"] == "there are already 64 subscriptions, which is the maximum"
        client.data(63)


def test_so_many_may_look_and_places_become_free(
    run: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(router, "MAX_CLIENTS", 1)
    with Foxglove(run):
        with pytest.raises(Refused) as refused:
            Foxglove(run)
        assert refused.value.status == 503
    run.until(lambda: run.app.state.foxglove_clients == 0)
    with Foxglove(run):
        pass


def test_of_several_robots_each_has_its_topics(tmp_path_factory: pytest.TempPathFactory) -> None:
    with virtual_service(tmp_path_factory.mktemp("pair"), 2) as pair:
        first, second = pair.names
        with Foxglove(pair) as client:
            assert list(client.channels) == [
                f"/{name}{topic}" for name in (first, second) for topic in TOPICS
            ]
            client.subscribe(f"/{second}/joint_states", 1)
            assert len(client.read(f"/{second}/joint_states", 1).position) == 7
        with Foxglove(pair, f"/robots/{second}/foxglove") as client:
            assert list(client.channels) == TOPICS
        with pytest.raises(Refused) as refused:
            Foxglove(pair, "/robots/nobody/foxglove")
        assert refused.value.status == 404
