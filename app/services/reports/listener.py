"""A listener: its position in the ring of events, its subscription, and the newest state at its own rate."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

from app.services.events.ring import Event, Events
from app.services.reports.states import StateTexts

KEEP_ALIVE_S = 5.0
"""Interval between keep-alive messages while there are no events, s. A client that does not receive them can
conclude that its connection is lost.
"""
BATCH = 64
"""Maximum number of events that are sent to a listener before the others have their turn."""


@dataclass(frozen=True, slots=True)
class EventFilter:
    """The subscription of a listener.

    Attributes:
        types: types of events; None for all.
        robots: names of the robots whose events are sent; None for all.
    """

    types: Collection[str] | None = None
    robots: Collection[str] | None = None

    def __contains__(self, event: Event) -> bool:
        if self.types is not None and event.type not in self.types:
            return False
        return self.robots is None or not event.robot or event.robot in self.robots


class Listener:
    """A listening client. Events are read from the ring only when they can be sent, so a slow client delays
    no others.

    Args:
        after: see `Events.place`.
        states: names of the robots whose newest states are sent at `state_hz`.

    Attributes:
        epoch: epoch of its events.

    Raises:
        InputError: see `Events.place`.
    """

    def __init__(
        self,
        events: Events,
        wanted: EventFilter,
        after: str | None = None,
        states: Sequence[StateTexts] = (),
        state_hz: float = 1.0,
    ) -> None:
        self._events = events
        self.epoch = events.epoch
        self._wanted = wanted
        self._place, restarted = events.place(after)
        self._first = [self._event("hello", {"oldest": events.oldest, "newest": events.newest})]
        if restarted:
            self._first.append(self._event("lost", {"why": "restarted", "count": None}))
        self._states = states
        self._period_s = 1.0 / state_hz if states else KEEP_ALIVE_S
        self._wake = asyncio.Event()
        self._due = self._closed = False
        self._loop = asyncio.get_running_loop()
        self._tick_s = self._loop.time() + self._period_s
        self._timer = self._loop.call_at(self._tick_s, self._tick)
        events.on_news.add(self._call)

    def close(self) -> None:
        """Close the listener. A waiting `next` then returns."""
        self._closed = True
        self._timer.cancel()
        self._events.on_news.discard(self._call)
        self._events.pacing.forget(self._wake)
        self._wake.set()

    async def next(self) -> list[Event]:
        """Wait for the next messages, and return them; empty if the listener is closed."""
        while not self._closed:
            self._wake.clear()
            found = [*self._take_first(), *self._take_events(), *self._take_tick()]
            if found:
                return found
            if self._events.closed:
                break
            await self._wake.wait()
        return []

    def _call(self) -> None:
        self._events.pacing.wake(self._wake, self._loop)

    def _take_first(self) -> list[Event]:
        first, self._first = self._first, []
        return first

    def _take_events(self) -> Iterator[Event]:
        events = self._events
        while self._place < events.newest:
            if (forgotten := events.oldest - 1 - self._place) > 0:
                first, self._place = self._place + 1, events.oldest - 1
                events.lost += forgotten
                yield self._event(
                    "lost", {"why": "slow", "count": forgotten, "first": first, "last": self._place}
                )
            batch = events.since(self._place, BATCH)
            self._place += len(batch)
            wanted = [each for each in batch if each in self._wanted]
            if wanted:
                yield from wanted
                self._call()  # there may be more events
                return

    def _take_tick(self) -> Iterator[Event]:
        if not self._due:
            return
        self._due = False
        for state in self._states:
            yield Event(None, "state", state.robot, state.text())
        if not self._states:
            yield self._event("alive", {})

    def _tick(self) -> None:
        """Mark states as due. Ticks stay on the time grid of the rate, unless the event loop is late by a
        whole period.
        """
        self._due = True
        self._call()
        self._tick_s = max(self._tick_s + self._period_s, self._loop.time())
        self._timer = self._loop.call_at(self._tick_s, self._tick)

    def _event(self, kind: str, data: dict[str, object]) -> Event:
        """Create an event whose number is the listener's position."""
        return Event(self._place, kind, "", self._events.rendered(kind, "", data, self._place))
