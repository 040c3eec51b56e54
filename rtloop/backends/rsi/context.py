"""The RSI context: the objects that connect the Ethernet telegrams with axes, inputs and outputs.

The object types and their numbers, ports and parameters are those in files written by KUKA's RSIVisual. RSI
3.x to 4.0 count ports and parameters from 1, RSI 4.1 and later from 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from rtloop.backends.rsi.options import EXTERNAL_AXES, KUKA_LIMIT, ROBOT_AXES, is_external

MONITOR_MARGIN = 1.0
"""Difference between the limits of AXISCORRMON, which ends RSI, and AXISCORR. It is also KUKA's default."""
PRECISION = 6
NO_FLAG = -1
ALL_AXES = (*ROBOT_AXES, *EXTERNAL_AXES)
STATE_OUTPUTS = {"T1": 993, "T2": 994, "AUT": 995, "EXT": 996, "Ready": 1012, "NoStop": 1013}
"""Numbers in $OUT that are assigned to $T1, $T2, $AUT, $EXT, $PERI_RDY and $ALARM_STOP by default."""
MODE_INDEX = 1
"""Index in $SEN_PINT at which the program reports whether its corrections are absolute or relative."""


@dataclass(frozen=True, slots=True)
class ObjectParameter:
    """A parameter of an object.

    Attributes:
        old, new: number of the parameter in RSI 3.x to 4.0 and in later releases.
        fixed: whether the parameter cannot change while RSI is on.
    """

    name: str
    old: int
    new: int
    value: str
    fixed: bool = False


@dataclass(frozen=True, slots=True)
class RsiObject:
    """An object of the context.

    Attributes:
        kind, old_id, new_id: name of the object's type, and its number in RSI 3.x to 4.0 and in later
            releases.
        inputs: for each connected port, its number from 0, and the name and the port of its source.
    """

    kind: str
    name: str
    old_id: int
    new_id: int
    inputs: tuple[tuple[int, str, int], ...] = ()
    parameters: tuple[ObjectParameter, ...] = ()


@dataclass(slots=True)
class Context:
    """The objects of a context, and their entries in the Ethernet configuration.

    Attributes:
        send, receive: tag and type of each channel, and HOLDON for received ones, in the order of the channel
            numbers.
        sources: object and port that provide the value of each sent channel.
    """

    objects: list[RsiObject] = field(default_factory=list)
    send: list[tuple[str, str]] = field(default_factory=list)
    receive: list[tuple[str, str, bool]] = field(default_factory=list)
    sources: list[tuple[str, int]] = field(default_factory=list)


ETHERNET = "ETHERNET1"


def _limits(axes: tuple[str, ...], most: dict[str, float], first: int) -> Iterator[ObjectParameter]:
    """Yield LowerLim and UpperLim for six axes. `first` is the number of the first parameter in old
    releases.
    """
    for sign, word, offset, new in ((-1, "Lower", 0, 0), (1, "Upper", 12, 6)):
        for index, axis in enumerate(axes):
            value = sign * most.get(axis, KUKA_LIMIT)
            yield ObjectParameter(f"{word}Lim{axis}", first + offset + index, new + index, f"{value:g}")


def _digital(kind: str, name: str, number: int, type_id: int, source: int | None = None) -> RsiObject:
    """Create an object for one bit, whose value comes from the ETHERNET channel `source`."""
    inputs = () if source is None else ((0, ETHERNET, source),)
    return RsiObject(
        kind,
        name,
        type_id,
        type_id,
        inputs,
        (ObjectParameter("Index", 1, 0, str(number)), ObjectParameter("DataSize", 2, 1, "0")),
    )


