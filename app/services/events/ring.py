"""Numbered events: one ring in memory for the whole service.

Each event is converted to text once, when it happens. A listener is only a position in the ring, so a slow
listener costs no memory and does not delay other listeners. If events are overwritten before a listener has
read them, the listener gets the event `lost`.

The ring may only be used on the event loop, not from threads.
"""

from __future__ import annotations

import json
import re
import secrets
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from app.services.events.pacing import Pacing
from cobot.clock import SYSTEM, Clock, utc_now
from cobot.errors import InputError
from cobot.ros.codec import without_nan
from cobot.strict import shown

TYPES = {
    "service": "the service has started or is shutting down",
    "rtloop": "the real-time process was restarted, does not publish, or publishes again",
    "mode": "the mode of a robot has changed",
    "fault": "the mode is FAULT: nothing moves until a reset",
    "estop": "an e-stop was requested, or is latched",
    "stop": "a client has stopped the arm",
    "reset": "a client has reset an e-stop or a fault",
    "intervention": "the safety layer has intervened",
    "lease": "control of the robot was taken or has ended",
    "motion": "a motion has begun or ended, or its goal has changed",
    "action": "an action on the path of a motion has fired, or has not",
    "session": "a streaming session has begun or ended",
    "sequence": "a sequence or program has started, is moving to its next waypoint, or has ended",
    "job": "a job has changed its state",
    "plan": "a plan was made, was approved for an agent, or its approval was withdrawn",
    "speed": "the speed override has changed",
    "time_factor": "the time factor of a simulation has changed",
    "scene": "the scene has changed",
    "tool": "the tool has changed",
    "gripper": "the gripper has grasped, released or lost an object",
    "cell_reset": "the simulated cell was reset to its initial state",
    "positions": "the named positions have changed",
    "program": "a stored program was saved or deleted",
    "planning": "a planning process was replaced",
    "refused": "the service has rejected a request that would have moved or changed something",
    "log": "a line of the service's log, of level warning or above",
}
"""All types of events, with their meaning."""
CAPACITY = 2000
"""Maximum number of events that are kept."""
CAPACITY_BYTES = 4 * 2**20
"""Maximum size of all kept events, in bytes."""
BURST, PER_S = 400, 40.0
"""Rate limit for events of one type and robot: the size of a burst, and the rate per second. It prevents a
client that calls /stop in a loop from pushing other events out of the ring. The next published event states
how many events were dropped.
"""
LOG_BURST, LOG_PER_S = 20, 2.0
"""Rate limit for events that client errors cause: log lines and rejected requests."""
SAID_OF_CLIENTS = ("log", "refused")
PLACE = re.compile(r"(?:([0-9a-f]{8})-)?([0-9]{1,20})")


@dataclass(frozen=True, slots=True)
class Event:
    """An event as it is sent.

    Attributes:
        number: consecutive number, starting at 1 each time the service starts; None for an event outside the
            ring.
        robot: robot name; "" for an event about all robots.
        text: the whole event as JSON.
    """

    number: int | None
    type: str
    robot: str
    text: str


class Throttle:
    """A rate limiter that admits a burst, and then a limited number of events per second."""

    def __init__(self, burst: int, per_s: float, now_s: Callable[[], float]) -> None:
        self._burst, self._per_s, self._now_s = burst, per_s, now_s
        self._left, self._seen_s = float(burst), now_s()
        self._held_back = 0

    def passes(self) -> int | None:
        """Decide whether to publish an event. Returns the number of events dropped since the last published
        one; None if this event must be dropped.
        """
        now_s = self._now_s()
        self._left = min(self._burst, self._left + (now_s - self._seen_s) * self._per_s)
        self._seen_s = now_s
        if self._left < 1.0:
            self._held_back += 1
            return None
        self._left -= 1.0
        held_back, self._held_back = self._held_back, 0
        return held_back


