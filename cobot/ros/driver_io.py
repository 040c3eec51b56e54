"""Inputs and outputs of arm drivers that define their own services for them.

An interface is called KIND/NUMBER, such as digital_out/16. The numbers are defined by the driver. Sources:
the definitions in ur_msgs, motoros2_interfaces, xarm_msgs and dsr_msgs2, and the code of these drivers. Where
the two differ, cobot follows the code. Analog outputs are left out, because some drivers expect values in
different units than they report.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

MAX_AGE_S = 1.0
"""Maximum age of the values of inputs and outputs, s. Older values are reported as unknown."""
_INTERFACE = re.compile(r"([a-z_]+)/(0|[1-9][0-9]{0,5})")


@dataclass(frozen=True, slots=True)
class DriverIoService:
    """A service that reads or sets inputs or outputs of one kind.

    Attributes:
        name: service name below `robot.backend.gpio_controller`.
        type: service type.
        number: field of the request that contains the number; "" if the answer lists the values for all
            numbers.
        value: field that contains the value. It is in the request if the service sets an output, otherwise in
            the answer.
        done: field of the answer that shows whether the request was executed, and its possible values then.
        fixed: other fields of the request.
    """

    name: str
    type: str
    number: str
    value: str
    done: tuple[str, tuple[bool | int, ...]] = ("success", (True,))
    fixed: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class DriverIoKind:
    """Inputs or outputs of one kind.

    Attributes:
        numbers: valid numbers.
        read: the service that reads them; None if a topic contains them, or if the driver cannot read them.
        write: the service that sets them; None for inputs.
        settable: numbers that can be set; None for all.
        is_analog: whether the values are numbers instead of true or false.
    """

    numbers: range
    read: DriverIoService | None = None
    write: DriverIoService | None = None
    settable: range | None = None
    is_analog: bool = False

    @property
    def outputs(self) -> range:
        """Numbers that can be set."""
        return range(0) if self.write is None else self.settable or self.numbers


@dataclass(frozen=True, slots=True)
class DriverIo:
    """The inputs and outputs of a driver.

    Attributes:
        below: default of `robot.backend.gpio_controller`, which is the prefix of the names of the services;
            None if the prefix is only the namespace.
        remedy: remedy if a service has no server.
        kinds: kinds of inputs and outputs by their names.
    """

    below: str | None
    remedy: str
    kinds: Mapping[str, DriverIoKind]

    def kind(self, interface: str) -> tuple[DriverIoKind, int] | None:
        """The kind and the number of an interface; None if the driver does not have it."""
        match = _INTERFACE.fullmatch(interface)
        kind = self.kinds.get(match[1]) if match else None
        if match is None or kind is None or int(match[2]) not in kind.numbers:
            return None
        return kind, int(match[2])

    def can_set(self, interface: str) -> bool:
        found = self.kind(interface)
        return found is not None and found[1] in found[0].outputs

    def valid(self) -> str:
        """The valid interfaces as text, for messages."""
        every = ", ".join(_span(name, kind.numbers) for name, kind in self.kinds.items())
        settable = ", ".join(_span(name, kind.outputs) for name, kind in self.kinds.items() if kind.outputs)
        return f"{every}; for outputs {settable} only"


def _span(kind: str, numbers: range) -> str:
    return f"{kind}/{numbers[0]} to {numbers[-1]}"


def _xarm(name: str, number: str, value: str) -> DriverIoService:
    """A service of an xArm. Its controller answers 1 while it has an error, and 2 while it has a warning; the
    answer still contains the values. During an error, only old drivers set outputs.
    """
    done = (0, 2) if value == "value" else (0, 1, 2)
    type_ = {"digitals": "GetDigitalIO", "data": "GetAnalogIO", "value": "SetDigitalIO"}[value]
    return DriverIoService(name, f"xarm_msgs/srv/{type_}", number, value, ("ret", done))


def _doosan(name: str, number: str = "index") -> DriverIoService:
    return DriverIoService(name, f"dsr_msgs2/srv/{name.title().replace('_', '')}", number, "value")


_UR_WRITE = DriverIoService("set_io", "ur_msgs/srv/SetIO", "pin", "state", fixed={"fun": 1})
_MOTOROS2_READ = DriverIoService("read_single_io", "motoros2_interfaces/srv/ReadSingleIO", "address", "value")
_MOTOROS2_WRITE = DriverIoService(
    "write_single_io", "motoros2_interfaces/srv/WriteSingleIO", "address", "value"
)
DRIVERS = {
    "ur": DriverIo(
        "io_and_status_controller",
        "start the driver's io_and_status_controller",
        {
            "digital_in": DriverIoKind(range(18)),
            "digital_out": DriverIoKind(range(18), write=_UR_WRITE),
            "analog_in": DriverIoKind(range(4), is_analog=True),
        },
    ),
    "motoros2": DriverIo(
        None,
        "start MotoROS2",
        {"io": DriverIoKind(range(10, 100_000), _MOTOROS2_READ, _MOTOROS2_WRITE, range(10_010, 30_000))},
    ),
    "xarm": DriverIo(
        "xarm",
        "set it to true in the driver's xarm_user_params.yaml",
        {
            "digital_in": DriverIoKind(range(16), _xarm("get_cgpio_digital", "", "digitals")),
            "digital_out": DriverIoKind(range(16), write=_xarm("set_cgpio_digital", "ionum", "value")),
            "analog_in": DriverIoKind(range(2), _xarm("get_cgpio_analog", "ionum", "data"), is_analog=True),
            "tool_digital_in": DriverIoKind(range(2), _xarm("get_tgpio_digital", "", "digitals")),
            "tool_digital_out": DriverIoKind(range(2), write=_xarm("set_tgpio_digital", "ionum", "value")),
            "tool_analog_in": DriverIoKind(
                range(2), _xarm("get_tgpio_analog", "ionum", "data"), is_analog=True
            ),
        },
    ),
    "doosan": DriverIo(
        "io",
        "start the driver",
        {
            "digital_in": DriverIoKind(range(1, 17), _doosan("get_ctrl_box_digital_input")),
            "digital_out": DriverIoKind(
                range(1, 17),
                _doosan("get_ctrl_box_digital_output"),
                _doosan("set_ctrl_box_digital_output"),
            ),
            "analog_in": DriverIoKind(
                range(1, 3), _doosan("get_ctrl_box_analog_input", "channel"), is_analog=True
            ),
            "tool_digital_in": DriverIoKind(range(1, 7), _doosan("get_tool_digital_input")),
            "tool_digital_out": DriverIoKind(
                range(1, 7), _doosan("get_tool_digital_output"), _doosan("set_tool_digital_output")
            ),
        },
    ),
}
"""Values of `robot.backend.io` other than `gpio`."""
