"""RegisterControl: registers, named variables, watchdogs, Modbus signals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from app.aubo.registry import service
from app.services.devices.equipment import WatchdogAction
from app.services.devices.registers import BANKS, COUNT, KINDS
from cobot.errors import InputError

if TYPE_CHECKING:
    from app.robot_services import Services

CLASS = "RegisterControl"
_TYPES = {kind: type(zero) for kind, zero in KINDS.items()}
_VARIABLES: dict[str, Any] = {"bool": False, "int32": 0, "float": 0.0, "double": 0.0, "string": ""}
_DESCRIBED = {
    "input": "an input, which devices write",
    "output": "an output, which devices read",
    "register": "a register for programs",
}


def _add_register(kind: str, bank: str) -> None:
    def read(robot: Services, index: int) -> Any:
        return robot.equipment.registers.get(kind, bank, index)

    def write(robot: Services, index: int, value: Any) -> None:
        robot.equipment.registers.set(kind, bank, index, value)

    place = f"        index: from 0 to {COUNT - 1}."
    read.__doc__ = f"""Read {_DESCRIBED[bank]}, {kind}.

    Args:
{place}

    Returns:
        its value; {KINDS[kind]} before it is first written.
    """
    write.__doc__ = f"""Write {_DESCRIBED[bank]}, {kind}.

    Args:
{place}
        value: the new value.
    """
    read.__annotations__ = {"index": int, "return": _TYPES[kind]}
    write.__annotations__ = {"index": int, "value": _TYPES[kind], "return": None}
    name = kind.capitalize() + bank.capitalize()
    service(CLASS, name=f"get{name}")(read)
    service(CLASS, name=f"set{name}")(write)


def _add_variable(kind: str) -> None:
    def read(robot: Services, key: str, default_value: Any = _VARIABLES[kind]) -> Any:
        return robot.equipment.variables.get(key, kind, default_value)

    def write(robot: Services, key: str, value: Any) -> None:
        robot.equipment.variables.set(key, kind, value)

    read.__doc__ = f"""Read a named variable, {kind}.

    Args:
        key: name of the variable.
        default_value: the result if there is no such variable.

    Returns:
        its value.
    """
    write.__doc__ = f"""Write a named variable, {kind}. It may have had a different type before. Restarts "
                    f"its watchdog.

    Args:
        key: name of the variable.
        value: the new value.
    """
    of_kind = type(_VARIABLES[kind])
    read.__annotations__ = {"key": str, "default_value": of_kind, "return": of_kind}
    write.__annotations__ = {"key": str, "value": of_kind, "return": None}
    service(CLASS, name=f"get{kind.capitalize()}")(read)
    service(CLASS, name=f"set{kind.capitalize()}")(write)


for _kind in KINDS:
    for _bank in BANKS:
        _add_register(_kind, _bank)
for _kind in _VARIABLES:
    _add_variable(_kind)


@service(CLASS)
def has_named_variable(robot: Services, key: str) -> bool:
    """Whether there is a named variable with this name.

    Args:
        key: name of the variable.

    Returns:
        true if it exists.
    """
    return robot.equipment.variables.kind(key) != ""


@service(CLASS)
def get_named_variable_type(robot: Services, key: str) -> str:
    """The type of a named variable.

    Args:
        key: name of the variable.

    Returns:
        bool, int32, float, double or string; empty if there is no such variable.
    """
    return robot.equipment.variables.kind(key)


@service(CLASS)
def get_named_variables(robot: Services) -> list[str]:
    """The names of all named variables.

    Returns:
        the names, sorted.
    """
    return robot.equipment.variables.names()


@service(CLASS)
def clear_named_variable(robot: Services, key: str) -> None:
    """Delete a named variable.

    Args:
        key: name of the variable.
    """
    robot.equipment.variables.remove(key)


@service(CLASS)
def set_watch_dog(robot: Services, key: str, timeout: float, action: int) -> None:
    """Set a watchdog. It runs an action unless the named variable with this name is written again within the
    timeout.

    Any value restarts the timeout. The first write after a watchdog has expired starts it again.

    Args:
        key: name of the variable and of the watchdog.
        timeout: timeout, s, from 0.01 to 3600; 0 deletes the watchdog.
        action: 0 reports it in the messages, 1 pauses the motion, 2 stops program and motion, 3 does the same
            and blocks all motion until setUnlockProtectiveStop.
    """
    if action not in list(WatchdogAction):
        valid = ", ".join(f"{each} {each.name.lower()}" for each in WatchdogAction)
        raise InputError(f"there is no action {action}; valid values: {valid}")
    robot.equipment.variables.watch(key, timeout, action)


@service(CLASS)
def get_watch_dog_timeout(robot: Services, key: str) -> float:
    """The timeout of a watchdog.

    Args:
        key: name of the variable.

    Returns:
        the timeout, s; 0 if there is no such watchdog.
    """
    dog = robot.equipment.variables.watchdog(key)
    return 0.0 if dog is None else dog.timeout_s


@service(CLASS)
def get_watch_dog_action(robot: Services, key: str) -> int:
    """The action of a watchdog.

    Args:
        key: name of the variable.

    Returns:
        the action, see setWatchDog; 0 if there is no such watchdog.
    """
    dog = robot.equipment.variables.watchdog(key)
    return 0 if dog is None else dog.action


@service(CLASS)
def is_watch_dog_expired(robot: Services, key: str) -> bool:
    """Whether a watchdog has expired and its variable has not been written since.

    Args:
        key: name of the variable.

    Returns:
        true if it has expired; false if there is no such watchdog.
    """
    dog = robot.equipment.variables.watchdog(key)
    return dog is not None and dog.expired
