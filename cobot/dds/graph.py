"""The assignment of endpoints to nodes. `ros2 node list` and `ros2 node info` read it.

Each participant publishes it as one transient-local sample of rmw_dds_common/msg/ParticipantEntitiesInfo on
the topic ros_discovery_info. A gid is char[24] in Humble and char[16] in Iron and later, so each size has its
own writer. The user data of a reader shows its release: in Iron and later it contains the type hash.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable, Iterable, Sequence

from cobot.dds.names import TYPE_HASH, NodeName
from cobot.dds.rtps import Guid, Participant, Qos, RemoteEndpoint

TOPIC = "ros_discovery_info"
TYPE = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_"
HUMBLE_GID, LATER_GID = 24, 16
DELAY_S = 0.02
"""Time within which changes are collected into one sample, in seconds."""


class NodeGraph:
    """Publishes the list of one node's endpoints.

    Args:
        gid_bytes: size of a gid for all readers: 24 for Humble, 16 for Iron and later. With None, the release
            of each reader determines the size.
    """

    def __init__(
        self,
        participant: Participant,
        node: NodeName,
        gid_bytes: int | None,
        loop: asyncio.AbstractEventLoop,
    ) -> None:
        self._participant = participant
        self._node = node
        self._loop = loop
        self._readers: dict[Guid, None] = {}
        self._writers: dict[Guid, None] = {}
        self._telling: asyncio.TimerHandle | None = None
        readers: dict[int, Callable[[RemoteEndpoint], bool] | None] = (
            {gid_bytes: None}
            if gid_bytes
            else {
                HUMBLE_GID: lambda reader: not is_later(reader),
                LATER_GID: is_later,
            }
        )
        qos = Qos(reliable=True, transient_local=True, depth=1)
        self._writers_by_gid = {
            size: participant.create_writer(TOPIC, TYPE, qos, accepts=accepts)
            for size, accepts in readers.items()
        }
        self._change()

    def add(self, *endpoints: Guid) -> None:
        for guid in endpoints:
            (self._readers if guid.is_reader else self._writers)[guid] = None
        self._change()

    def remove(self, *endpoints: Guid) -> None:
        for guid in endpoints:
            self._readers.pop(guid, None)
            self._writers.pop(guid, None)
        self._change()

    def close(self) -> None:
        if self._telling is not None:
            self._telling.cancel()

    def _change(self) -> None:
        if self._telling is None:
            self._telling = self._loop.call_later(DELAY_S, self._tell)

    def _tell(self) -> None:
        self._telling = None
        for size, writer in self._writers_by_gid.items():
            writer.write(entities(self._participant.guid, self._node, self._readers, self._writers, size))


def is_later(reader: RemoteEndpoint) -> bool:
    """Whether a reader uses ROS 2 Iron or a later release."""
    return TYPE_HASH in reader.user_data


def entities(
    participant: Guid, node: NodeName, readers: Iterable[Guid], writers: Iterable[Guid], gid_bytes: int
) -> bytes:
    """A ParticipantEntitiesInfo that lists one node, encoded as CDR."""
    out = bytearray(_gid(participant, gid_bytes))
    _number(out, 1)
    _text(out, node.namespace)
    _text(out, node.name)
    for guids in (list(readers), list(writers)):
        _gids(out, guids, gid_bytes)
    return b"\0\1\0\0" + bytes(out)


def _gid(guid: Guid, size: int) -> bytes:
    return bytes(guid) + bytes(size - len(guid))


def _gids(out: bytearray, guids: Sequence[Guid], size: int) -> None:
    _number(out, len(guids))
    for guid in guids:
        out += _gid(guid, size)


def _text(out: bytearray, text: str) -> None:
    encoded = text.encode() + b"\0"
    _number(out, len(encoded))
    out += encoded


def _number(out: bytearray, value: int) -> None:
    out += bytes(-len(out) % 4) + struct.pack("<I", value)
