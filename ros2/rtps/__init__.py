"""RTPS 2.2, the wire protocol of DDS, in pure Python: enough of it to be a good neighbour of ROS 2 nodes."""

from ros2.rtps.errors import ClosedError, MalformedError, NetworkError, PayloadError, RtpsError
from ros2.rtps.last_words import LastWords
from ros2.rtps.participant import Participant
from ros2.rtps.reader import TopicReader as Reader
from ros2.rtps.types import (
    Guid,
    Limits,
    Qos,
    RemoteEndpoint,
    RemoteParticipant,
    Sample,
    SampleIdentity,
    Statistics,
)
from ros2.rtps.writer import Writer

__all__ = [
    "ClosedError",
    "Guid",
    "LastWords",
    "Limits",
    "MalformedError",
    "NetworkError",
    "Participant",
    "PayloadError",
    "Qos",
    "Reader",
    "RemoteEndpoint",
    "RemoteParticipant",
    "RtpsError",
    "Sample",
    "SampleIdentity",
    "Statistics",
    "Writer",
]
