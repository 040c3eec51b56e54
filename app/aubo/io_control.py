"""IoControl: digital and analog inputs and outputs, simulated.

Every group of inputs or outputs has the same methods, so two functions generate them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from app.aubo.registry import service
from app.services.devices.io_banks import ANALOG, DIGITAL, RANGES

if TYPE_CHECKING:
    from app.robot_services import Services

CLASS = "IoControl"
_SIMULATED = {
    "input": " In the simulation a client may set it, in place of a device.",
    "output": "",
}


def _add(name: str, doc: str, types: dict[str, Any], function: Any) -> None:
    function.__doc__, function.__annotations__ = doc, types
    service(CLASS, name=name)(function)


def _add_digital(way: str, group: str, count: int) -> None:
    name = f"{group.capitalize()}Digital{way.capitalize()}"
    what = f"{group} digital {way}"
    place = f"Args:\n    index: from 0 to {count - 1}."

    def number(robot: Services) -> int:
        return len(robot.equipment.io.digital(way, group))

    def read(robot: Services, index: int) -> bool:
        return robot.equipment.io.digital_value(way, group, index)

    def read_all(robot: Services) -> int:
        return robot.equipment.io.mask(way, group)

    def write(robot: Services, index: int, value: bool) -> None:
        robot.equipment.io.set_digital(way, group, index, value)

    _add(f"get{name}Num", f"The number of {what}s.\n\nReturns:\n    {count}.", {"return": int}, number)
    types: dict[str, Any] = {"index": int, "return": bool}
    _add(f"get{name}", f"Read a {what}.\n\n{place}\n\nReturns:\n    the value.", types, read)
    text = f"Read all {what}s at once.\n\nReturns:\n    one bit for each; index 0 is the lowest bit."
    _add(f"get{name}s", text, {"return": int}, read_all)
    text = f"Set a {what}.{_SIMULATED[way]}\n\n{place}\n    value: the new value."
    _add(f"set{name}", text, {"index": int, "value": bool, "return": None}, write)


def _add_analog(way: str, group: str, count: int) -> None:
    name = f"{group.capitalize()}Analog{way.capitalize()}"
    what = f"{group} analog {way}"
    place = f"Args:\n    index: from 0 to {count - 1}."
    ranges = "; ".join(
        f"in domain {domain} from {low:g} to {high:g} {unit}"
        for domain, (low, high, unit) in enumerate(RANGES)
    )

    def number(robot: Services) -> int:
        del robot
        return count

    def read(robot: Services, index: int) -> float:
        return robot.equipment.io.analog(way, group, index).value

    def write(robot: Services, index: int, value: float) -> None:
        robot.equipment.io.set_analog(way, group, index, value)

    def read_domain(robot: Services, index: int) -> int:
        return robot.equipment.io.analog(way, group, index).domain

    def write_domain(robot: Services, index: int, domain: int) -> None:
        robot.equipment.io.set_domain(way, group, index, domain)

    _add(f"get{name}Num", f"The number of {what}s.\n\nReturns:\n    {count}.", {"return": int}, number)
    text = f"Read a {what}.\n\n{place}\n\nReturns:\n    {ranges}."
    _add(f"get{name}", text, {"index": int, "return": float}, read)
    text = f"Set a {what}.{_SIMULATED[way]}\n\n{place}\n    value: {ranges}."
    _add(f"set{name}", text, {"index": int, "value": float, "return": None}, write)
    text = f"The signal type of a {what}.\n\n{place}\n\nReturns:\n    0 current, 1 voltage."
    _add(f"get{name}Domain", text, {"index": int, "return": int}, read_domain)
    text = f"Set a {what} to current or voltage. Its value becomes the minimum.\n\n{place}\n"
    text += "    domain: 0 current, 1 voltage."
    _add(f"set{name}Domain", text, {"index": int, "domain": int, "return": None}, write_domain)


for _way in ("input", "output"):
    for _group, _count in DIGITAL.items():
        _add_digital(_way, _group, _count)
    for _group, _count in ANALOG.items():
        _add_analog(_way, _group, _count)
