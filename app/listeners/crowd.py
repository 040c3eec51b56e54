"""The open connections, and which of them is evicted so that a stop can still come in.

The number of connections is limited, in all and for each address. When there is no room, a newcomer replaces
a connection that loses little: one that has not sent a request yet, one between two requests, or one whose
body is still on its way. It is the oldest such connection of the address that has most of them. A new
connection has some time to send its request before it can be evicted; otherwise each newcomer of a flood
would cost a stop its place. A connection that waits for /stop or /health is evicted last, for some time,
unless half of an address's connections wait so.
If all connections are being served, the newcomer gets a reserve place, which answers only /stop and /health.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import Enum, auto


class Doing(Enum):
    """What a connection is about; those of the first four can be closed without any loss but their own."""

    ASKING = auto()  # its request, or the beginning of one, is on its way
    IDLE = auto()  # between two requests
    SENDING = auto()  # the body of its request is on its way
    WAITING = auto()  # for the turn of what the reserve is there for: a stop, /health
    SERVED = auto()  # a request is being worked on
    STREAMING = auto()  # a WebSocket


CLOSABLE = (Doing.ASKING, Doing.IDLE, Doing.SENDING, Doing.WAITING)
SETTLED_S = 0.25
"""Time for a new connection to send its request, s. Then it is evicted before those that have sent one."""
TURN_S = 2.0
"""Time for which /stop or /health may wait for its turn, s. Then it is evicted before new connections."""

EXPIRING = 4
"""Maximum number of expired connections that are closed at once."""


@dataclass(slots=True, eq=False)
class Visit:
    """A connection from its acceptance to its end.

    Attributes:
        reserved: whether it has a place of the reserve.
        since_s: when it was accepted.
        deadline_s: when it has to have gone on; see `Crowd.expire`.
        close: ends it at once.
        expire: ends it because its time is up.
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
    """All visits from one address, grouped by `Doing`, the oldest first in each group."""

    name: str
    visits: dict[Doing, dict[Visit, None]] = field(default_factory=lambda: {doing: {} for doing in Doing})

    @property
    def count(self) -> int:
        return sum(map(len, self.visits.values()))

    def connection_to_evict(self, now_s: float) -> Visit | None:
        """The connection to evict; a new or waiting one only if there is no other."""
        oldest = [next(iter(self.visits[doing])) for doing in CLOSABLE if self.visits[doing]]
        settled = (visit for visit in oldest if now_s - visit.since_s >= _settled_s(visit))
        few = len(self.visits[Doing.WAITING]) <= self.count / 2
        return next(settled, None) or min(
            oldest, key=lambda visit: (few and visit.doing is Doing.WAITING, visit.since_s), default=None
        )


def _settled_s(visit: Visit) -> float:
    return TURN_S if visit.doing is Doing.WAITING else SETTLED_S


class Crowd:
    """All visits.

    Args:
        places: for connections; per_address: for those of one address; reserve: beyond them.
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

    def hurries(self, now_s: float, grace_s: float) -> bool:
        """Whether a new connection might cost one its place of the reserve that has just got it."""
        if self._count < self.per_address or self._reserved.count < self._reserve:
            return False
        oldest = self._reserved.connection_to_evict(now_s)
        return oldest is not None and now_s - oldest.since_s < grace_s

    def enter(self, address: str, close: Callable[[], object], now_s: float = 0.0) -> Visit | None:
        """A place for a new connection; None if there is none at all."""
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

    def go_on(self, visit: Visit, doing: Doing, deadline_s: float = math.inf) -> None:
        """A connection has come further. Nothing happens for one that has been closed."""
        here = visit._among.visits
        visit.deadline_s = deadline_s
        if here[visit.doing].pop(visit, self) is None:
            visit.doing = doing
            here[doing][visit] = None

    def leave(self, visit: Visit) -> None:
        """A connection is closed, or as good as that."""
        among = visit._among
        if among.visits[visit.doing].pop(visit, self) is None and not visit.reserved:
            self._count -= 1
            if not among.count:
                del self._addresses[among.name]

    def expire(self, now_s: float) -> bool:
        """End some that have not come further in time; whether there are more.

        A flood's connections come together, and would end together: 300 take 70 ms.
        """
        overdue = [each for each in self if each.deadline_s < now_s]
        for visit in overdue[:EXPIRING]:
            visit.deadline_s = math.inf  # unless it gets another one now
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
