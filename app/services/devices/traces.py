"""Messages from programs, clients and the service to people. Only the newest are kept."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum

CAPACITY = 1000
MAX_CHARACTERS = 10_000

log = logging.getLogger("cobot.trace")


class Level(StrEnum):
    """Severity of a message. The values are the names that clients see."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"
    FATAL = "fatal"


_LOGGED = {
    Level.INFO: logging.INFO,
    Level.WARNING: logging.WARNING,
    Level.ERROR: logging.ERROR,
    Level.FATAL: logging.CRITICAL,
}


@dataclass(frozen=True, slots=True)
class Message:
    """A message to people.

    Attributes:
        number: consecutive number, from 1.
        kind: how the message is shown: text, alarm, popup or notify.
        code: code of the alarm; 0 for none.
    """

    number: int
    time: datetime
    kind: str
    level: Level
    code: int
    title: str
    text: str


class Traces:
    """Keeps the newest messages, writes each message to the service's log and passes it to the listeners."""

    def __init__(self) -> None:
        self._messages: deque[Message] = deque(maxlen=CAPACITY)
        self._count = 0
        self.listeners: list[Callable[[Message], None]] = []

    def add(
        self, kind: str, text: str, level: Level = Level.INFO, *, code: int = 0, title: str = ""
    ) -> Message:
        """Keep a message. Text beyond `MAX_CHARACTERS` is cut off."""
        self._count += 1
        message = Message(
            number=self._count,
            time=datetime.now(UTC),
            kind=kind,
            level=level,
            code=code,
            title=title[:MAX_CHARACTERS],
            text=text[:MAX_CHARACTERS],
        )
        self._messages.append(message)
        log.log(_LOGGED[level], "%s%s", f"{message.title}: " if message.title else "", message.text)
        for listener in tuple(self.listeners):
            listener(message)
        return message

    def warn(self, text: str) -> None:
        """Add a warning from the service itself."""
        self.add("text", text, Level.WARNING)

    def newest(self, count: int, after: int = 0) -> list[Message]:
        """Return the newest messages, in order of time.

        Args:
            count: maximum number of messages.
            after: return only messages with a larger number.
        """
        found = [message for message in self._messages if message.number > after]
        return found[-count:] if count else []
