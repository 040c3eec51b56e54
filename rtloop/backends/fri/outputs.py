"""Outputs to set on the cabinet. They are sent with the answers until the controller reports the new
values.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from cobot.robot.io_points import IoKind, IoPoint
from rtloop.backends import BackendError
from rtloop.backends.beat import ahead
from rtloop.backends.fri.messages import MAX_NAME, IoDirection, IoType, IoValue, MonitoringMessage

SENT_S = 1.0
"""Maximum time for which an output value is sent repeatedly until the controller reports it, s. It is
repeated because packets may be lost.
"""
UNFIT = "/\ufffd"
"""Characters that cannot be in a public name. The second one replaces bytes that are not UTF-8."""
KINDS = {IoType.BOOLEAN: IoKind.BOOLEAN, IoType.DIGITAL: IoKind.DIGITAL, IoType.ANALOG: IoKind.ANALOG}


def point_of(value: IoValue, name: str = "") -> IoPoint:
    """Convert an input or output of the controller to a cobot point.

    Args:
        name: public name. By default, the name in `value` is used.
    """
    is_output = value.direction == IoDirection.OUTPUT
    return IoPoint(name or value.name, KINDS[value.type], is_output, float(value.value))


def points(message: MonitoringMessage) -> list[IoPoint]:
    """List the inputs and outputs that the cabinet's program has registered."""
    return [point_of(each, name) for name, each in _by_name(message).items()]


def _by_name(message: MonitoringMessage) -> dict[str, IoValue]:
    """Map public names, which can be printed and used in URLs, to inputs and outputs.

    Slashes and unprintable characters become underscores. A number is appended to a name that is already
    taken.
    """
    found: dict[str, IoValue] = {}
    for each in message.io:
        name = plain = "".join(c if c.isprintable() and c not in UNFIT else "_" for c in each.name) or "_"
        number = 1
        while name in found:
            number += 1
            suffix = f"_{number}"
            name = plain.encode()[: MAX_NAME - len(suffix)].decode(errors="ignore") + suffix
        found[name] = each
    return found


@dataclass(slots=True)
class _Wanted:
    """An output that is being set.

    Attributes:
        first: number of the first answer that contains the output; None if it has not been sent.
        left: number of further answers that will contain the output.
    """

    value: IoValue
    left: int
    first: int | None = None


class Outputs:
    """The outputs that must be set. Real-time safe. Takes almost no time if there are no outputs to set."""

    def __init__(self, period_s: float) -> None:
        self._answers = round(SENT_S / period_s)
        self._wanted: dict[str, _Wanted] = {}

    def set(self, message: MonitoringMessage, name: str, value: float) -> None:
        """Set an output, beginning with the next answer.

        Raises:
            BackendError: the name is not one of the outputs in the message.
        """
        output = _by_name(message).get(name)
        if output is None or output.direction != IoDirection.OUTPUT:
            raise BackendError(f"{name} is not an output that the controller's program has registered")
        number = value if output.type == IoType.ANALOG else int(value)
        self._wanted[output.name] = _Wanted(replace(output, value=number), self._answers)

    def values_in_answer(self, message: MonitoringMessage, number: int) -> list[IoValue]:
        """Return the outputs to send in the answer with this number."""
        if not self._wanted:
            return []
        reported = {each.name: each.value for each in message.io}
        for name, wanted in list(self._wanted.items()):
            seen = wanted.first is not None and ahead(message.header.reflected, wanted.first) >= 0
            if wanted.left == 0 or (seen and reported.get(name) == wanted.value.value):
                del self._wanted[name]
                continue
            wanted.left -= 1
            if wanted.first is None:
                wanted.first = number
        return [each.value for each in self._wanted.values()]
