"""Inputs and outputs of a device that executes whole motions. The thread that polls the device also transfers
their values.
"""

from __future__ import annotations

import logging

from cobot.foreign import plain_text
from cobot.robot.io_points import IoPoint, io_points
from rtloop.backends.protocols import HasIo
from rtloop.backends.queued_outputs import QueuedOutputs

log = logging.getLogger("cobot.rtloop")


class DrivenIo:
    """Inputs and outputs as in `HasIo`. They never delay a cycle."""

    def __init__(self, device: HasIo) -> None:
        self._device = device
        self._points: tuple[IoPoint, ...] = ()
        self._queue = QueuedOutputs()
        self._problem = ""

    def io(self) -> tuple[IoPoint, ...]:
        return self._points

    def set_output(self, name: str, value: float) -> None:
        self._queue.add(name, value)

    def ask(self) -> None:
        """Run one iteration of the thread. If the device rejects an output or reports no inputs and outputs,
        the reason is logged.
        """
        try:
            for name, value in self._queue.take():
                self._device.set_output(name, value)
            self._points = io_points(self._device.io())
            self._problem = ""
        except KeyboardInterrupt:
            raise
        except BaseException as exc:  # noqa: BLE001 - a foreign class may raise anything
            problem = plain_text(exc)
            if problem != self._problem:  # the device is polled several times a second
                log.warning("inputs and outputs of the device: %s", problem)
            self._problem = problem
