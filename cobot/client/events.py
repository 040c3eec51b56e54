"""Events of the service, read as server-sent events; see docs/events.md."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import httpx2

from cobot.client.connection import Connection, Json
from cobot.errors import UnavailableError

SILENT_S = 20.0
"""Time without data after which the connection is considered lost, in seconds. The service sends data every 5
s.
"""
FIRST_PAUSE_S, MAX_PAUSE_S = 0.2, 2.0
UNTOLD = ("hello", "alive")


def blocks(lines: Iterator[str]) -> Iterator[dict[str, str]]:
    """Parse a text/event-stream. Yields the fields of each block; several lines of `data` are joined."""
    fields: dict[str, str] = {}
    for line in lines:
        name, _, value = line.partition(":")
        value = value.removeprefix(" ")
        if not line:
            if fields:
                yield fields
            fields = {}
        elif name == "data" and "data" in fields:
            fields["data"] += f"\n{value}"
        elif name:
            fields[name] = value


class EventReader:
    """Reads one stream after another. Each stream continues after the last event of the previous one.

    Args:
        stream: opens a stream with these headers; raises the service's error if the service rejects the
            request.
        patience_s: maximum time for which the service may be unreachable.
    """

    def __init__(
        self,
        stream: Callable[[Mapping[str, str]], Any],
        patience_s: float,
        now_s: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._stream = stream
        self._patience_s = patience_s
        self._now_s, self._sleep = now_s, sleep
        self._last_id = ""
        self._heard_s: float | None = None

    def events(self) -> Iterator[Json]:
        """Yield events indefinitely.

        Raises:
            UnavailableError: the service is unreachable at the start, or for longer than `patience_s`.
            CobotError: the service rejects the request.
        """
        pause_s = FIRST_PAUSE_S
        while True:
            before_s = self._heard_s
            try:
                yield from self._one_stream()
                problem = "the stream has ended"
            except (UnavailableError, httpx2.HTTPError) as exc:
                problem = str(exc) or type(exc).__name__
            if self._heard_s != before_s:
                pause_s = FIRST_PAUSE_S
            if self._heard_s is None:
                raise UnavailableError(problem)
            if self._now_s() - self._heard_s > self._patience_s:
                raise UnavailableError(f"no event for {self._patience_s:g} s: {problem}")
            self._sleep(pause_s)
            pause_s = min(2.0 * pause_s, MAX_PAUSE_S)

    def _one_stream(self) -> Iterator[Json]:
        headers = {"Last-Event-ID": self._last_id} if self._last_id else {}
        with self._stream(headers) as response:
            for fields in blocks(response.iter_lines()):
                self._heard_s = self._now_s()
                if "data" in fields and fields.get("event") not in UNTOLD:
                    yield json.loads(fields["data"])
                # Store the id only now, because a caller that leaves the loop at this event has not processed
                # it.
                self._last_id = fields.get("id", self._last_id)


class EventConnection(Connection):
    """A connection that can receive events."""

    def events(
        self,
        types: Sequence[str] = (),
        *,
        robot: str | None = None,
        state_hz: float | None = None,
        after: str | None = None,
        patience_s: float = 60.0,
    ) -> Iterator[Json]:
        """Yield events as they happen: dicts with `id`, `epoch`, `time`, `robot`, `type`, `data`. The
        iterator never ends on its own. A lost connection is reopened and continues after the last event.

        Args:
            types: types of events; all types if none is given. With `state_hz`, states are always included.
            robot: yield only events of this robot. This is for a client that is connected to all robots.
            state_hz: rate of states, 0.1 to 100 per second.
            after: "EPOCH-ID" of an earlier event, "0" for all stored events; without it, only new events.
            patience_s: how long a lost connection is retried before UnavailableError is raised.
        """
        asked: Json = {"robot": robot, "state_hz": state_hz, "after": after}
        if types:
            asked["types"] = ",".join(types)
        params = {name: value for name, value in asked.items() if value is not None}
        timeout = httpx2.Timeout(self._http.timeout.connect, read=SILENT_S)

        def stream(headers: Mapping[str, str]) -> Any:
            return self._stream("/events", params=params, headers=headers, timeout=timeout)

        return EventReader(stream, patience_s).events()
