"""Messages that wait for the single connection to the service. Topics and services take turns to send.

A topic whose publishers are faster than the connection loses only its own messages. It delays the other
topics by at most one message at a time. It also leaves space for them, because no sender may occupy more than
a share of the free space.

Source: A. K. Choudhury and E. L. Hahne, Dynamic queue length thresholds for shared-memory packet switches,
IEEE/ACM Transactions on Networking 6 (2), 1998.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

MAX_MESSAGES = 20_000
"""Maximum number of waiting messages from one sender."""
MAX_CHARACTERS = 128 << 20
"""Maximum length of all waiting messages together, in characters."""
SHARE = 0.25
"""Share of the free space that one sender may occupy. Even if twenty senders are at this limit, a hundredth
of the space, 1.5 MB, stays free.
"""


@dataclass(slots=True)
class _Queue:
    texts: deque[str] = field(default_factory=deque)
    characters: int = 0


class Outgoing:
    """Queues of messages, one for each sender."""

    def __init__(self) -> None:
        self._queues: dict[str, _Queue] = {}
        self._turns: deque[str] = deque()
        self._characters = 0

    def put(self, sender: str, text: str) -> bool:
        """Queue a message. Returns whether there was enough space."""
        queue = self._queues.get(sender, _Queue())
        free = MAX_CHARACTERS - self._characters
        if len(queue.texts) >= MAX_MESSAGES or queue.characters + len(text) > SHARE * free:
            return False
        if sender not in self._queues:
            self._queues[sender] = queue
            self._turns.append(sender)
        queue.texts.append(text)
        queue.characters += len(text)
        self._characters += len(text)
        return True

    def next(self) -> str | None:
        """Take the next message that must be sent; None if the queue is empty."""
        if not self._turns:
            return None
        sender = self._turns.popleft()
        queue = self._queues[sender]
        text = queue.texts.popleft()
        queue.characters -= len(text)
        self._characters -= len(text)
        if queue.texts:
            self._turns.append(sender)
        else:
            del self._queues[sender]
        return text

    def clear(self) -> None:
        self._queues.clear()
        self._turns.clear()
        self._characters = 0
