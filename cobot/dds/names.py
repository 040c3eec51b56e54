"""ROS 2 names in DDS, and the user data of endpoints, in the format of rmw_fastrtps_shared_cpp."""

from __future__ import annotations

from dataclasses import dataclass

ENCLAVE = b"enclave=/;"
"""User data of a participant. ROS 2 looks for the enclave in it."""

TYPE_HASH = b"typehash="
"""Prefix of the type hash in an endpoint's user data, used since Iron."""


def topic_name(topic: str) -> str:
    """The DDS name of a topic: rt/iiwa/joint_states for /iiwa/joint_states."""
    return f"rt{topic}"


def request_name(service: str) -> str:
    return f"rq{service}Request"


def reply_name(service: str) -> str:
    return f"rr{service}Reply"


def type_name(type_: str) -> str:
    """The DDS name of a type: std_msgs::msg::dds_::String_ for std_msgs/msg/String."""
    package, kind, last = type_.split("/")
    return f"{package}::{kind}::dds_::{last}_"


def type_hash(rihs: str) -> bytes:
    """The user data of a topic endpoint for ROS 2 Iron and later. Humble ignores the data."""
    return TYPE_HASH + f"{rihs};".encode()


@dataclass(frozen=True, slots=True)
class NodeName:
    """A node: `name` is "cobot", `namespace` is "/" or "/iiwa"."""

    name: str
    namespace: str = "/"

    @property
    def full(self) -> str:
        return f"{self.namespace.rstrip('/')}/{self.name}"
