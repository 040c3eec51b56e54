"""Our node against a ROS 2 node on Fast DDS, the library under rmw_fastrtps, which is the oracle.

A reply that does not carry the identity of its request, or comes too early, is dropped there.
"""

from __future__ import annotations

import asyncio
import queue
from collections.abc import Iterator

import pytest
from cyclone_peer import (
    GetDofRequest,
    GetDofResponse,
    cyclone_participant,
    cyclone_reader,
    cyclone_writer,
)
from dds_peers import own_domain
from node_rig import NAME, NodeRig
from ros_peer import Peer, dds_type, until

from cobot.dds.node import Message

GET_DOF = "aubo_interfaces/srv/GetDof"
MOVE_JOINT = "aubo_interfaces/srv/MoveJoint"
STRING = "std_msgs/msg/String"


@pytest.fixture
def rig() -> Iterator[NodeRig]:
    with own_domain() as domain, NodeRig(domain) as made:
        yield made


@pytest.fixture
def peer(rig: NodeRig) -> Iterator[Peer]:
    with Peer(rig.domain, rig.messages) as made:
        yield made
        assert made.failures == []


async def seven(request: Message) -> Message:
    return {"code": 0, "message": "", "result": 7}


def test_a_message_reaches_a_subscriber_whatever_its_size(rig: NodeRig, peer: Peer) -> None:
    heard = peer.subscription("/demo", STRING)
    publisher = rig.do(lambda: rig.node.publisher("/demo", STRING))
    until(lambda: publisher.readers, "no reader")
    heard.until_matched()
    for size in (0, 1, 1000, 65_000, 300_000, 3_000_000):
        publisher.publish({"data": "x" * size})
        assert len(heard.get()["data"]) == size


def test_a_best_effort_subscriber_gets_messages_of_a_reliable_publisher(rig: NodeRig, peer: Peer) -> None:
    heard = peer.subscription("/demo", STRING, reliable=False)
    publisher = rig.do(lambda: rig.node.publisher("/demo", STRING))
    until(lambda: publisher.readers, "no reader")
    heard.until_matched()
    publisher.publish({"data": "hello"})
    assert heard.get() == {"data": "hello"}


def test_who_comes_late_gets_the_last_message_of_a_latched_topic(rig: NodeRig, peer: Peer) -> None:
    publisher = rig.do(lambda: rig.node.publisher("/robot_description", STRING, latched=True))
    publisher.publish({"data": "first"})
    publisher.publish({"data": "last"})
    assert peer.subscription("/robot_description", STRING, latched=True).get() == {"data": "last"}
    plain = peer.subscription("/robot_description", STRING)
    plain.until_matched()
    until(lambda: publisher.readers == 2, "the second reader is not found")
    publisher.publish({"data": "new"})
    assert plain.get() == {"data": "new"}


def test_a_subscription_gets_all_messages_in_their_order(rig: NodeRig, peer: Peer) -> None:
    got: queue.Queue[Message] = queue.Queue()
    rig.do(lambda: rig.node.subscription("/iiwa/joint_cmd", STRING, got.put))
    publisher = peer.publisher("/iiwa/joint_cmd", STRING, depth=2000)
    publisher.until_matched()
    for number in range(1000):
        publisher.publish({"data": f"point {number}"})
    assert [got.get(timeout=30.0)["data"] for _ in range(1000)] == [
        f"point {number}" for number in range(1000)
    ]


def test_a_message_that_is_none_is_refused_and_the_next_one_comes(rig: NodeRig, peer: Peer) -> None:
    got: queue.Queue[Message] = queue.Queue()
    subscription = rig.do(lambda: rig.node.subscription("/demo", STRING, got.put))
    publisher = peer.publisher("/demo", STRING)
    publisher.until_matched()
    for garbage in ("00010000ff", "00010000ffffff7f41", "0001000004000000ff41420000", "00"):
        peer.tell(f"write {publisher._number} {garbage}")
    publisher.publish({"data": "good"})
    assert got.get(timeout=30.0) == {"data": "good"}
    assert subscription.rejected.count >= 3


