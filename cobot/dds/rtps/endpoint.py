"""What the writing and the reading side of a topic have in common."""

from __future__ import annotations

from typing import Generic, TypeVar

from cobot.dds.rtps import submessages
from cobot.dds.rtps.announcements import EndpointAnnouncement
from cobot.dds.rtps.types import Guid
from cobot.dds.rtps.wire import Wire

Proxy = TypeVar("Proxy")
"""The type of what an endpoint knows of one of its peers."""


class RtpsEndpoint(Generic[Proxy]):
    """Is what its announcement says, and keeps a proxy for each peer that it is matched with."""

    def __init__(self, wire: Wire, announcement: EndpointAnnouncement) -> None:
        self.announcement = announcement
        self.guid = announcement.guid
        self.topic = announcement.topic
        self.type_name = announcement.type_name
        self.qos = announcement.qos
        self._wire = wire
        self._header = submessages.protocol_header(self.guid.prefix)
        self._proxies: dict[bytes, Proxy] = {}
        self._closed = False

    @property
    def matched(self) -> tuple[Guid, ...]:
        with self._wire.lock:
            return tuple(Guid(guid) for guid in self._proxies)
