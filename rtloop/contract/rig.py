"""Test rigs: a backend and its device in one process. The contract checks drive the backend and inject
faults.
"""

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
    "disconnect": "nothing arrives in either direction",
    "frozen": "the device repeats the same values",
    "nan": "a measured value is not a number",
    "loss": "some packets are lost, about one in twenty",
    "reorder": "some packets arrive after their successor",
    "pile_up": "some packets are read together with the next ones, as on a busy computer",
    "e_stop": "the emergency stop of the device is pressed",
    "protective_stop": "the device stops by itself",
    "operation_mode": "the key switch selects another operation mode",
}
"""The faults that a rig can inject, with a description of each."""


class ContractRig(Protocol):
    """A test rig. The static or class method `contract_rig(settings, limits)` of a backend's class makes one.

    A rig may also have an attribute `wire`: a list of the positions sent to the device, each of shape (dof,),
    rad. The contract then also checks these positions against the limits. If a rig adds options that the
    backend requires, such as an address, its attribute `settings` contains the complete settings of the
    backend.

    Attributes:
        faults: the entries of `FAULTS` that this rig can inject. The others are reported as not tested.
    """

    faults: frozenset[str]

    def backend(self) -> Backend | TrajectoryDevice:
        """Create a new backend for the same device, without opening it. The previous backend was closed,
        or its process was killed.
        """
        ...

    def inject(self, fault: str) -> None:
        """Begin a fault, which lasts until `clear`."""
        ...

    def clear(self, fault: str) -> None:
        """Remove the cause of a fault, as a person at the device would."""
        ...


class PlainRig:
    """A rig for simulations that have no rig of their own. It injects faults between the backend and the
    cycle.
    """

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
"""Names of the optional methods and attributes of a backend, in addition to the six methods of `Backend`."""


class Around:
    """A wrapper around a backend or a `TrajectoryDevice`. It has the same methods and attributes, and
    forwards all calls.
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
    """A wrapper around a backend that loses or corrupts the values on their way to the cycle."""

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
            raise BackendError("the contract test has interrupted the connection")


def rig_of(kind: Any, settings: Settings, limits: JointLimits) -> ContractRig:
    """Return the backend's own rig, or else a `PlainRig`.

    Raises:
        ConfigError: the backend would move a real arm, or its rig is invalid.
    """
    name = settings.robot.backend.type
    hook = getattr(kind, "contract_rig", None)
    if hook is None:
        if capabilities_of(kind).hardware:
            raise ConfigError(
                f"robot.backend: {name} moves a real arm, but its class has no contract_rig(settings, "
                "limits) that returns a simulated device; the contract does not run on a real robot"
            )
        return PlainRig(kind, settings, limits)
    rig: ContractRig = hook(settings, limits)
    strange = sorted(set(rig.faults) - set(FAULTS))
    if strange:
        raise ConfigError(
            f"robot.backend: {name}: contract_rig lists the unknown fault {strange[0]!r}; valid names: "
            f"{', '.join(FAULTS)}"
        )
    return rig


def wire_of(rig: ContractRig) -> list[Array] | None:
    """Return the positions sent to the device; None if the rig does not record them."""
    wire = getattr(rig, "wire", None)
    return wire if isinstance(wire, list) else None
