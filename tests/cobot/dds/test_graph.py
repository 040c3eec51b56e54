"""What `ros2 node list` reads. Oracle: the message as `rosbags` defines it for Humble and for Jazzy."""

from __future__ import annotations

import struct

import pytest
from dds_peers import own_domain
from node_rig import NodeRig
from ros_peer import until
from rosbags.typesys import Stores, get_typestore

from cobot.dds.graph import TOPIC, TYPE, entities
from cobot.dds.names import NodeName, reply_name, request_name, topic_name, type_hash, type_name
from cobot.dds.rtps import Guid, Participant, Qos

NAME = "rmw_dds_common/msg/ParticipantEntitiesInfo"


def guid(number: int) -> Guid:
    return Guid(struct.pack(">QQ", 0x0123456789ABCDEF, number))


@pytest.mark.parametrize(("store", "size"), [(Stores.ROS2_HUMBLE, 24), (Stores.ROS2_JAZZY, 16)])
@pytest.mark.parametrize("node", [NodeName("cobot"), NodeName("servo", "/iiwa/left")])
def test_the_graph_is_what_ros_reads(store: Stores, size: int, node: NodeName) -> None:
    readers, writers = [guid(1), guid(2), guid(3)], [guid(4)]
    content = entities(guid(9), node, readers, writers, size)
    read = get_typestore(store).deserialize_cdr(content, NAME)
    assert read.gid.data.tobytes() == guid(9) + bytes(size - 16)
    (told,) = read.node_entities_info_seq
    assert (told.node_namespace, told.node_name) == (node.namespace, node.name)
    assert [each.data.tobytes()[:16] for each in told.reader_gid_seq] == readers
    assert [each.data.tobytes()[:16] for each in told.writer_gid_seq] == writers


def test_names_are_those_of_rmw_fastrtps() -> None:
    assert topic_name("/iiwa/joint_states") == "rt/iiwa/joint_states"
    assert request_name("/iiwa/RobotConfig/getDof") == "rq/iiwa/RobotConfig/getDofRequest"
    assert reply_name("/iiwa/RobotConfig/getDof") == "rr/iiwa/RobotConfig/getDofReply"
    assert type_name("std_msgs/msg/String") == "std_msgs::msg::dds_::String_"
    assert type_name("a/action/B_SendGoal_Request") == "a::action::dds_::B_SendGoal_Request_"


def test_a_node_in_the_root_has_one_slash() -> None:
    assert NodeName("cobot").full == "/cobot"
    assert NodeName("servo", "/iiwa").full == "/iiwa/servo"


def test_each_reader_gets_the_graph_in_the_form_of_its_release() -> None:
    heard: dict[str, list[bytes]] = {"humble": [], "jazzy": []}
    with own_domain() as domain, NodeRig(domain) as rig:
        other = Participant(domain, localhost_only=True)
        qos = Qos(reliable=True, transient_local=True, depth=1)
        for release, user_data in (("humble", b""), ("jazzy", type_hash("RIHS01_0123"))):
            got = heard[release]
            other.create_reader(TOPIC, TYPE, qos, lambda s, got=got: got.append(s.payload), user_data)
        until(lambda: all(heard.values()), "no graph")
        until(lambda: rig.participant.discovered(), "the readers are not known")
        other.close()
    for release, store in (("humble", Stores.ROS2_HUMBLE), ("jazzy", Stores.ROS2_JAZZY)):
        for content in heard[release]:
            read = get_typestore(store).deserialize_cdr(content, NAME)
            assert [each.node_name for each in read.node_entities_info_seq] == ["cobot"]
