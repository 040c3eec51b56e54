"""The available backends: those of cobot, and those that installed packages declare."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from importlib.metadata import entry_points
from typing import Any

from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.foreign import plain_error
from cobot.types import JointLimits
from rtloop.backends.protocols import Backend, BackendError, NoOptions, capabilities_of
from rtloop.backends.trajectory_driver import as_backend

GROUP = "cobot.backends"
SHIPPED = {
    "franka": "rtloop.backends.franka:FrankaBackend",
    "mujoco": "rtloop.backends.mujoco:MujocoBackend",
    "fri": "rtloop.backends.fri:FriBackend",
}
"""The backends of cobot, which are also its entry points; this finds them in an uninstalled source tree
too."""
WITH_CELL = {"mujoco": "rtloop.backends.cell:CellBackend"}
"""The backends that simulate a cell, by the name that they have without one."""


def backend_names() -> dict[str, str]:
    """The valid names for `robot.backend`, each with the location of its class."""
    found = {each.name: each.value for each in entry_points(group=GROUP)}
    return {**found, **SHIPPED}


def backend_class(name: str) -> Callable[..., Backend]:
    """The class for a name, or for "package.module:Class".

    Raises:
        ConfigError: it does not exist; lists the valid names.
    """
    names = backend_names()
    module, _, attribute = names.get(name, name).partition(":")
    if not attribute:
        raise ConfigError(
            f"robot.backend: there is no {name!r}; valid are: {', '.join(sorted(names))}, or "
            "package.module:Class"
        )
    try:
        kind: Any = importlib.import_module(module)
        for part in attribute.split("."):
            kind = getattr(kind, part)
    except KeyboardInterrupt:
        raise
    except BaseException as exc:  # a foreign module may raise anything
        raise _unloadable(name, exc) from exc
    if not callable(kind):
        raise ConfigError(f"robot.backend: cannot load {name!r}: {attribute} is not a class")
    made: Callable[..., Backend] = kind
    return made


def make_backend(settings: Settings, limits: JointLimits) -> Backend:
    """Make the backend of `robot.backend`.

    Raises:
        ConfigError: the class does not exist, an option is invalid, the period is not supported, or the class
            cannot be instantiated.
        BackendError: raised by the backend.
    """
    name = settings.robot.backend.type
    kind = backend_class(name if settings.robot.cell is None else _with_cell(name))
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
        raise _unloadable(name, exc) from exc


def _with_cell(name: str) -> str:
    """The class of a backend with a cell.

    Raises:
        ConfigError: this backend simulates none.
    """
    if name not in WITH_CELL:
        raise ConfigError(
            f"robot.cell: the backend {name!r} has no simulated cell, only {', '.join(WITH_CELL)} has one; "
            "set robot.cell to null"
        )
    return WITH_CELL[name]


def _unloadable(name: str, exc: BaseException) -> ConfigError:
    return ConfigError(f"robot.backend: cannot load {name!r}: {plain_error(exc)}")