class Events:
    """The ring of events.

    Attributes:
        epoch: id of this run of the service. Together with the epoch, a number identifies an event
            permanently.
        newest: number of the newest event; 0 before the first event.
        on_news: function that is called after each event, and when the ring is closed.
        closed: whether the ring is closed.
        pacing: wakes the listeners.
        lost: total number of events that listeners have lost.
    """

    def __init__(self, clock: Clock = SYSTEM, capacity: int = CAPACITY) -> None:
        self.epoch = secrets.token_hex(4)
        self.newest = 0
        self.lost = 0
        self.closed = False
        self.pacing = Pacing()
        self.on_news: set[Callable[[], None]] = set()
        self._clock = clock
        self._capacity = capacity
        self._kept: deque[Event] = deque()
        self._bytes = 0
        self._throttles: dict[tuple[str, str], Throttle] = {}

    @property
    def oldest(self) -> int:
        """Number of the oldest kept event; if there is none, the number of the next event."""
        return self.newest + 1 - len(self._kept)

    def publish(self, kind: str, robot: str = "", /, **data: Any) -> None:
        """Publish an event.

        Args:
            kind: one of `TYPES`.
            robot: robot name; "" for an event about all robots.
            data: any JSON values; numbers that are not finite become null.
        """
        if kind not in TYPES:
            raise KeyError(kind)
        throttle = self._throttles.get((kind, robot))
        if throttle is None:
            bounds = (LOG_BURST, LOG_PER_S) if kind in SAID_OF_CLIENTS else (BURST, PER_S)
            throttle = self._throttles[kind, robot] = Throttle(*bounds, self._clock.now_s)
        held_back = throttle.passes()
        if held_back is None:
            return
        if held_back:
            data["held_back"] = held_back
        self.newest += 1
        text = self.rendered(kind, robot, data, self.newest)
        self._kept.append(Event(self.newest, kind, robot, text))
        self._bytes += len(text)
        while len(self._kept) > self._capacity or (self._bytes > CAPACITY_BYTES and len(self._kept) > 1):
            self._bytes -= len(self._kept.popleft().text)
        for tell in self.on_news:
            tell()

    def rendered(self, kind: str, robot: str, data: Mapping[str, Any], number: int | None = None) -> str:
        """Convert an event to JSON with the current time."""
        moment = utc_now(self._clock).isoformat(timespec="microseconds")
        content: dict[str, Any] = {} if number is None else {"id": number, "epoch": self.epoch}
        content |= {"time": moment, "robot": robot or None, "type": kind, "data": data}
        try:
            return json.dumps(content, allow_nan=False)
        except ValueError:
            return json.dumps(without_nan(content))

    def close(self) -> None:
        """Publish that the service is shutting down, and end all listeners."""
        if not self.closed:
            self.publish("service", what="ends")
            self.closed = True
            for tell in self.on_news:
                tell()

    def since(self, number: int, most: int) -> list[Event]:
        """Return the events after this number that are still kept, oldest first."""
        first = max(number + 1, self.oldest)
        offset = first - self.oldest
        return [self._kept[index] for index in range(offset, min(offset + most, len(self._kept)))]

    def place(self, after: str | None) -> tuple[int, bool]:
        """Return the number of the event after which a listener continues, and whether `after` is from an
        earlier run of the service.

        Args:
            after: "EPOCH-NUMBER" of an event, or a number from this run. None means that the listener gets
                only new events.

        Raises:
            InputError: `after` is in a different form, or the event has not happened yet.
        """
        if after is None:
            return self.newest, False
        found = PLACE.fullmatch(after)
        if found is None:
            raise InputError(f"after: {shown(after)} is neither EPOCH-NUMBER nor a number")
        epoch, digits = found.groups()
        if epoch and epoch != self.epoch:
            return 0, True
        if int(digits) > self.newest:
            raise InputError(f"after: {digits} has not happened yet; the newest event is {self.newest}")
        return int(digits), False

    def of(self, robot: str) -> RobotEvents:
        """Return the publisher for one robot."""
        return RobotEvents(self, robot)


@dataclass(frozen=True, slots=True)
class RobotEvents:
    """Publishes the events of one robot."""

    ring: Events
    robot: str

    def publish(self, kind: str, /, **data: Any) -> None:
        """See `Events.publish`."""
        self.ring.publish(kind, self.robot, **data)
