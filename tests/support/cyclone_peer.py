"""A participant on Cyclone DDS, the library under rmw_cyclonedds, with the types that the tests need."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, int64, sequence, uint8, uint32, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

LOCALHOST = """<CycloneDDS><Domain><General><Interfaces>
<NetworkInterface address="127.0.0.1" multicast="true"/>
</Interfaces></General></Domain></CycloneDDS>"""
RELIABLE = Qos(Policy.Reliability.Reliable(10**9), Policy.History.KeepLast(100))


@dataclass
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dataclass
class GetDofRequest(IdlStruct, typename="aubo_interfaces::srv::dds_::GetDof_Request_"):
    """As rmw_cyclonedds writes it: with who asks in front."""

    guid: uint64
    seq: int64
    structure_needs_at_least_one_member: uint8


@dataclass
class GetDofResponse(IdlStruct, typename="aubo_interfaces::srv::dds_::GetDof_Response_"):
    guid: uint64
    seq: int64
    code: int32
    message: str
    result: int32


@contextlib.contextmanager
def cyclone_participant(domain: int) -> Iterator[DomainParticipant]:
    """On this computer only."""
    with contextlib.ExitStack() as stack:
        settings = Domain(domain, LOCALHOST)
        stack.callback(lambda: settings)  # lives as long as the participant
        yield DomainParticipant(domain)


def cyclone_writer(participant: DomainParticipant, topic: str, kind: type[IdlStruct]) -> Any:
    return DataWriter(participant, Topic(participant, topic, kind), qos=RELIABLE)


def cyclone_reader(participant: DomainParticipant, topic: str, kind: type[IdlStruct]) -> Any:
    return DataReader(participant, Topic(participant, topic, kind), qos=RELIABLE)
