"""The open connections, and the choice of the one that is evicted, so that a client can always send a stop.

The number of connections is limited, in total and for each address. When all places are taken, a new
connection replaces a connection that loses little by being closed. This is a connection that has not sent a
request yet, is between two requests, or is still sending a body. Of these connections, the oldest one from
the address with the most of them is chosen. A new connection has some time to send its request before it can
be evicted. Otherwise, in a flood, each new connection could evict a stop. For some time, a connection that
waits for /stop or /health is evicted last, unless more than half of the connections from its address wait in
this way. If all connections are being served, the new one gets a reserve place, on which only /stop and
/health are answered.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import Enum, auto


class Doing(Enum):
    """The activity of a connection. In the first four states it can be evicted."""

    ASKING = auto()  # the client is sending the header of a request, or has sent nothing yet
    IDLE = auto()  # between two requests
    SENDING = auto()  # the body of its request is being sent
    WAITING = auto()  # a /stop or /health, which may use the reserve, is waiting for its turn
    SERVED = auto()  # a request is being answered
    STREAMING = auto()  # a WebSocket


CLOSABLE = (Doing.ASKING, Doing.IDLE, Doing.SENDING, Doing.WAITING)
SETTLED_S = 0.25
"""Time for a new connection to send its request, s. After that it is evicted before connections that have
sent one.
"""
TURN_S = 2.0
"""How long a waiting /stop or /health is protected, s. After that it is evicted before new connections."""

EXPIRING = 4
"""Maximum number of expired connections that are closed at once."""


@dataclass(slots=True, eq=False)
class Visit:
    """A connection, from acceptance to its end.

    Attributes:
        reserved: whether it has a reserve place.
        since_s: time of acceptance.
        deadline_s: time by which the connection must have progressed; see `Crowd.expire`.
        close: function that closes the connection at once.
        expire: function that closes the connection because its deadline has passed.
    """

    reserved: bool
    close: Callable[[], object]
    expire: Callable[[], object]
    since_s: float
    _among: _Address
    doing: Doing = Doing.ASKING
    deadline_s: float = math.inf


@dataclass(slots=True, eq=False)
class _Address:
    """All visits from one address, grouped by `Doing`. In each group the oldest visit is first."""

    name: str
    visits: dict[Doing, dict[Visit, None]] = field(default_factory=lambda: {doing: {} for doing in Doing})

    @property
    def count(self) -> int:
        return sum(map(len, self.visits.values()))

    def connection_to_evict(self, now_s: float) -> Visit | None:
        """Choose the connection to evict. New connections and waiting ones are chosen only if there are no
        others.
        """
        oldest = [next(iter(self.visits[doing])) for doing in CLOSABLE if self.visits[doing]]
        settled = (visit for visit in oldest if now_s - visit.since_s >= _settled_s(visit))
        few = len(self.visits[Doing.WAITING]) <= self.count / 2
        return next(settled, None) or min(
            oldest, key=lambda visit: (few and visit.doing is Doing.WAITING, visit.since_s), default=None
        )


def _settled_s(visit: Visit) -> float:
    return TURN_S if visit.doing is Doing.WAITING else SETTLED_S


class Crowd:
    """All connections to the service.

    Args:
        places: maximum number of connections.
        per_address: maximum number of connections from one address.
        reserve: number of additional reserve places.
    """

    def __init__(self, places: int, per_address: int, reserve: int) -> None:
        self.places = places
        self.per_address = min(per_address, places)
        self._reserve = reserve
        self._addresses: dict[str, _Address] = {}
        self._reserved = _Address("")
        self._count = 0

    def __iter__(self) -> Iterator[Visit]:
        for address in (self._reserved, *self._addresses.values()):
            for visits in address.visits.values():
                yield from visits

    def __len__(self) -> int:
        return self._count + self._reserved.count

    def would_evict_recent(self, now_s: float, grace_s: float) -> bool:
        """Whether a new connection would evict a connection that got its place from the reserve less than
        `grace_s` ago.
        """
        if self._count < self.per_address or self._reserved.count < self._reserve:
            return False
        oldest = self._reserved.connection_to_evict(now_s)
        return oldest is not None and now_s - oldest.since_s < grace_s

    def enter(self, address: str, close: Callable[[], object], now_s: float = 0.0) -> Visit | None:
        """Give a new connection a place, if necessary by evicting another connection. Returns None if no
        place can be made free.
        """
        own = self._addresses.get(address)
        room = True
        if own is not None and own.count >= self.per_address:
            room = self._close_one(own, now_s)
        elif self._count >= self.places:
            room = self.make_room(now_s)
        if not room and self._reserved.count >= self._reserve and not self._close_one(self._reserved, now_s):
            return None
        among = self._addresses.setdefault(address, _Address(address)) if room else self._reserved
        visit = Visit(not room, close, close, now_s, among)
        among.visits[visit.doing][visit] = None
        self._count += room
        return visit

    def note_progress(self, visit: Visit, doing: Doing, deadline_s: float = math.inf) -> None:
        """Record that a connection has progressed. Does nothing if the connection is closed."""
        here = visit._among.visits
        visit.deadline_s = deadline_s
        if here[visit.doing].pop(visit, self) is None:
            visit.doing = doing
            here[doing][visit] = None

    def leave(self, visit: Visit) -> None:
        """Record that a connection is closed or is being closed."""
        among = visit._among
        if among.visits[visit.doing].pop(visit, self) is None and not visit.reserved:
            self._count -= 1
            if not among.count:
                del self._addresses[among.name]

    def expire(self, now_s: float) -> bool:
        """Close some connections that have not progressed by their deadline. Returns whether there are more.

        Closing 300 connections takes 70 ms, and the connections of a flood expire together, so only some are
        closed at once.
        """
        overdue = [each for each in self if each.deadline_s < now_s]
        for visit in overdue[:EXPIRING]:
            visit.deadline_s = math.inf  # until its next request
            visit.expire()
        return len(overdue) > EXPIRING

    def make_room(self, now_s: float) -> bool:
        """Evict a connection, and return whether there was one to evict."""
        addresses = sorted(self._addresses.values(), key=lambda each: -each.count)
        return any(self._close_one(address, now_s) for address in addresses)

    def _close_one(self, address: _Address, now_s: float) -> bool:
        visit = address.connection_to_evict(now_s)
        if visit is not None:
            self.leave(visit)
            visit.close()
        return visit is not None
