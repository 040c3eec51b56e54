"""The cabinet's evaluation of its connection: a quality, calculated from missing and late answers."""

from __future__ import annotations

from collections import deque

from rtloop.backends.beat import ahead
from rtloop.backends.fri.messages import Quality

WINDOW = 100
"""Number of latest answers from which the quality is calculated."""
MIN_PACKETS = 10
"""Minimum number of packets for a quality better than POOR."""
LATE = 0.5
"""Weight of an answer that is one period late. An answer on time has the weight 1."""
EXCELLENT, GOOD, FAIR = 0.95, 0.75, 0.5
"""Minimum mean weight of the answers for each quality."""
CLOSE_AFTER_MS = 100
MIN_CLOSE_AFTER = 10
"""Minimum number of consecutive missing answers before a session is closed."""
_COUNTER = 1 << 32


class ClientConnection:
    """
    Attributes:
        reflected: number of the cabinet's newest message that was answered.
        newest: number of the client's newest message.
        silent: number of consecutive missing answers.
        late, missing, answered: numbers of late, missing and received answers since the beginning.
    """

    def __init__(self, period_ms: int, multiplier: int) -> None:
        self._period_ms, self._multiplier = period_ms, multiplier
        self._close_after = max(MIN_CLOSE_AFTER, CLOSE_AFTER_MS // (period_ms * multiplier))
        self.late = self.missing = self.answered = 0
        self.forget(0)

    def forget(self, sequence: int) -> None:
        """Begin a session whose first message has this number, and forget the previous client."""
        self._worth: deque[float] = deque(maxlen=WINDOW)
        self._since = 0
        self.silent = 0
        self.reflected = (sequence - 1) % _COUNTER
        self.newest: int | None = None

    def take_answer(self, sequence: int, reflected: int, now: int) -> bool:
        """Process an answer. Return False if it is older than the last one.

        now: number of the last message that was sent.
        """
        if self.newest is not None and ahead(sequence, self.newest) <= 0:
            return False
        if not 0 <= ahead(now, reflected) < WINDOW or ahead(reflected, self.reflected) <= 0:
            return False
        self.newest, self.reflected = sequence, reflected
        self.silent = 0
        if ahead(now, reflected) >= self._multiplier and self._worth and self._worth[-1] == 0.0:
            if ahead(now, reflected) < 2 * self._multiplier:
                self._worth[-1] = LATE
            self.late += 1
        return True

    def judge(self, now: int) -> None:
        """End the period that began with the message `now`."""
        self._since += 1
        if self._since < self._multiplier:
            return
        self._since = 0
        if 0 <= ahead(now, self.reflected) < self._multiplier:
            self._worth.append(1.0)
            self.silent = 0
            self.answered += 1
        else:
            self._worth.append(0.0)
            self.silent += 1
            self.missing += 1

    @property
    def quality(self) -> Quality:
        if len(self._worth) < MIN_PACKETS:
            return Quality.POOR
        mean = sum(self._worth) / len(self._worth)
        if mean >= EXCELLENT:
            return Quality.EXCELLENT
        if mean >= GOOD:
            return Quality.GOOD
        return Quality.FAIR if mean >= FAIR else Quality.POOR

    @property
    def lost(self) -> bool:
        """Whether enough answers are missing to end the session."""
        return self.silent >= self._close_after
