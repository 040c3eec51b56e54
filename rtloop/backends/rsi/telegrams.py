"""RSI's telegrams, for both sides of the connection: `Rob` from the controller, and the answer `Sen`.

Elements with the prefix DEF_ in the Ethernet configuration have fixed names (RIst, AIPos, ASPos, EIPos,
ESPos, Delay). All other names come from the Ethernet configuration that `rtloop.backends.rsi.files` writes.
In telegrams, rotary axes are in degrees and linear axes in mm.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from cobot.types import Array, JointLimits
from rtloop.backends.rsi.options import ROBOT_AXES, RsiOptions, is_external
from rtloop.backends.rsi.xml_reader import Telegram, TelegramElement, TelegramError, read_telegram, shown

ROB_TYPE = "KUKA"
STATE, OVERRIDE, MODE, IN, OUT, MONITOR = "State", "OvPro", "CorrMode", "In", "Out", "AxisCorrMon"
"""Elements that cobot's Ethernet configuration defines, apart from the corrections."""
OPERATION_MODES = ("T1", "T2", "AUT", "EXT")
STATE_BITS = (*OPERATION_MODES, "Ready", "NoStop")
MODES = {1: "absolute", 2: "relative"}
POSE = ("X", "Y", "Z", "A", "B", "C")
DECIMALS = 6
MICRO = 10**DECIMALS
"""Resolution of a correction per degree or millimetre. Corrections are integers, so that their sums are
exact.
"""
MAX_VALUE = 1e6
MAX_IPOC = 2**63
_NUMBER = re.compile(r"[+-]?(?:[0-9]{1,15}(?:\.[0-9]{0,18})?|\.[0-9]{1,18})(?:[eE][+-]?[0-9]{1,3})?")
_WHOLE = re.compile(r"[0-9]{1,19}")
_TRUE, _FALSE = {"1", "true"}, {"0", "false"}


@dataclass(frozen=True, slots=True)
class TelegramLayout:
    """The layout of one robot's telegrams.

    Attributes:
        axes: axis of each joint.
        scale: wire units (degrees or mm) per rad or m, shape (dof,).
        inputs, outputs: names of digital inputs and outputs.
    """

    axes: tuple[str, ...]
    scale: Array
    axis_tag: str
    external_tag: str
    sen_type: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    @property
    def corrections(self) -> list[tuple[str, list[int]]]:
        """The elements that contain corrections, with their joints."""
        return _groups(self.axes, self.axis_tag, self.external_tag)


@cache
def _groups(axes: tuple[str, ...], axis_tag: str, external_tag: str) -> list[tuple[str, list[int]]]:
    found = []
    for tag, external in ((axis_tag, False), (external_tag, True)):
        joints = [index for index, axis in enumerate(axes) if is_external(axis) == external]
        if joints:
            found.append((tag, joints))
    return found


def layout_of(options: RsiOptions, limits: JointLimits) -> TelegramLayout:
    slides = limits.slides or (False,) * limits.dof
    return TelegramLayout(
        options.axes_of(limits),
        np.where(slides, 1e3, 180.0 / math.pi),
        options.axis_tag,
        options.external_tag,
        options.sen_type,
        tuple(options.inputs),
        tuple(options.outputs),
    )


@dataclass(slots=True)
class RobState:
    """The telegram from the controller. Joint values are in rad or m, or () if not reported.

    Attributes:
        ipoc: the controller's time stamp, ms, which the answer repeats.
        position: measured position.
        setpoint: the controller's set position, including corrections.
        correction: sum of the corrections since RSI_ON.
        delay: number of answers that were late since RSI_ON, None if not reported.
        pose: X, Y, Z in mm and A, B, C in degrees.
        operation_mode: one of `OPERATION_MODES`, "" if not reported.
        is_ready, is_stopped: whether the drives are on, and whether a safety stop is active; None if not
            reported.
        override: program override, 0 to 1.
        mode: mode of RSI_ON that its program reports, absolute or relative; "" if not reported.
        inputs, outputs: values of the inputs and outputs, in the order of the layout.
    """

    ipoc: int
    position: tuple[float, ...]
    setpoint: tuple[float, ...] = ()
    correction: tuple[float, ...] = ()
    delay: int | None = None
    pose: tuple[float, ...] = ()
    operation_mode: str = ""
    is_ready: bool | None = None
    is_stopped: bool | None = None
    override: float | None = None
    mode: str = ""
    inputs: tuple[bool, ...] = ()
    outputs: tuple[bool, ...] = ()


@dataclass(slots=True)
class SenAnswer:
    """The telegram from the sensor. In RSI's terms cobot is the sensor.

    Attributes:
        corrections: correction of each joint, in millionths of a degree or mm.
    """

    ipoc: int
    corrections: tuple[int, ...]
    outputs: tuple[bool, ...] = ()


def decode_rob(packet: bytes, layout: TelegramLayout) -> RobState | str:
    """Decode the controller's telegram, or return a sentence with the reason why it is invalid. Never
    raises.
    """
    try:
        return _rob(read_telegram(packet), layout)
    except TelegramError as exc:
        return str(exc)


