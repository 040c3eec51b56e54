"""A device with packets that takes its time to recover and to be enabled, and counts what it was answered."""

from __future__ import annotations

from paced_arm import PacedArm

from cobot.config import Settings
from cobot.types import Array, JointLimits
from rtloop.backends import BackendError

STEPS = 30


class StepwiseArm(PacedArm):
    """Attributes:
    refuses: why it cannot be enabled, "" if it can.
    steps: the calls of steps, in turn, each with the number of packets that were answered before it.
    enabled: whether it is.
    """

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        super().__init__(settings, limits)
        self.refuses = ""
        self.steps: list[tuple[str, int]] = []
        self.enabled = False
        self._left = 0

    def enable(self) -> None:
        self.enabled = True

    def write(self, command: Array) -> None:
        if self.enabled:
            super().write(command)
        else:
            self.written.append(command[0].copy())

    def recover_step(self) -> bool:
        return self._step("recover")

    def enable_step(self) -> bool:
        if self.refuses:
            raise BackendError(self.refuses)
        self.enabled = self._step("enable")
        return self.enabled

    def _step(self, what: str) -> bool:
        if self._left == 0:
            self._left = STEPS
        self.steps.append((what, len(self.written)))
        self._left -= 1
        return self._left == 0