def test_the_first_request_of_each_client_is_answered(rig: NodeRig, peer: Peer) -> None:
    rig.do(lambda: rig.node.service("/iiwa/RobotConfig/getDof", GET_DOF, seven))
    for _ in range(20):
        client = peer.client("/iiwa/RobotConfig/getDof", GET_DOF).until_ready()
        assert client.call() == {"code": 0, "message": "", "result": 7}


def test_every_reply_of_a_burst_belongs_to_its_request(rig: NodeRig, peer: Peer) -> None:
    async def move(request: Message) -> Message:
        await asyncio.sleep(0.001 * (request["q"][0] % 7))  # answered in another order
        return {"code": 0, "message": str(request["q"]), "result": int(request["q"][0])}

    rig.do(lambda: rig.node.service("/iiwa/MotionControl/moveJoint", MOVE_JOINT, move))
    clients = [peer.client("/iiwa/MotionControl/moveJoint", MOVE_JOINT).until_ready() for _ in range(10)]
    for start in range(0, 400, 100):  # ten calls of each client: rmw keeps no more
        numbers = range(start, start + 100)
        waiting = {n: clients[n % 10].begin({"q": [float(n), 0.5], "a": 0.3}) for n in numbers}
        for number, reply in waiting.items():
            assert reply(30.0) == {"code": 0, "message": str([float(number), 0.5]), "result": number}


def test_a_handler_that_takes_long_delays_no_other_call(rig: NodeRig, peer: Peer) -> None:
    released = rig.do(asyncio.Event)

    async def wait(request: Message) -> Message:
        await released.wait()
        return {"result": 1}

    rig.do(lambda: rig.node.service("/slow", GET_DOF, wait))
    rig.do(lambda: rig.node.service("/quick", GET_DOF, seven))
    slow, quick = (peer.client(name, GET_DOF).until_ready() for name in ("/slow", "/quick"))
    waiting = [slow.begin({}) for _ in range(10)]
    assert [quick.call()["result"] for _ in range(10)] == [7] * 10
    rig.do(released.set)
    assert [reply(30.0)["result"] for reply in waiting] == [1] * 10


def test_a_request_that_is_none_harms_nobody(rig: NodeRig, peer: Peer) -> None:
    rig.do(lambda: rig.node.service("/iiwa/MotionControl/moveJoint", MOVE_JOINT, seven))
    client = peer.client("/iiwa/MotionControl/moveJoint", MOVE_JOINT).until_ready()
    for garbage in ("00", "00010000", "00010000ffffffff", "0001000003000000000000000000"):
        peer.tell(f"call {client._number} {peer.tag()} {garbage}")
    assert client.call({"q": [0.0]})["result"] == 7


