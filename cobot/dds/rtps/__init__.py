"""RTPS 2.2, the wire protocol of DDS, in pure Python, as far as communication with ROS 2 nodes needs it."""

from cobot.dds.rtps.errors import ClosedError, MalformedError, NetworkError, RtpsError, SampleTooLargeError
from cobot.dds.rtps.participant import Participant
from cobot.dds.rtps.participant_record import ParticipantRecord
from cobot.dds.rtps.reader import TopicReader as Reader
from cobot.dds.rtps.types import (
    Guid,
    ParticipantLimits,
    ParticipantStatistics,
    Qos,
    RemoteEndpoint,
    RemoteParticipant,
    Sample,
    SampleIdentity,
)
from cobot.dds.rtps.writer import Writer

__all__ = [
    "ClosedError",
    "Guid",
    "MalformedError",
    "NetworkError",
    "Participant",
    "ParticipantLimits",
    "ParticipantRecord",
    "ParticipantStatistics",
    "Qos",
    "Reader",
    "RemoteEndpoint",
    "RemoteParticipant",
    "RtpsError",
    "Sample",
    "SampleIdentity",
    "SampleTooLargeError",
    "Writer",
]