def decode_sen(packet: bytes, layout: TelegramLayout) -> SenAnswer | str:
    """Decode the sensor's telegram, or return a sentence with the reason why it is invalid. Never raises."""
    try:
        return _sen(read_telegram(packet), layout)
    except TelegramError as exc:
        return str(exc)


def encode_sen(
    layout: TelegramLayout, ipoc: int, corrections: Sequence[int], outputs: Sequence[bool]
) -> bytes:
    """Encode a telegram to the controller.

    Args:
        corrections: correction of each joint, in millionths of a degree or mm.
    """
    parts = [f'<Sen Type="{layout.sen_type}">']
    for tag, joints in layout.corrections:
        words = (f'{layout.axes[index]}="{corrections[index] / MICRO:.{DECIMALS}f}"' for index in joints)
        parts.append(f"<{tag} {' '.join(words)}/>")
    if layout.outputs:
        parts.append(f"<{OUT} {_bits('o', outputs)}/>")
    parts.append(f"<IPOC>{ipoc}</IPOC></Sen>")
    return "".join(parts).encode()


def encode_rob(layout: TelegramLayout, state: RobState) -> bytes:
    """Encode the controller's telegram, for a simulated controller."""
    parts = [f'<Rob Type="{ROB_TYPE}">']
    if state.pose:
        parts.append(f"<RIst {_attributes(POSE, state.pose)}/>")
    for robot, external, values in (
        ("AIPos", "EIPos", state.position),
        ("ASPos", "ESPos", state.setpoint),
        (MONITOR, "", state.correction),
    ):
        if values:
            parts.append(_axes(layout, robot, external, values))
    if state.delay is not None:
        parts.append(f'<Delay D="{state.delay}"/>')
    if state.operation_mode:
        bits = [state.operation_mode == mode for mode in OPERATION_MODES]
        bits += [bool(state.is_ready), not state.is_stopped]
        words = (f'{name}="{int(bit)}"' for name, bit in zip(STATE_BITS, bits, strict=True))
        parts.append(f"<{STATE} {' '.join(words)}/>")
    if state.override is not None:
        parts.append(f"<{OVERRIDE}>{round(100.0 * state.override)}</{OVERRIDE}>")
    for number, mode in MODES.items():
        if mode == state.mode:
            parts.append(f"<{MODE}>{number}</{MODE}>")
    for tag, letter, points in ((IN, "i", state.inputs), (OUT, "o", state.outputs)):
        if points:
            parts.append(f"<{tag} {_bits(letter, points)}/>")
    parts.append(f"<IPOC>{state.ipoc}</IPOC></Rob>")
    return "".join(parts).encode()


def _bits(letter: str, values: Sequence[bool]) -> str:
    return " ".join(f'{letter}{number}="{int(value)}"' for number, value in enumerate(values, start=1))


def _attributes(names: Sequence[str], values: Sequence[float]) -> str:
    return " ".join(f'{name}="{value:.{DECIMALS}f}"' for name, value in zip(names, values, strict=True))


def _axes(layout: TelegramLayout, robot: str, external: str, values: Sequence[float]) -> str:
    """Encode the positions of all axes as elements. Robot axes without a joint are 0."""
    by_axis = dict(zip(layout.axes, np.multiply(values, layout.scale).tolist(), strict=True))
    own = [(axis, by_axis.get(axis, 0.0)) for axis in ROBOT_AXES]
    others = [(axis, value) for axis, value in by_axis.items() if is_external(axis)]
    if not external:
        return _joined(robot, own + others)
    return _joined(robot, own) + (_joined(external, others) if others else "")


def _joined(tag: str, values: Sequence[tuple[str, float]]) -> str:
    return f"<{tag} {_attributes([name for name, _ in values], [value for _, value in values])}/>"


def _number(text: str, where: str) -> float:
    if not _NUMBER.fullmatch(text):
        raise TelegramError(f"{where} is {shown(text)}, which is not a finite number")
    value = float(text)
    if not abs(value) <= MAX_VALUE:
        raise TelegramError(f"{where} is {shown(text)}; the maximum is {MAX_VALUE:g}")
    return value


def _whole(text: str, where: str) -> int:
    text = text.strip()
    value = int(text) if _WHOLE.fullmatch(text) else MAX_IPOC
    if value >= MAX_IPOC:
        raise TelegramError(f"{where} is {shown(text)}; it must be a whole number from 0 to 2^63 - 1")
    return value


def _bit(text: str, where: str) -> bool:
    text = text.strip().lower()
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    value = _number(text, where)
    if value not in (0.0, 1.0):
        raise TelegramError(f"{where} is {shown(text)}; it must be 0 or 1")
    return value == 1.0


def _attribute(element: TelegramElement, tag: str, name: str) -> str:
    found = element.attributes.get(name)
    if found is None:
        raise TelegramError(f"{tag} has no attribute {name}; it has {shown(', '.join(element.attributes))}")
    return found


