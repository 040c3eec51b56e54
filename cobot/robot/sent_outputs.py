"""Values that were sent to the outputs of a device and that the device has not reported yet.

With them, cobot notices a value that takes effect late, for example after a lost connection.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from cobot.robot.io_points import ANALOG_SHARE


@dataclass(slots=True, eq=False)
class SentOutput:
    """A value that was sent to an output.

    Attributes:
        is_late: whether cobot has reported that the device did not confirm the value in time.
    """

    value: float
    sent_s: float
    is_late: bool = False


class SentOutputs:
    """The newest value that was sent to each output, until the device reports it."""

    def __init__(self, timeout_s: float) -> None:
        """
        Args:
            timeout_s: time within which the device must report a value, s.
        """
        self._timeout_s = timeout_s
        self._sent: dict[str, SentOutput] = {}

    def __bool__(self) -> bool:
        return bool(self._sent)

    def add(self, name: str, value: float, now_s: float) -> SentOutput:
        """Store a value that is sent now. It replaces an earlier value of the same output."""
        self._sent[name] = sent = SentOutput(value, now_s)
        return sent

    def is_newest(self, name: str, sent: SentOutput) -> bool:
        """Whether no newer value was sent to the output."""
        return self._sent.get(name) is sent

    def drop(self, name: str, sent: SentOutput) -> None:
        """Forget a value that the device has rejected, unless a newer one was sent."""
        if self.is_newest(name, sent):
            del self._sent[name]

    def is_overdue(self, name: str, now_s: float) -> bool:
        """Whether the device has not reported the value of this output in time."""
        sent = self._sent.get(name)
        return sent is not None and (sent.is_late or now_s - sent.sent_s > self._timeout_s)

    def explain(self, reported: Mapping[str, float], now_s: float) -> str:
        """Compare the sent values with those that the device reports now.

        Returns a sentence about a value that the device has not reported in time, or has reported late; "" if
        there is nothing new.
        """
        problem = ""
        for name, sent in list(self._sent.items()):
            after_s = now_s - sent.sent_s
            in_time = not self.is_overdue(name, now_s)
            here = reported.get(name, math.nan)
            if math.isclose(here, sent.value, rel_tol=ANALOG_SHARE, abs_tol=ANALOG_SHARE):
                del self._sent[name]
                if not in_time:
                    problem = (
                        f"{name} is {sent.value:g} now, {after_s:.1f} s after the request: the device "
                        "has set the output late, or another client has set it"
                    )
            elif not in_time and not sent.is_late:
                sent.is_late = True
                problem = (
                    f"{name} is not confirmed: the device has not reported {sent.value:g} within "
                    f"{self._timeout_s:g} s, and may still set this value"
                )
        return problem
