"""The available backends: cobot's own, and those that installed packages declare."""

from __future__ import annotations

from collections.abc import Callable

from cobot.cell import cell_of
from cobot.config import Settings
from cobot.entry_points import Registry
from cobot.errors import ConfigError
from cobot.types import JointLimits
from rtloop.backends.protocols import Backend, BackendError, BackendOptions, NoOptions, capabilities_of
from rtloop.backends.trajectory_driver import as_backend

REGISTRY = Registry(
    "cobot.backends",
    "robot.backend",
    {
        "fanuc": "rtloop.backends.fanuc:FanucBackend",
        "franka": "rtloop.backends.franka:FrankaBackend",
        "mujoco": "rtloop.backends.mujoco:MujocoBackend",
        "fri": "rtloop.backends.fri:FriBackend",
        "rsi": "rtloop.backends.rsi:RsiBackend",
        "ros2_control": "rtloop.backends.ros2_control:Ros2ControlArm",
        "ur": "rtloop.backends.ur:UrBackend",
        "ros2_control_stream": "rtloop.backends.ros2_control:Ros2ControlStream",
    },
)
WITH_CELL = {"mujoco": "rtloop.backends.cell:CellBackend"}
"""Backends that simulate a cell themselves, by the name of the corresponding backend without a cell."""
AROUND = "rtloop.backends.device_in_cell:DeviceInCell"
"""The class that simulates a cell around the arm of any other backend."""
NOT_HERE = (
    "but robot.backend.simulator is true: a simulator must be on this computer, because there may be a real "
    "arm at another address, and its hand would only be simulated. Correct this setting; for a real "
    "arm, remove robot.backend.simulator"
)


def backend_names() -> dict[str, str]:
    """Return the valid names for `robot.backend`, each with the location of its class."""
    return REGISTRY.names()


def backend_class(name: str) -> Callable[..., Backend]:
    """Return the class for a backend's name, or for a location written as "package.module:Class".

    Raises:
        ConfigError: the class does not exist; the error lists the valid names.
    """
    return REGISTRY.load(name)


def make_backend(settings: Settings, limits: JointLimits) -> Backend:
    """Create the backend that the setting `robot.backend` names.

    Raises:
        ConfigError: the class does not exist, an option is invalid, the period is not supported, a simulator
            may be on another computer, or the class cannot be instantiated.
        BackendError: any error that the backend raises.
    """
    name = settings.robot.backend.type
    has_cell = cell_of(settings) is not None
    kind = backend_class(WITH_CELL.get(name, name) if has_cell else name)
    options = settings.backend_options(getattr(kind, "Options", NoOptions))
    around = has_cell and name not in WITH_CELL
    is_simulator = isinstance(options, BackendOptions) and options.simulator
    if is_simulator and (setting := options.remote_setting(settings)):
        raise ConfigError(f"{setting}, {NOT_HERE}")
    if around and not is_simulator:
        raise ConfigError(_no_cell(name, settings))
    refusal = capabilities_of(kind).period_refusal(settings.rt.period_s)
    if refusal:
        raise ConfigError(f"robot.backend: {name}: {refusal}")
    try:
        made = as_backend(kind(settings, limits), limits.dof, settings.rt.period_s)
        if around:
            made = backend_class(AROUND)(made, settings, limits)
        capabilities_of(made)
        return made
    except (BackendError, ConfigError, KeyboardInterrupt):
        raise
    except BaseException as exc:  # a third-party class may raise anything
        raise REGISTRY.unloadable(name, exc) from exc


def _no_cell(name: str, settings: Settings) -> str:
    """Return the reason why a cell cannot be simulated around this device; "" if it can."""
    what, instead = "robot.cell", "set robot.cell to null"
    if settings.robot.cell is None:
        what, instead = "robot.gripper", "name the real gripper, or set robot.gripper to null"
    return (
        f"{what}: hand and cell are simulated, but the backend {name!r} drives a real arm; {instead}. "
        "If the device is a simulator on this computer, set robot.backend.simulator to true: the cell "
        "is then simulated next to it"
    )
