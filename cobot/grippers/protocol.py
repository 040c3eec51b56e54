"""The protocol of grippers: one class drives one kind of device.

The class has its options as `Options`, imports for its instances as `sdk`, and the simulated device on which
the contract runs as `contract_rig` (`cobot.grippers.contract`). docs/your-gripper.md is the guide.
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
"""Largest width, force or temperature that counts as a measured value."""


class GripperError(Exception):
    """A device does not answer, rejects a request or reports a fault; the user reads the text as the
    reason."""


class HeldObject(StrEnum):
    """What the fingers hold. INSIDE: they close on the object; OUTSIDE: they open inside a hollow one."""

    NONE = "none"
    HELD_INSIDE = "held_inside"
    HELD_OUTSIDE = "held_outside"
    LOST = "lost"

    @property
    def is_held(self) -> bool:
        return self.value not in NO_OBJECT


class PowerLoss(StrEnum):
    """What the fingers do when the gripper loses its power."""

    KEEPS = "keeps"
    OPENS = "opens"
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class GripperCapabilities:
    """The capabilities of a gripper. A request that needs a missing one is rejected, naming it.

    Attributes:
        width_m: the smallest and the largest width between the fingers, m; None: it has none, as a suction
            cup, and only grasps and releases.
        force_n: the forces that can be commanded, N; None: the force is fixed.
        speed_m_s: the speeds that can be commanded, m/s; None: the speed is fixed.
        object_detection: `GripperState.object` is known.
        continuous: any width within `width_m` can be commanded; otherwise only its two ends.
        on_power_loss: what the fingers do then.
        hardware: moves real fingers.
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
        Raises:
            ValueError: a range is empty or below 0.
        """
        for name in ("width_m", "force_n", "speed_m_s"):
            bounds = getattr(self, name)
            if bounds is not None and not 0.0 <= bounds[0] < bounds[1]:
                raise ValueError(f"{name}: {bounds} is not a range, from 0 on")

    @property
    def words(self) -> str:
        """The capabilities in words, for people."""
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
    """What a gripper reports; None: it does not know.

    Attributes:
        width: between the fingers, m.
        commanded_width: of the last command, m.
        force: at the fingers, N.
        moving: a command is under way. True from the moment at which the command has returned.
        object: None for a gripper that does not detect objects.
        temperature: °C
        fault: what is wrong with the device, in words; "" for nothing.
        ages_s: how much older than the state itself a value is, by its name, s; left out: 0.
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
        Raises:
            TypeError: a value has another type.
            ValueError: a number is not finite, or too large for a measured value.
        """
        for name in ("width", "commanded_width", "force", "temperature"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _measured(name, getattr(self, name)))
        if self.moving not in (False, True):
            raise TypeError(f"moving is {shown(self.moving)}, must be True or False")
        object.__setattr__(self, "moving", bool(self.moving))
        if self.object is not None and not isinstance(self.object, HeldObject):
            raise TypeError(f"object is {shown(self.object)}, must be a HeldObject or None")
        for text in (self.fault, *self.ages_s):
            if not isinstance(text, str):
                raise TypeError(f"fault or a key of ages_s is {shown(text)}, must be a string")
        ages_s = {name: _measured(f"ages_s, {name}", age_s) for name, age_s in self.ages_s.items()}
        object.__setattr__(self, "ages_s", MappingProxyType(ages_s))


def _measured(name: str, value: Any) -> float:
    """A value of a device as a number of Python. Raises TypeError or ValueError for any other value."""
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not is_number:
        raise TypeError(f"{name} is {shown(value)}, must be a number; report None for an unknown value")
    if not -MAX_VALUE <= value <= MAX_VALUE:
        raise ValueError(
            f"{name} is {shown(value)}, allowed is -{MAX_VALUE:g} to {MAX_VALUE:g}; report None for an "
            "unknown value"
        )
    return float(value)


@dataclass(frozen=True, slots=True)
class Grasp:
    """A request to hold an object.

    Attributes:
        width: of the object, m; None: any. One wider than the present width is held from inside.
        tolerance_inner, tolerance_outer: how much narrower and wider than `width` it may be, m.
        speed, force: None: the driver's default.
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
    """Base of a gripper's `Options`: the keys of `robot.gripper` in addition to `type`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    on_stop: Annotated[
        Literal["keep", "open"],
        Field(description="What a stop or an e-stop does: keep the grip, or open the fingers."),
    ] = "keep"
    on_loss: Annotated[
        Literal["stop", "continue"],
        Field(description="What the arm does when an object is lost: stop, or go on."),
    ] = "stop"


class Now(Protocol):
    """What a driver needs of a clock: `cobot.clock.SYSTEM`, or that of a simulated device."""

    def now_s(self) -> float: ...


class IoPort(Protocol):
    """The inputs and outputs of the robot, by name, as GET /robot/io has them. For a driver's thread."""

    def read(self, name: str) -> float:
        """The value that the robot has reported last; of a boolean 0 or 1.

        Raises:
            GripperError: there is no such input or output, or the robot does not report.
        """
        ...

    def set(self, name: str, value: float) -> None:
        """Hand an output to the robot; may wait for some milliseconds.

        Raises:
            GripperError: there is no such output, or the robot rejects the value.
        """
        ...


class Gripper(Protocol):
    """A gripper. The constructor is called with (options, port) and connects to nothing. A class that needs
    more of the settings than its options has `of_robot(settings, port)`, which is called instead.

    A thread that nothing else waits for calls the methods, one at a time. Each may wait for the device some
    tenths of a second, and may raise a GripperError. The commands return when the device has taken them, not
    when the fingers are there; a command replaces the one before. After a GripperError `connect` is called
    again.

    `connect` and `disconnect` move nothing: what is held stays held, also over a restart of cobot.

    Attributes:
        capabilities: of this gripper, with these options.
        state_period_s: how often the state is read while the fingers move or hold something; may be left out
            (0.01).
    """

    capabilities: GripperCapabilities

    def connect(self) -> None:
        """Connect to the device, and see that it is the right one."""
        ...

    def disconnect(self) -> None:
        """Let go of the connection; also after an error, and twice."""
        ...

    def open(self) -> None:
        """Open as far as possible."""
        ...

    def close(self) -> None:
        """Close as far as possible."""
        ...

    def move(self, width: float, speed: float | None, force: float | None) -> None:
        """Go to a width, within `capabilities`; None: the default."""
        ...

    def grasp(self, grasp: Grasp) -> None:
        """Go towards an object and hold it."""
        ...

    def release(self, width: float | None) -> None:
        """Let go: open to a width, or as far as possible."""
        ...

    def stop(self) -> None:
        """Stop the fingers where they are. The grip on an object stays."""
        ...

    def home(self) -> None:
        """Find the reference, activate, whatever the device needs once. The fingers may move."""
        ...

    def state(self) -> GripperState:
        """The present state."""
        ...
