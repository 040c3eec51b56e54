"""Backends: simulations and real robots, all with the same small interface."""

from __future__ import annotations

from cobot.robot import mujoco_library as mujoco_library
from cobot.robot.device import Capabilities, DeviceStatus
from rtloop.backends.compiled import Measured
from rtloop.backends.protocols import (
    Backend,
    BackendError,
    BackendOptions,
    CarriesTool,
    GuidedByHand,
    HasCell,
    HasIo,
    Impedance,
    ImpedanceControlled,
    MovesByItself,
    Paced,
    Reporting,
    Simulated,
    Stepwise,
    SwitchesOffLater,
    TorqueControlled,
    TrajectoryDevice,
    WrenchControlled,
    capabilities_of,
)
from rtloop.backends.registry import backend_class, backend_names, make_backend

__all__ = [
    "Backend",
    "BackendError",
    "BackendOptions",
    "Capabilities",
    "CarriesTool",
    "DeviceStatus",
    "GuidedByHand",
    "HasCell",
    "HasIo",
    "Impedance",
    "ImpedanceControlled",
    "Measured",
    "MovesByItself",
    "Paced",
    "Reporting",
    "Simulated",
    "Stepwise",
    "SwitchesOffLater",
    "TorqueControlled",
    "TrajectoryDevice",
    "WrenchControlled",
    "backend_class",
    "backend_names",
    "capabilities_of",
    "make_backend",
]
