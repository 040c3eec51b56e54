"""A backend beside its device, both in one process: what the contract drives, and breaks."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

import numpy as np

from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.types import Array, JointLimits
from rtloop.backends import Backend, BackendError, Measured, TrajectoryDevice, capabilities_of
from rtloop.backends.guarded import NAMES

FAULTS = {
    "disconnect": "nothing comes any more, and nothing arrives",
    "frozen": "the same values come again and again",
    "nan": "a measured value is not a number",
    "loss": "some packets are lost, about one in twenty",
    "reorder": "some packets are overtaken by the next",
    "pile_up": "some packets are read together with the next ones, as on a busy computer",
    "e_stop": "somebody presses the emergency stop of the device",
    "protective_stop": "the device stops by itself",
    "operation_mode": "somebody turns the key to another operation mode",
}
"""What may happen to a device."""


class ContractRig(Protocol):
    """What a backend's class gives as `contract_rig(settings, limits)`, a static method or class method.

    It may also have `wire`, a list of the positions that the device has been sent, shape (dof,) each, rad:
    then the limits are checked there too.

    Attributes:
        faults: those of `FAULTS` that this device can have; the others are reported as not tested.
    """

    faults: frozenset[str]

    def backend(self) -> Backend | TrajectoryDevice:
        """A new one for the same device, not open yet; the last one is closed, or its process was killed."""
        ...

    def inject(self, fault: str) -> None:
        """Have it happen now, and last until it is cleared."""
        ...

    def clear(self, fault: str) -> None:
        """Its cause is gone, and a person has done at the device what has to be done there."""
        ...


class PlainRig:
    """For a backend without one of its own that moves nothing real: faults between it and the cycle."""

    faults = frozenset({"disconnect", "frozen", "nan"})

    def __init__(self, kind: Callable[..., Backend], settings: Settings, limits: JointLimits) -> None:
        self._kind, self._settings, self._limits = kind, settings, limits
        self._active: set[str] = set()

    def backend(self) -> Backend:
        return Broken(self._kind(self._settings, self._limits), self._active)

    def inject(self, fault: str) -> None:
        self._active.add(fault)

    def clear(self, fault: str) -> None:
        self._active.discard(fault)


OPTIONAL = {"capabilities", "state_period_s", "point_period_s"} | {
    name for name in NAMES if not hasattr(Backend, name)
}
"""What only some backends have, beside the six methods."""


class Around:
    """A backend around another one, or a device that takes whole motions around one: it has what that one
    has, and passes it on.
    """

    def __init__(self, inner: Backend) -> None:
        self.inner = inner
        for name in sorted(OPTIONAL):
            if hasattr(inner, name):
                setattr(self, name, getattr(inner, name))

    def open(self, initial_position: Array) -> None:
        self.inner.open(initial_position)

    def enable(self) -> None:
        self.inner.enable()

    def read(self, measured: Measured) -> None:
        self.inner.read(measured)

    def write(self, command: Array) -> None:
        self.inner.write(command)

    def disable(self) -> None:
        self.inner.disable()

    def close(self) -> None:
        self.inner.close()


class Broken(Around):
    """A backend with faults: what it says gets lost on its way, or is spoiled."""

    def __init__(self, inner: Backend, active: set[str]) -> None:
        super().__init__(inner)
        self._active = active
        self._last: Array | None = None
        if isinstance(inner, TrajectoryDevice):
            self.state = partial(self._spoil, inner.state)

    def enable(self) -> None:
        self._require_connection()
        super().enable()

    def read(self, measured: Measured) -> None:
        self._spoil(super().read, measured)

    def write(self, command: Array) -> None:
        self._require_connection()
        super().write(command)

    def _spoil(self, fill_in: Callable[[Measured], None], measured: Measured) -> None:
        self._require_connection()
        fill_in(measured)
        if "frozen" not in self._active or self._last is None:
            self._last = measured.values.copy()
        np.copyto(measured.values, self._last)
        if "nan" in self._active:
            measured.position[0] = np.nan

    def _require_connection(self) -> None:
        if "disconnect" in self._active:
            raise BackendError("the connection has been cut by the contract")


def rig_of(kind: Any, settings: Settings, limits: JointLimits) -> ContractRig:
    """The backend's own, or one that spoils what it says.

    Raises:
        ConfigError: it would move something real, or has no rig that can be used.
    """
    name = settings.robot.backend.type
    hook = getattr(kind, "contract_rig", None)
    if hook is None:
        if capabilities_of(kind).hardware:
            raise ConfigError(
                f"robot.backend: {name} moves something real, and its class has no contract_rig(settings, "
                "limits) that gives a simulated device: the contract is not run on a robot"
            )
        return PlainRig(kind, settings, limits)
    rig: ContractRig = hook(settings, limits)
    strange = sorted(set(rig.faults) - set(FAULTS))
    if strange:
        raise ConfigError(
            f"robot.backend: {name}: contract_rig: there is no fault {strange[0]!r}; valid are: "
            f"{', '.join(FAULTS)}"
        )
    return rig


def wire_of(rig: ContractRig) -> list[Array] | None:
    """What has been sent to the device, if the rig says."""
    wire = getattr(rig, "wire", None)
    return wire if isinstance(wire, list) else None
