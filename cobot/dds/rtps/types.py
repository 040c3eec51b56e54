"""The types in the public interface: identities, quality of service, samples, limits and counters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Address = tuple[str, int]
"""An IPv4 address and a UDP port."""

PREFIX_BYTES = 12
UNKNOWN_ENTITY = bytes(4)
PARTICIPANT_ENTITY = bytes((0, 0, 1, 0xC1))
_MIB = 1 << 20


class Guid(bytes):
    """16 bytes that identify a participant, a writer or a reader. The first 12 identify the participant, the
    last 4 the entity.
    """

    __slots__ = ()

    @property
    def prefix(self) -> bytes:
        return self[:PREFIX_BYTES]

    @property
    def entity(self) -> bytes:
        return self[PREFIX_BYTES:]

    @property
    def is_reader(self) -> bool:
        """Whether the last byte identifies a reader (RTPS 2.2, table 9.1)."""
        return self[-1] & 0x3F in (0x04, 0x07)

    def __repr__(self) -> str:
        return f"Guid({self.prefix.hex()}|{self.entity.hex()})"


@dataclass(frozen=True, slots=True)
class SampleIdentity:
    """Identifies one sample of one writer. In requests, some clients use the guid of their reply reader as
    `writer`.
    """

    writer: Guid
    sequence: int


@dataclass(frozen=True, slots=True)
class Qos:
    """Quality of service of a writer or a reader.

    depth: number of samples kept for late or slow readers. With None, a writer keeps all samples that are not
    acknowledged, and a reader all that are not delivered, within `ParticipantLimits`. For a remote endpoint
    the depth is unknown, and None.
    """

    reliable: bool = True
    transient_local: bool = False
    depth: int | None = 10

    def __post_init__(self) -> None:
        if self.depth is not None and self.depth < 1:
            raise ValueError(f"the depth of a Qos is {self.depth}; it must be 1 or more, or None")

    def satisfies(self, requested: Qos) -> bool:
        """Whether a reader that requests `requested` may read from a writer that offers this quality of
        service.
        """
        return self.reliable >= requested.reliable and self.transient_local >= requested.transient_local


@dataclass(frozen=True, slots=True)
class Sample:
    """One received sample.

    Attributes:
        payload: the serialised bytes with their 4-byte encapsulation header.
        related: the inline QoS `related_sample_identity`; None if the sample has none.
        source_time: seconds since 1970 on the writer's clock; None if the writer has sent no time.
        vendor: vendor of the writer's DDS, such as 0x010F for Fast DDS and 0x0110 for Cyclone DDS.
    """

    payload: bytes
    writer: Guid
    sequence: int
    related: SampleIdentity | None
    source_time: float | None
    vendor: int


@dataclass(frozen=True, slots=True)
class RemoteParticipant:
    guid: Guid
    name: str
    user_data: bytes
    vendor: int


@dataclass(frozen=True, slots=True)
class RemoteEndpoint:
    """A writer or reader of another participant, as that participant has announced it."""

    guid: Guid
    kind: Literal["writer", "reader"]
    topic: str
    type_name: str
    qos: Qos
    user_data: bytes
    participant: RemoteParticipant


@dataclass(frozen=True, slots=True)
class ParticipantLimits:
    """Limits for the memory and the work that peers can cause in this participant; sizes in bytes.

    Attributes:
        payload: size of one sample, sent or received.
        history: size of the samples that one writer keeps for its readers; the oldest are removed first.
        history_samples: maximum number of samples that a writer without a depth keeps.
        buffered_per_writer: size of incomplete and out-of-order samples from one remote writer.
        buffered: the same for all remote writers together. Above this limit, the writer with the most
            buffered bytes loses its samples.
        undelivered: size of the samples of one reader that wait for its callback.
        window: how far ahead of the next sample a kept sample may be.
    """

    payload: int = 16 * _MIB
    history: int = 64 * _MIB
    history_samples: int = 10_000
    buffered_per_writer: int = 32 * _MIB
    buffered: int = 128 * _MIB
    undelivered: int = 64 * _MIB
    window: int = 1024
    participants: int = 128
    endpoints: int = 10_000
    endpoints_per_participant: int = 1_000


@dataclass(slots=True)
class ParticipantStatistics:
    """Counters since the start.

    datagrams_dropped: datagrams dropped by the loss model of a test.
    malformed: datagrams that violate RTPS. Their valid beginning was used.
    refused: samples, fragments or announcements beyond `ParticipantLimits`.
    overrun: samples that left a history or a queue before they were acknowledged or delivered.
    failed: errors in callbacks and in this package. Each is logged.
    """

    datagrams_received: int = 0
    datagrams_sent: int = 0
    datagrams_dropped: int = 0
    send_errors: int = 0
    malformed: int = 0
    refused: int = 0
    overrun: int = 0
    failed: int = 0
