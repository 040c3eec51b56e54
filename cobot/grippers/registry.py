"""The grippers by name: those that ship with cobot, and those that installed packages declare."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cobot.config import Settings
from cobot.entry_points import Registry
from cobot.errors import ConfigError
from cobot.grippers.protocol import Gripper, GripperCapabilities, GripperError, GripperOptions, IoPort

REGISTRY = Registry(
    "cobot.grippers",
    "robot.gripper",
    {
        "digital": "cobot.grippers.digital:DigitalGripper",
        "simulated": "cobot.grippers.simulated:SimulatedGripper",
        "robotiq": "cobot.grippers.robotiq:RobotiqGripper",
    },
)


def gripper_names() -> dict[str, str]:
    """The names that `robot.gripper` may have, each with the place of its class."""
    return REGISTRY.names()


def gripper_class(name: str) -> Callable[..., Gripper]:
    """The class of a name, or of "package.module:Class".

    Raises:
        ConfigError: it does not exist or cannot be loaded. The error lists the valid names.
    """
    return REGISTRY.load(name)


def gripper_options(settings: Settings) -> GripperOptions:
    """The options of the gripper that `robot.gripper` names, checked.

    Raises:
        ConfigError: there is no such class, or it has no such options.
    """
    if settings.robot.gripper is None:
        raise ConfigError("robot.gripper: there is none")
    kind: Any = gripper_class(settings.robot.gripper.type)
    options: Any = getattr(kind, "Options", GripperOptions)
    if not (isinstance(options, type) and issubclass(options, GripperOptions)):
        raise ConfigError(
            f"robot.gripper: {settings.robot.gripper.type}: Options must be derived from GripperOptions"
        )
    return settings.gripper_options(options)


def make_gripper(settings: Settings, port: IoPort) -> Gripper:
    """The gripper that `robot.gripper` names.

    Raises:
        ConfigError: there is no such class, it has no such options, or it cannot be made.
    """
    options = gripper_options(settings)
    assert settings.robot.gripper is not None  # see above
    name = settings.robot.gripper.type
    try:
        made = gripper_class(name)(options, port)
        if not isinstance(made.capabilities, GripperCapabilities):
            raise TypeError("capabilities must be a GripperCapabilities")
        return made
    except (ConfigError, KeyboardInterrupt):
        raise
    except GripperError as exc:
        raise ConfigError(f"robot.gripper: {name}: {exc}") from exc
    except BaseException as exc:  # a foreign class may raise anything
        raise REGISTRY.unloadable(name, exc) from exc
