"""The gripper protocol. One class drives one kind of device.

The class has these attributes: `Options`, its options; `sdk`, a module that its instances import; and
`contract_rig`, the simulated device on which the contract runs (`cobot.grippers.contract`).
docs/your-gripper.md is the guide.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from numbers import Real
from types import MappingProxyType
from typing import Annotated, Any, Literal, Protocol

from pydantic import BaseModel, ConfigDict, Field

from cobot.strict import shown

Range = tuple[float, float]
NO_OBJECT = ("none", "lost")
MAX_VALUE = 1e6
"""Largest width, force or temperature that is accepted as a measured value."""


class GripperError(Exception):
    """Raised if the device does not answer, rejects a request or reports a fault. The text is shown to the
    user as the reason.
    """


class HeldObject(StrEnum):
    """The object in the fingers. INSIDE: the fingers close on it; OUTSIDE: they open inside a hollow
    object.
    """

    NONE = "none"
    HELD_INSIDE = "held_inside"
    HELD_OUTSIDE = "held_outside"
    LOST = "lost"

    @property
    def is_held(self) -> bool:
        return self.value not in NO_OBJECT


class PowerLoss(StrEnum):
    """What the fingers do when the gripper loses power."""

    KEEPS = "keeps"
    OPENS = "opens"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class GripperCapabilities:
    """The capabilities of a gripper. A request that needs a missing capability is rejected; the error names
    the capability.

    Attributes:
        width_m: the smallest and the largest width between the fingers, m. None for a gripper without a
            width, such as a suction cup, which only grasps and releases.
        force_n: the forces that can be commanded, N; None means that the force is fixed.
        speed_m_s: the speeds that can be commanded, m/s; None means that the speed is fixed.
        object_detection: whether `GripperState.object` is known.
        continuous: whether any width within `width_m` can be commanded; otherwise only its two ends.
        on_power_loss: the reaction of the fingers if the gripper loses its power.
        hardware: whether the driver moves real fingers.
    """

    width_m: Range | None
    force_n: Range | None = None
    speed_m_s: Range | None = None
    object_detection: bool = False
    continuous: bool = True
    on_power_loss: PowerLoss = PowerLoss.UNKNOWN
    hardware: bool = True

    def __post_init__(self) -> None:
        """
        Check the ranges.

        Raises:
            ValueError: a range is empty or contains values below 0.
        """
        for name in ("width_m", "force_n", "speed_m_s"):
            bounds = getattr(self, name)
            if bounds is not None and not 0.0 <= bounds[0] < bounds[1]:
                raise ValueError(f"{name}: {bounds} is not a range of numbers of 0 or more")

    @property
    def words(self) -> str:
        """The capabilities as human-readable text."""
        force = "a fixed force" if self.force_n is None else f"{self.force_n[0]:g} to {self.force_n[1]:g} N"
        detects = "detects objects" if self.object_detection else "does not detect objects"
        if self.width_m is None:
            how = "grasps and releases, without a width"
        else:
            least, most = self.width_m
            way = "any width" if self.continuous else "open or closed"
            how = f"{way} from {1e3 * least:g} to {1e3 * most:g} mm"
        return f"{how}, {force}, {detects}, power loss: {self.on_power_loss}"


@dataclass(frozen=True, slots=True)
class GripperState:
    """The state of a gripper. None means that the gripper does not know the value.

    Attributes:
        width: width between the fingers, m.
        commanded_width: width of the last command, m.
        force: force at the fingers, N.
        moving: whether a command is running. It must be true as soon as the command has returned.
        object: how the fingers hold an object; None if the gripper does not detect objects.
        temperature: temperature, °C.
        fault: the fault of the device, as text; "" for none.
        ages_s: additional age of values that are older than the state, by name, s.
    """

    width: float | None
    commanded_width: float | None
    moving: bool
    force: float | None = None
    object: HeldObject | None = None
    temperature: float | None = None
    fault: str = ""
    ages_s: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        """
        Check the types and the numbers.

        Raises:
            TypeError: a value has the wrong type.
            ValueError: a number is not finite, or too large for a measured value.
        """
        for name in ("width", "commanded_width", "force", "temperature"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _measured(name, getattr(self, name)))
        if self.moving not in (False, True):
            raise TypeError(f"moving is {shown(self.moving)}; it must be True or False")
        object.__setattr__(self, "moving", bool(self.moving))
        if self.object is not None and not isinstance(self.object, HeldObject):
            raise TypeError(f"object is {shown(self.object)}; it must be a HeldObject or None")
        for text in (self.fault, *self.ages_s):
            if not isinstance(text, str):
                raise TypeError(f"fault or a key of ages_s is {shown(text)}; it must be a string")
        ages_s = {name: _measured(f"ages_s, {name}", age_s) for name, age_s in self.ages_s.items()}
        object.__setattr__(self, "ages_s", MappingProxyType(ages_s))


def _measured(name: str, value: Any) -> float:
    """Convert a value from a device to a Python number. Raises TypeError or ValueError if this is
    impossible.
    """
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not is_number:
        raise TypeError(f"{name} is {shown(value)}; it must be a number; report None for an unknown value")
    if not -MAX_VALUE <= value <= MAX_VALUE:
        raise ValueError(
            f"{name} is {shown(value)}, allowed: -{MAX_VALUE:g} to {MAX_VALUE:g}; report None for an "
            "unknown value"
        )
    return float(value)


@dataclass(frozen=True, slots=True)
class Grasp:
    """A request to hold an object.

    Attributes:
        width: width of the object, m; None for any width. An object that is wider than the current width is
            held from inside.
        tolerance_inner, tolerance_outer: how much narrower, and how much wider, the object may be than
            `width`, m.
        speed, force: finger speed and force; None for the driver's default.
    """

    width: float | None
    tolerance_inner: float
    tolerance_outer: float
    speed: float | None = None
    force: float | None = None

    def permits(self, width: float) -> bool:
        """Whether an object of this width is the expected one."""
        if self.width is None:
            return True
        return self.width - self.tolerance_inner <= width <= self.width + self.tolerance_outer


class GripperOptions(BaseModel):
    """Base class of a gripper's `Options`: the keys of `robot.gripper` in addition to `type`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    on_stop: Annotated[
        Literal["keep", "open"],
        Field(
            description="Reaction of the gripper to a stop or an e-stop: keep the grip, or open the fingers."
        ),
    ] = "keep"
    on_loss: Annotated[
        Literal["stop", "continue"],
        Field(description="Reaction of the arm if an object is lost: stop, or continue."),
    ] = "stop"


