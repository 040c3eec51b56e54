"""The grippers by name: those that are part of cobot, and those that installed packages declare."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cobot.cell import Cup, cell_of, hand_of
from cobot.cell.cell import CUP, SUCTION, VACUUM
from cobot.config import Settings
from cobot.config.backend import BackendSection, options_of
from cobot.entry_points import Registry
from cobot.errors import ConfigError
from cobot.grippers.protocol import Gripper, GripperCapabilities, GripperError, GripperOptions, IoPort

REGISTRY = Registry(
    "cobot.grippers",
    "robot.gripper",
    {
        "digital": "cobot.grippers.digital:DigitalGripper",
        "simulated": "cobot.grippers.simulated:SimulatedGripper",
        "vacuum": "cobot.grippers.vacuum:VacuumGripper",
        "franka": "cobot.grippers.franka:FrankaHand",
        "ros": "cobot.grippers.ros:RosGripper",
        "robotiq": "cobot.grippers.robotiq:RobotiqGripper",
    },
)


HELD_SHARE, LOST_SHARE, GRASP_TIMES = 0.7, 0.5, 20.0
"""Three values for the cup of a simulated cell. It holds a part if the vacuum is above the first share of its
full value, and has lost the part below the second share. A grasp takes at most the third value, a multiple of
the cup's time constant.
"""


def gripper_names() -> dict[str, str]:
    """Valid types in `robot.gripper`, each with the location of its class."""
    return REGISTRY.names()


def gripper_class(name: str) -> Callable[..., Gripper]:
    """The gripper class for a name or for "package.module:Class".

    Raises:
        ConfigError: the class does not exist or cannot be loaded. The error lists the valid names.
    """
    return REGISTRY.load(name)


def gripper_section(settings: Settings) -> BackendSection | None:
    """The robot's gripper settings: `robot.gripper`; otherwise the hand or the cup of its cell; otherwise
    None.

    Raises:
        ConfigError: the cell file is invalid.
    """
    cell = settings.robot.cell
    if settings.robot.gripper is not None or cell is None:
        return settings.robot.gripper
    made = cell_of(settings)
    if made is not None and made.cup is not None:
        return BackendSection(type="vacuum", options=_of_cup(made.cup), folder=cell)
    if hand_of(settings) is None:
        return None
    return BackendSection(type="simulated", options={}, folder=cell)


def _of_cup(cup: Cup) -> dict[str, Any]:
    """The driver options for the cup of a simulated cell."""
    return {
        "output": f"{CUP}.{SUCTION}",
        "sensor": f"{CUP}.{VACUUM}",
        "threshold": HELD_SHARE * cup.vacuum_kpa,
        "hysteresis": (HELD_SHARE - LOST_SHARE) * cup.vacuum_kpa,
        "grasp_time_s": min(GRASP_TIMES * cup.evacuate_s, 30.0),
    }


def gripper_options(settings: Settings) -> GripperOptions:
    """The checked options for the robot's gripper.

    Raises:
        ConfigError: there is no gripper, or its class or an option does not exist.
    """
    section = gripper_section(settings)
    if section is None:
        raise ConfigError("robot.gripper: the robot has no gripper; `cobot gripper list` shows the types")
    kind: Any = gripper_class(section.type)
    options: Any = getattr(kind, "Options", GripperOptions)
    if not (isinstance(options, type) and issubclass(options, GripperOptions)):
        raise ConfigError(f"robot.gripper: {section.type}: Options must be derived from GripperOptions")
    return options_of(section, options, "robot.gripper")


def make_gripper(settings: Settings, port: IoPort) -> Gripper:
    """Create the robot's gripper.

    Raises:
        ConfigError: there is no gripper, its class or an option does not exist, or it cannot be created.
    """
    options, section = gripper_options(settings), gripper_section(settings)
    assert section is not None  # checked above
    name = section.type
    try:
        kind: Any = gripper_class(name)
        made: Gripper = kind.of_robot(settings, port) if hasattr(kind, "of_robot") else kind(options, port)
        if not isinstance(made.capabilities, GripperCapabilities):
            raise TypeError("capabilities must be a GripperCapabilities")
        return made
    except (ConfigError, KeyboardInterrupt):
        raise
    except GripperError as exc:
        raise ConfigError(f"robot.gripper: {name}: {exc}") from exc
    except BaseException as exc:  # a class from another package may raise anything
        raise REGISTRY.unloadable(name, exc) from exc
