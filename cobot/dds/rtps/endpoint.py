"""Base class of the writing side and the reading side of a topic."""

from __future__ import annotations

from typing import Generic, TypeVar

from cobot.dds.rtps import submessages
from cobot.dds.rtps.announcements import EndpointAnnouncement
from cobot.dds.rtps.types import Guid
from cobot.dds.rtps.wire import Wire

Proxy = TypeVar("Proxy")
"""Type of the record that an endpoint keeps for a matched peer."""


class RtpsEndpoint(Generic[Proxy]):
    """An endpoint with the properties that it announces. It keeps a proxy for each matched peer."""

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