def _element(telegram: Telegram, tag: str, entry: str = "") -> TelegramElement:
    found = telegram.elements.get(tag)
    if found is None:
        raise TelegramError(
            f"the telegram has no {tag}: add {entry or tag} to the Ethernet configuration of the controller"
        )
    return found


def _root(telegram: Telegram, root: str, kind: str) -> None:
    if telegram.root != root:
        raise TelegramError(f"the root element is {shown(telegram.root)}; it must be {root}")
    if telegram.type != kind:
        raise TelegramError(f"{root} has the Type {shown(telegram.type)}; it must be {kind}")


def _rob(telegram: Telegram, layout: TelegramLayout) -> RobState:
    _root(telegram, "Rob", ROB_TYPE)
    elements = telegram.elements
    _element(telegram, "AIPos", "DEF_AIPos")
    _check_axes(elements["AIPos"], layout)
    state = RobState(
        _whole(_element(telegram, "IPOC").text, "IPOC"), _positions(telegram, layout, "AIPos", "EIPos")
    )
    if "ASPos" in elements:
        state.setpoint = _positions(telegram, layout, "ASPos", "ESPos")
    if MONITOR in elements:
        state.correction = _positions(telegram, layout, MONITOR, MONITOR)
    if "Delay" in elements:
        state.delay = _whole(_attribute(elements["Delay"], "Delay", "D"), "Delay.D")
    if "RIst" in elements:
        pose = elements["RIst"]
        state.pose = tuple(_number(_attribute(pose, "RIst", name), f"RIst.{name}") for name in POSE)
    if STATE in elements:
        _read_state(elements[STATE], state)
    if OVERRIDE in elements:
        state.override = min(1.0, 1e-2 * abs(_number(elements[OVERRIDE].text.strip(), OVERRIDE)))
    if MODE in elements:
        state.mode = MODES.get(_whole(elements[MODE].text, MODE), "")
    state.inputs = _read_bits(telegram, IN, "i", len(layout.inputs))
    state.outputs = _read_bits(telegram, OUT, "o", len(layout.outputs))
    return state


def _check_axes(element: TelegramElement, layout: TelegramLayout) -> None:
    """Raise an error if the controller's axes differ from the model's."""
    for name, text in element.attributes.items():
        if name not in ROBOT_AXES:
            raise TelegramError(
                f"AIPos contains an unknown axis {shown(name)}; valid names: {', '.join(ROBOT_AXES)}"
            )
        if name not in layout.axes and _number(text, f"AIPos.{name}") != 0.0:
            raise TelegramError(
                f"axis {name} is at {shown(text)} degrees, but the model has no such joint: this is a "
                "different robot, or "
                "robot.backend.axes is wrong"
            )


def _positions(telegram: Telegram, layout: TelegramLayout, robot: str, external: str) -> tuple[float, ...]:
    found = []
    for axis, scale in zip(layout.axes, layout.scale, strict=True):
        tag = external if is_external(axis) else robot
        element = _element(telegram, tag, f"DEF_{tag}" if tag != MONITOR else MONITOR)
        found.append(_number(_attribute(element, tag, axis), f"{tag}.{axis}") / float(scale))
    return tuple(found)


def _read_state(element: TelegramElement, state: RobState) -> None:
    bits = {name: _bit(_attribute(element, STATE, name), f"{STATE}.{name}") for name in STATE_BITS}
    modes = [mode for mode in OPERATION_MODES if bits[mode]]
    if not modes:  # the context leaves this element unset
        return
    if len(modes) > 1:
        raise TelegramError(
            f"{STATE} reports that the operation mode is {' and '.join(modes)} at the same time: $T1, $T2, "
            "$AUT and $EXT are mapped to other outputs on this controller"
        )
    state.operation_mode, state.is_ready, state.is_stopped = modes[0], bits["Ready"], not bits["NoStop"]


def _read_bits(telegram: Telegram, tag: str, letter: str, count: int) -> tuple[bool, ...]:
    if not count:
        return ()
    element = _element(telegram, tag)
    names = [f"{letter}{number}" for number in range(1, count + 1)]
    return tuple(_bit(_attribute(element, tag, name), f"{tag}.{name}") for name in names)


def _sen(telegram: Telegram, layout: TelegramLayout) -> SenAnswer:
    _root(telegram, "Sen", layout.sen_type)
    corrections = [0] * len(layout.axes)
    for tag, joints in layout.corrections:
        element = _element(telegram, tag)
        for index in joints:
            axis = layout.axes[index]
            corrections[index] = round(MICRO * _number(_attribute(element, tag, axis), f"{tag}.{axis}"))
    return SenAnswer(
        _whole(_element(telegram, "IPOC").text, "IPOC"),
        tuple(corrections),
        _read_bits(telegram, OUT, "o", len(layout.outputs)),
    )


def validity(layout: TelegramLayout) -> Callable[[bytes], bool]:
    """Create a function that returns whether a packet may come from a controller described by `layout`."""
    return lambda packet: not isinstance(decode_rob(packet, layout), str)
