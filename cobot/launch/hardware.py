"""`cobot check --hardware`: the checklist before the first motion of a real arm, see docs/safety.md."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TextIO

from cobot.cell.surroundings import tool_file
from cobot.config import Settings
from cobot.errors import CobotError
from cobot.ipc.device_record import DeviceReport, device_of
from cobot.ipc.shm import MemoryRole, RobotMemory
from cobot.launch.check import Checked
from cobot.robot.device import LESS

TO_DO = (
    (
        "emergency stop",
        "press it: the drives go off, and cobot reports it; release it, then POST /robot/reset",
    ),
    ("safety configuration", "limits, spaces and stops are set in the robot's controller; note its checksum"),
    (
        "base and mounting",
        "check that the arm is mounted as in its model; if not, set gravity (docs/tool.md)",
    ),
    ("stop", "try POST /stop and POST /stop?category=1 in a slow motion"),
    ("network", "the device's cable goes to this computer only; tokens if others can reach the service"),
    ("people", "keep people out of reach; one person keeps a hand on the emergency stop"),
)
"""Items of the checklist that no program can check."""
NOT_RUNNING = "start `cobot run`, which asks the device; then check again"


def check_hardware(settings: Settings, checked: Sequence[Checked], out: TextIO) -> list[Checked]:
    """Print the list for each robot, with results for the items that a program can check.

    Args:
        checked: the earlier findings of `check`.
    """
    known = []
    for name, each in settings.each.items():
        about = f"{name}: " if settings.robots else ""
        device = _device(name)
        found = [
            _backend(f"{about}backend", checked, device, each),
            _mode(device),
            _limits(f"{about}backend", checked),
            _load(each),
            _position(device),
        ]
        for item in found:
            if isinstance(item, Checked):
                known.append(item)
                out.write(f"{'ok     ' if item.good else 'FAILED '} hardware {item.item}: {item.found}\n")
            else:
                out.write(f"TO DO   hardware {about}{item[0]}: {item[1]}\n")
        for what, todo in TO_DO:
            out.write(f"TO DO   hardware {about}{what}: {todo}\n")
    return known


def _device(name: str) -> DeviceReport | None:
    """The findings about a running robot; None if the robot is not running."""
    try:
        memory = RobotMemory.attach(name, MemoryRole.READER)
    except CobotError:
        return None
    try:
        known = memory.device.sequence > 0 and memory.device.try_read()
        return device_of(memory.device.data) if known else None
    except ValueError:
        return None
    finally:
        memory.close()


def _backend(
    item: str, checked: Sequence[Checked], device: DeviceReport | None, settings: Settings
) -> Checked:
    """Check whether the backend can be created and drives real hardware."""
    if settings.robot.backend.options.get("simulator"):
        return Checked(
            item,
            False,
            "robot.backend.simulator is true: remove it, it simulates hand and parts",
        )
    said = next((each for each in checked if each.item == item), None)
    if device is not None:
        what = "hardware" if device.capabilities.hardware else "a simulation: robot.backend names no hardware"
        return Checked(item, device.capabilities.hardware, what)
    if said is None or not said.good:
        return Checked(item, False, "the backend cannot be created: see above")
    return Checked(item, ": hardware;" in said.found, said.found)


def _mode(device: DeviceReport | None) -> Checked | tuple[str, str]:
    item = "operation mode"
    mode = device.status.operation_mode if device is not None and device.status is not None else ""
    if not mode:
        return item, "T1 at the teach pendant for the first motions; the device does not report its mode"
    return Checked(item, mode == "T1", f"{mode}; T1 is for the first motions")


def _limits(backend: str, checked: Sequence[Checked]) -> Checked | tuple[str, str]:
    item = "limits"
    said = next((each.found for each in checked if each.item == backend), "")
    _, told, less = said.partition(f"; {LESS}: ")
    if told:
        return Checked(item, True, f"{LESS}; the device's limits are used: {less}")
    return (
        item,
        "the device reports no limits below those of the model: compare the model with the data sheet",
    )


def _load(settings: Settings) -> Checked | tuple[str, str]:
    item = "tool and load"
    try:
        tool = tool_file(settings).read()
    except CobotError as exc:
        return Checked(item, False, str(exc))
    if not tool.version:
        return (
            item,
            "never set: POST /robot/tool, or check the tool of the model; set the same in the controller",
        )
    return Checked(item, True, f"{tool.name or 'no name'}, {tool.mass:g} kg; set the same in the controller")


def _position(device: DeviceReport | None) -> Checked | tuple[str, str]:
    item = "position"
    if device is None:
        return item, NOT_RUNNING
    if device.unacknowledged:
        return item, device.unacknowledged
    return Checked(item, True, "acknowledged")