def context_for(
    axes: tuple[str, ...],
    most: dict[str, float],
    tags: tuple[str, str],
    inputs: list[int],
    outputs: list[int],
    *,
    ethernet_file: str,
    timeout: int,
    hold_on: bool,
) -> Context:
    """Create the context for a robot.

    Args:
        axes: axes that move joints of the model.
        most: maximum correction of each axis, degrees or mm.
        tags: elements that contain the corrections of the robot's axes and of the external axes.
        inputs, outputs: numbers in $IN and $OUT.
        timeout: number of late answers after which RSI ends.
        hold_on: whether the last correction stays in effect if an answer is missing.
    """
    found = Context()
    moved = [axis for axis in ALL_AXES if axis in axes]
    _receive(found, moved, most, tags, outputs, hold_on=hold_on)
    monitored = tuple(
        ObjectParameter(f"Max{axis}", number + 1, number, f"{most.get(axis, KUKA_LIMIT) + MONITOR_MARGIN:g}")
        for number, axis in enumerate(ALL_AXES)
    )
    found.objects.append(RsiObject("AXISCORRMON", "AXISCORRMON1", 82, 82, (), monitored))
    reported = [*ROBOT_AXES, *(axis for axis in moved if is_external(axis))]
    for axis in reported:
        _send(found, f"AxisCorrMon.{axis}", "DOUBLE", "AXISCORRMON1", ALL_AXES.index(axis))
    for number, (word, output) in enumerate(STATE_OUTPUTS.items(), start=1):
        found.objects.append(_digital("DIGOUT", f"DIGOUT{number}", output, 43))
        _send(found, f"State.{word}", "BOOL", f"DIGOUT{number}")
    found.objects.append(RsiObject("OV_PRO", "OV_PRO1", 63, 63))
    _send(found, "OvPro", "LONG", "OV_PRO1")
    mode = (ObjectParameter("Index", 1, 0, str(MODE_INDEX)),)
    found.objects.append(RsiObject("SEN_PINT", "SEN_PINT1", 57, 57, (), mode))
    _send(found, "CorrMode", "LONG", "SEN_PINT1")
    for number, digital in enumerate(inputs, start=1):
        found.objects.append(_digital("DIGIN", f"DIGIN{number}", digital, 29))
        _send(found, f"In.i{number}", "BOOL", f"DIGIN{number}")
    for number, digital in enumerate(outputs, start=1):
        name = f"DIGOUT{number + len(STATE_OUTPUTS)}"
        found.objects.append(_digital("DIGOUT", name, digital, 43))
        _send(found, f"Out.o{number}", "BOOL", name)
    found.objects.append(
        RsiObject(
            "ETHERNET",
            ETHERNET,
            64,
            64,
            tuple((number, name, port) for number, (name, port) in enumerate(found.sources)),
            (
                ObjectParameter("ConfigFile", 1, 0, ethernet_file, fixed=True),
                ObjectParameter("Timeout", 1, 0, str(timeout)),
                ObjectParameter("Flag", 4, 3, str(NO_FLAG)),
                ObjectParameter("Precision", 8, 7, str(PRECISION)),
            ),
        )
    )
    return found


def _send(context: Context, tag: str, kind: str, source: str, port: int = 0) -> None:
    context.send.append((tag, kind))
    context.sources.append((source, port))


def _receive(
    context: Context,
    moved: list[str],
    most: dict[str, float],
    tags: tuple[str, str],
    outputs: list[int],
    *,
    hold_on: bool,
) -> None:
    """Connect the channels from ETHERNET to the axes and outputs."""
    groups = (
        ("AXISCORR", tags[0], ROBOT_AXES, 33, 33, 1),
        ("AXISCORREXT", tags[1], EXTERNAL_AXES, 33, 87, 7),
    )
    for kind, tag, axes, old_id, new_id, first in groups:
        own = [axis for axis in moved if axis in axes]
        if not own:
            continue
        ports = []
        for axis in own:
            ports.append((axes.index(axis), ETHERNET, len(context.receive)))
            context.receive.append((f"{tag}.{axis}", "DOUBLE", hold_on))
        context.objects.append(
            RsiObject(kind, f"{kind}1", old_id, new_id, tuple(ports), tuple(_limits(axes, most, first)))
        )
    for number, digital in enumerate(outputs, start=1):
        name = f"MAP2DIGOUT{number}"
        context.objects.append(_digital("MAP2DIGOUT", name, digital, 14, len(context.receive)))
        context.receive.append((f"Out.o{number}", "BOOL", True))