class Now(Protocol):
    """Interface of a driver's clock: `cobot.clock.SYSTEM`, or the clock of a simulated device."""

    def now_s(self) -> float: ...


class IoPort(Protocol):
    """The inputs and outputs of the robot, by name in GET /robot/io. A driver uses them in its thread."""

    def read(self, name: str) -> float:
        """The last value that the robot has reported; 0 or 1 for a boolean.

        Raises:
            GripperError: the input or output does not exist, or the robot does not report it.
        """
        ...

    def set(self, name: str, value: float) -> None:
        """Set an output of the robot. The call may take some milliseconds.

        Raises:
            GripperError: the output does not exist, or the robot rejects the value.
        """
        ...


class Gripper(Protocol):
    """A gripper. The constructor is called with (options, port), and must not connect. A class that also
    needs the robot's settings defines `of_robot(settings, port)`, which is called instead of the
    constructor.

    A separate thread calls the methods, one at a time. Each method may wait for the device for some tenths of
    a second, and may raise a GripperError. A command returns when the device has accepted it, not when the
    motion ends. A new command replaces a running one. After a GripperError, `connect` is called again.

    `connect` and `disconnect` must not move the fingers, so that a held object is not dropped while cobot
    restarts.

    Attributes:
        capabilities: capabilities of this gripper with these options.
        state_period_s: interval between readings of the state while the fingers move or hold an object, s.
            Optional; the default is 0.01.
    """

    capabilities: GripperCapabilities

    def connect(self) -> None:
        """Connect to the device, and check that it is the right one."""
        ...

    def disconnect(self) -> None:
        """Close the connection. This may be called after an error, and more than once."""
        ...

    def open(self) -> None:
        """Open as far as possible."""
        ...

    def close(self) -> None:
        """Close as far as possible."""
        ...

    def move(self, width: float, speed: float | None, force: float | None) -> None:
        """Move to a width within the range in `capabilities`. If the speed or the force is None, its default
        is used.
        """
        ...

    def grasp(self, grasp: Grasp) -> None:
        """Grip an object and hold it."""
        ...

    def release(self, width: float | None) -> None:
        """Release the object: open to a width, or as far as possible."""
        ...

    def stop(self) -> None:
        """Stop the fingers at their current position. The grip on an object does not change."""
        ...

    def home(self) -> None:
        """Find the reference, or activate the device, if this is needed. The fingers may move."""
        ...

    def state(self) -> GripperState:
        """The current state."""
        ...
