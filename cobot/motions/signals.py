"""Actions at points on the path of a motion, and conditions for its start, its progress and its end.

A request specifies points. `cobot.motions.signal_places` converts them to path times of a trajectory, because
rtloop uses only path times.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Literal, Protocol

from cobot.errors import InputError
from cobot.types import Scaling

Unit = Literal["distance_m", "time_s", "fraction"]


@dataclass(frozen=True, slots=True)
class PathPlace:
    """A point on the path of a motion.

    Attributes:
        unit: meaning of `value`: a length along the TCP path, m; a path time, s; or a share of the path's
            length.
        from_end: whether the point is measured back from the end of the path.
    """

    unit: Unit
    value: float
    from_end: bool = False

    def __str__(self) -> str:
        unit = {"distance_m": " m", "time_s": " s", "fraction": " of the path"}[self.unit]
        return f"{self.value:g}{unit} {'before the end' if self.from_end else 'after the start'}"


@dataclass(frozen=True, slots=True)
class Action:
    """An action at a point: set an output, report an event, or command the gripper.

    Attributes:
        field: the action's field in the request, for errors.
        output, value: the output to set, and its value; "" if the action sets none.
        event: the text of the event; "" if the action reports none.
        gripper: the gripper command as in the request; None if the action commands no gripper.
        stops_on_failure: whether the motion stops if the device rejects it.
    """

    field: str
    place: PathPlace
    output: str = ""
    value: float = 0.0
    event: str = ""
    gripper: Mapping[str, Any] | None = None
    stops_on_failure: bool = False

    @property
    def words(self) -> str:
        """The action as human-readable text."""
        if self.output:
            return f"set {self.output} to {self.value:g}"
        return f"gripper {self.gripper['command']}" if self.gripper else f"event {self.event!r}"


class Quantity(IntEnum):
    """The quantity that a condition compares."""

    NONE = 0  # there is no condition
    INPUT = 1
    FORCE = 2  # force that the surroundings exert at the TCP, N
    TORQUE = 3  # torque that the surroundings exert at the TCP, N·m
    JOINT = 4  # torque that the surroundings exert on a joint, N·m


@dataclass(frozen=True, slots=True)
class Condition:
    """A condition that rtloop evaluates in each cycle. It holds while the value is between `low` and `high`.

    Attributes:
        name: name of the input or of the joint.
        low, high: bounds of the value, exclusive. The value of a force or torque is its magnitude.
        edge: whether the condition holds only once the value has entered the bounds from outside.
        direction: direction of a force or torque, unit length; None means the magnitude in any direction.
        in_tool: whether the direction turns with the tool.
        joint: index of the joint.
        zero: value that is subtracted from the measured value: force and torque at the TCP, shape (6,), or
            the torque of the joint. None means the value that is measured when rtloop begins to evaluate the
            condition.
    """

    quantity: Quantity
    low: float
    high: float = math.inf
    name: str = ""
    edge: bool = False
    direction: tuple[float, float, float] | None = None
    in_tool: bool = False
    joint: int = 0
    zero: tuple[float, ...] | None = None

    @property
    def words(self) -> str:
        """The condition as human-readable text."""
        if self.quantity is Quantity.INPUT:
            where, unit = f"input {self.name}", ""
        elif self.quantity is Quantity.JOINT:
            where, unit = f"the external torque on {self.name}", " N·m"
        else:
            force = self.quantity is Quantity.FORCE
            axis = "" if self.direction is None else f" along {_vector(self.direction)}"
            frame = "" if self.direction is None else f" of the {'tool' if self.in_tool else 'base'}"
            where, unit = (
                f"the {'force' if force else 'torque'} at the TCP{axis}{frame}",
                " N" if force else "",
            )
            unit = unit or " N·m"
        if self.quantity is Quantity.INPUT and (self.low, self.high) in BOOLEANS:
            said = f"is {'true' if self.low > 0.0 else 'false'}"
        elif math.isinf(self.high):
            said = f"is above {self.low:g}{unit}"
        else:
            said = f"is below {self.high:g}{unit}"
        return f"{where} {said.replace('is ', 'becomes ', 1) if self.edge else said}"


TRUE, FALSE = BOOLEANS = ((0.5, math.inf), (-math.inf, 0.5))
"""The bounds for a boolean input that must be true, and for one that must be false."""


SLOWLY = Scaling(0.1)


@dataclass(frozen=True, slots=True)
class Until:
    """A condition that ends a motion.

    Attributes:
        fast: whether each joint stops as fast as its limits permit, so that the arm leaves its path;
            otherwise the arm stops on its path.
        retract_m: distance that the TCP then moves back, m.
        is_required: whether the motion fails if it reaches its goal before the condition is met.
        from_zero: whether forces are relative to the zero of `POST /robot/force/zero`.
        scaling: scaling of the motion back by `retract_m`.
    """

    condition: Condition
    fast: bool = False
    retract_m: float = 0.0
    is_required: bool = True
    from_zero: bool = False
    scaling: Scaling = SLOWLY


@dataclass(frozen=True, slots=True)
class PathSignals:
    """The actions and conditions of one motion."""

    actions: tuple[Action, ...] = ()
    start_when: Condition | None = None
    pause_while: Condition | None = None
    until: Until | None = None


NO_SIGNALS = PathSignals()


@dataclass(frozen=True, slots=True)
class PlacedAction:
    """An action and the path time at which it fires.

    Attributes:
        number: number of the action, starting at 1, unique in its motion.
    """

    number: int
    path_time_s: float
    action: Action


@dataclass(frozen=True, slots=True)
class Placed:
    """The actions and conditions of a trajectory.

    Attributes:
        actions: the actions in the order of their path times.
        pause_s: path times between which `pause_while` is evaluated.
        until_s: path time from which `until` is evaluated.
    """

    actions: tuple[PlacedAction, ...] = ()
    start_when: Condition | None = None
    pause_while: Condition | None = None
    pause_s: tuple[float, float] = (0.0, math.inf)
    until: Until | None = None
    until_s: float = 0.0

    @property
    def words(self) -> Iterator[str]:
        """All actions and conditions as human-readable text, one sentence each."""
        for name, condition in (("start_when", self.start_when), ("pause_while", self.pause_while)):
            if condition is not None:
                yield f"{name}: {condition.words}"
        for each in self.actions:
            yield f"{each.path_time_s:.3f} s: {each.action.words}"
        if self.until is not None:
            yield f"until: {self.until.condition.words}"


NO_PLACED = Placed()


class HasConditions(Protocol):
    """Interface of a motion that can have conditions. The type of the conditions does not matter. Missing
    conditions are None.
    """

    @property
    def start_when(self) -> object: ...
    @property
    def pause_while(self) -> object: ...
    @property
    def until(self) -> object: ...


def require_conditions(motions: Sequence[HasConditions], prefixes: Sequence[str]) -> None:
    """Reject conditions on motions that cannot have them. All given motions are parts of one trajectory.

    Args:
        prefixes: prefix of the fields of each motion, for errors.

    Raises:
        InputError: a condition is given for a motion that cannot have it.
    """
    pausing = 0
    for number, (motion, prefix) in enumerate(zip(motions, prefixes, strict=True), start=1):
        if motion.start_when is not None and number > 1:
            raise InputError(f"{prefix}start_when: only the first motion of a sequence may have it")
        pausing += motion.pause_while is not None
        if motion.pause_while is not None and pausing > 1:
            raise InputError(f"{prefix}pause_while: only one motion of a sequence may have it")
        if motion.until is not None and number < len(motions):
            raise InputError(f"{prefix}until: only the last motion of a sequence may have it")


def _vector(values: Sequence[float]) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in values) + ")"
