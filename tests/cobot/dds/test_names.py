"""Names on DDS. Oracle: what rmw_fastrtps writes for the same names, as captured in the ROS 2 design article
"Topic and Service name mapping to DDS"."""

from __future__ import annotations

from cobot.dds.names import NodeName, reply_name, request_name, topic_name, type_hash, type_name


def test_topics_and_services_have_the_prefixes_of_ros_2() -> None:
    assert topic_name("/iiwa/joint_states") == "rt/iiwa/joint_states"
    assert request_name("/iiwa/get_dof") == "rq/iiwa/get_dofRequest"
    assert reply_name("/iiwa/get_dof") == "rr/iiwa/get_dofReply"


def test_types_have_the_namespace_dds_and_an_underscore() -> None:
    assert type_name("std_msgs/msg/String") == "std_msgs::msg::dds_::String_"
    assert type_name("std_srvs/srv/SetBool_Request") == "std_srvs::srv::dds_::SetBool_Request_"
    assert type_hash("RIHS01_ab") == b"typehash=RIHS01_ab;"


def test_a_nodes_full_name_has_one_slash_between_its_parts() -> None:
    assert NodeName("cobot").full == "/cobot"
    assert NodeName("cobot", "/iiwa").full == "/iiwa/cobot"
