"""The available backends: those of cobot, and those that installed packages declare."""

from __future__ import annotations

from collections.abc import Callable

from cobot.cell import cell_of
from cobot.config import Settings
from cobot.entry_points import Registry
from cobot.errors import ConfigError
from cobot.types import JointLimits
from rtloop.backends.protocols import Backend, BackendError, NoOptions, capabilities_of
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
"""The backends that simulate a cell, by the name that they have without one."""


def backend_names() -> dict[str, str]:
    """The valid names for `robot.backend`, each with the place of its class."""
    return REGISTRY.names()


def backend_class(name: str) -> Callable[..., Backend]:
    """The class for a name, or for "package.module:Class".

    Raises:
        ConfigError: the class does not exist; the error lists the valid names.
    """
    return REGISTRY.load(name)


def make_backend(settings: Settings, limits: JointLimits) -> Backend:
    """Make the backend of `robot.backend`.

    Raises:
        ConfigError: the class does not exist, an option is invalid, the period is not supported, or the class
            cannot be instantiated.
        BackendError: raised by the backend.
    """
    name = settings.robot.backend.type
    kind = backend_class(_with_cell(name, settings) if cell_of(settings) is not None else name)
    settings.backend_options(getattr(kind, "Options", NoOptions))
    refusal = capabilities_of(kind).period_refusal(settings.rt.period_s)
    if refusal:
        raise ConfigError(f"robot.backend: {name}: {refusal}")
    try:
        made = as_backend(kind(settings, limits), limits.dof, settings.rt.period_s)
        capabilities_of(made)
        return made
    except (BackendError, ConfigError, KeyboardInterrupt):
        raise
    except BaseException as exc:  # a foreign class may raise anything
        raise REGISTRY.unloadable(name, exc) from exc


def _with_cell(name: str, settings: Settings) -> str:
    """The class of a backend with a cell.

    Raises:
        ConfigError: this backend simulates no cell.
    """
    if name not in WITH_CELL:
        if settings.robot.cell is None:
            raise ConfigError(
                f"robot.gripper: simulated needs a backend with a simulated hand, which is only "
                f"{', '.join(WITH_CELL)}, not {name!r}; name the real gripper, or set robot.gripper to null"
            )
        raise ConfigError(
            f"robot.cell: the backend {name!r} has no simulated cell, only {', '.join(WITH_CELL)} has one; "
            "set robot.cell to null"
        )
    return WITH_CELL[name]