def test_an_action_is_three_services_and_two_topics(rig: NodeRig, peer: Peer) -> None:
    count = "aubo_interfaces/action/Count"
    ended, cancelled = rig.do(asyncio.Event), rig.do(asyncio.Event)
    below = "/iiwa/count/_action"
    feedback = rig.do(lambda: rig.node.publisher(f"{below}/feedback", f"{count}_FeedbackMessage"))
    status = rig.do(
        lambda: rig.node.publisher(f"{below}/status", "action_msgs/msg/GoalStatusArray", latched=True)
    )

    async def send_goal(request: Message) -> Message:
        feedback.publish({"goal_id": request["goal_id"], "feedback": {"now": request["goal"]["until"]}})
        status.publish({"status_list": [{"goal_info": {"goal_id": request["goal_id"]}, "status": 2}]})
        return {"accepted": True}

    async def get_result(request: Message) -> Message:
        await ended.wait()
        return {"status": 5 if cancelled.is_set() else 4, "result": {"reached": 3}}

    async def cancel(request: Message) -> Message:
        cancelled.set()
        ended.set()
        return {"return_code": 0, "goals_canceling": [request["goal_info"]]}

    rig.do(lambda: rig.node.service(f"{below}/send_goal", f"{count}_SendGoal", send_goal))
    rig.do(lambda: rig.node.service(f"{below}/get_result", f"{count}_GetResult", get_result))
    rig.do(lambda: rig.node.service(f"{below}/cancel_goal", "action_msgs/srv/CancelGoal", cancel))
    heard = peer.subscription(f"{below}/feedback", f"{count}_FeedbackMessage")
    heard.until_matched()
    rig.until_known(f"rt{below}/feedback")
    goal_id = {"uuid": "AQIDBAUGBwgJCgsMDQ4PEA=="}
    send = peer.client(f"{below}/send_goal", f"{count}_SendGoal").until_ready()
    assert send.call({"goal_id": goal_id, "goal": {"until": 9}})["accepted"]
    assert heard.get() == {"goal_id": goal_id, "feedback": {"now": 9}}
    late = peer.subscription(f"{below}/status", "action_msgs/msg/GoalStatusArray", latched=True)
    assert late.get()["status_list"][0]["status"] == 2
    result = (
        peer.client(f"{below}/get_result", f"{count}_GetResult").until_ready().begin({"goal_id": goal_id})
    )
    stop = peer.client(f"{below}/cancel_goal", "action_msgs/srv/CancelGoal").until_ready()
    assert stop.call({"goal_info": {"goal_id": goal_id}})["goals_canceling"][0]["goal_id"] == goal_id
    assert result(30.0) == {"status": 5, "result": {"reached": 3}}


def test_everything_of_two_hundred_services_is_discovered_and_told_to_belong_to_the_node(
    rig: NodeRig, peer: Peer
) -> None:
    names = [f"/iiwa/Class/method{number}" for number in range(200)]
    rig.do(lambda: [rig.node.service(name, GET_DOF, seven) for name in names])
    wanted = {("r", f"rq{name}Request", dds_type(f"{GET_DOF}_Request")) for name in names}
    wanted |= {("w", f"rr{name}Reply", dds_type(f"{GET_DOF}_Response")) for name in names}
    until(lambda: wanted <= peer.found, "not all services are found")
    type_ = "rmw_dds_common/msg/ParticipantEntitiesInfo"
    info = peer.raw_subscription("ros_discovery_info", type_, latched=True)
    told = info.until(lambda message: len(message["node_entities_info_seq"][0]["reader_gid_seq"]) >= 200)
    (node,) = told["node_entities_info_seq"]
    assert (node["node_namespace"], node["node_name"]) == (NAME.namespace, NAME.name)
    assert len(node["writer_gid_seq"]) == 200


def test_what_is_closed_is_gone_for_others(rig: NodeRig, peer: Peer) -> None:
    service = rig.do(lambda: rig.node.service("/iiwa/RobotConfig/getDof", GET_DOF, seven))
    wanted = ("r", "rq/iiwa/RobotConfig/getDofRequest", dds_type(f"{GET_DOF}_Request"))
    until(lambda: wanted in peer.found, "the service is not found")
    rig.do(service.close)
    until(lambda: wanted not in peer.found, "the service is still there")


def test_a_client_of_rmw_cyclonedds_gets_its_header_back(rig: NodeRig) -> None:
    """It writes who asks into the payload (rmw_cyclonedds_cpp), here played on Cyclone DDS itself."""
    rig.do(lambda: rig.node.service("/iiwa/RobotConfig/getDof", GET_DOF, seven))
    with cyclone_participant(rig.domain) as participant:
        requests = cyclone_writer(participant, "rq/iiwa/RobotConfig/getDofRequest", GetDofRequest)
        replies = cyclone_reader(participant, "rr/iiwa/RobotConfig/getDofReply", GetDofResponse)
        until(
            lambda: requests.get_matched_subscriptions() and replies.get_matched_publications(), "no service"
        )
        requests.write(GetDofRequest(guid=0x1122334455667788, seq=42, structure_needs_at_least_one_member=0))
        reply = until(lambda: next(iter(replies.take()), None), "no reply")
    assert (reply.guid, reply.seq) == (0x1122334455667788, 42)
    assert (reply.code, reply.message, reply.result) == (0, "", 7)
