"""An arm of somebody's own that moves something real, as far as cobot knows: its drives go off."""

from __future__ import annotations

from types import MappingProxyType

from own_arm import Arm

from cobot.config import Settings
from cobot.robot.device import Capabilities
from cobot.types import Array, JointLimits
from rtloop.backends import BackendError


class HardwareArm(Arm):
    """Attributes:
    drives_on: as the device has them.
    refuses: why it does not switch them off, "" if it does.
    """

    capabilities = Capabilities(
        stops=MappingProxyType({1: True, 2: False}),
        hardware=True,
        measured=frozenset({"position", "velocity"}),
    )

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        super().__init__(settings, limits)
        self.drives_on = False
        self.refuses = ""
        self.limits: JointLimits | None = None

    def enable(self) -> None:
        super().enable()
        self.drives_on = True

    def write(self, command: Array) -> None:
        if not self.drives_on:
            raise BackendError("the drives are off")
        super().write(command)

    def disable(self) -> None:
        super().disable()
        if self.refuses:
            raise BackendError(self.refuses)
        self.drives_on = False
