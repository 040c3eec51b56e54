"""Checks of a backend's inputs and outputs."""

from __future__ import annotations

from collections.abc import Callable

from cobot.contract_checks import ContractError, NotTested
from cobot.ipc.io_record import report_of
from cobot.ipc.layout import IO_NAME_BYTES, IO_POINTS, Command
from cobot.robot.io_points import IoKind, IoPoint, io_points, require_number
from cobot.types import LoopMode
from rtloop.backends import BackendError, HasIo, capabilities_of
from rtloop.contract.cell import CheckedBackend
from rtloop.contract.driver import Driver
from rtloop.results import Rejected

UNKNOWN = "no such output"


def io(cell: CheckedBackend) -> str:
    """While the arm is held, each output can be set to a different value, reports it, and can be set back. An
    unknown output is rejected.
    """
    if not capabilities_of(cell.kind).io:
        raise NotTested("the backend's capabilities do not include io")
    with cell.drive() as driver:
        backend = driver.backend
        if not isinstance(backend, HasIo):
            raise ContractError(
                "capabilities.io requires the methods io and set_output; one of them is missing"
            )
        points = list(io_points(backend.io()))
        _require_sound(points)
        outputs = [each for each in points if each.is_output]
        for point in outputs:
            for value in (
                1.0 - point.value if point.kind is IoKind.BOOLEAN else point.value + 1.0,
                point.value,
            ):
                _set(driver, point.name, value)
        try:
            backend.set_output(UNKNOWN, 1.0)
        except BackendError:
            pass
        else:
            raise ContractError(f"set_output({UNKNOWN!r}) must raise a BackendError, but does not")
        if driver.mode != LoopMode.HOLD:
            raise ContractError(
                f"after the outputs were set, the mode is {driver.mode.name}: {driver.reason}"
            )
    return f"{len(outputs)} outputs among {len(points)} inputs and outputs"


def _require_sound(points: list[IoPoint]) -> None:
    """Check the list of inputs and outputs. Raises ContractError if a name is invalid or occurs twice, or if
    there are too many.
    """
    names = [each.name for each in points]
    if len(set(names)) < len(names) or len(names) > IO_POINTS:
        raise ContractError(
            f"io() must return at most {IO_POINTS} inputs and outputs with different names, "
            f"got {sorted(names)}"
        )
    for point in points:
        if not 0 < len(point.name.encode()) <= IO_NAME_BYTES or "/" in point.name:
            raise ContractError(
                f"io(): the name {point.name!r} must be 1 to {IO_NAME_BYTES} bytes without a slash"
            )
        require_number(point, point.value)


def _set(driver: Driver, name: str, value: float) -> None:
    record = driver.memory.output.data
    record["name"], record["value"] = name.encode(), value
    driver.memory.output.publish()
    result = driver.send(Command.OUTPUT)
    if isinstance(result, Rejected):
        raise ContractError(f"set_output({name!r}, {value:g}): {result.reason}")
    driver.until(f"{name} is reported as {value:g}", lambda: _reported(driver, name, value))


def _reported(driver: Driver, name: str, value: float) -> bool:
    if not driver.memory.io.try_read():
        return False
    points = report_of(driver.memory.io.data).points
    return any(each.name == name and each.has(value) for each in points)


CHECKS: dict[str, Callable[[CheckedBackend], str]] = {"io": io}
