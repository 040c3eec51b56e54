"""Conversion of a motion's actions and conditions into the types that the services take."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from app.robot_services import Services
from cobot.errors import CobotError, InputError, NotSupportedError
from cobot.motions.bodies import AnyMotion
from cobot.motions.conditions import InputTest, StepCondition
from cobot.motions.fields import Direction
from cobot.motions.requests import MIN_AXIS_LENGTH
from cobot.motions.signal_bodies import (
    PLACE_UNITS,
    ActionPlace,
    InputCondition,
    PathAction,
    UntilCondition,
)
from cobot.motions.signals import (
    FALSE,
    TRUE,
    Action,
    Condition,
    PathPlace,
    PathSignals,
    Quantity,
    Until,
)
from cobot.robot.io_points import IoKind, IoPoint, number_of, output_of
from cobot.strict import shown
from cobot.types import Scaling


def signals_of(body: AnyMotion, scaling: Scaling, services: Services) -> PathSignals:
    """Return the actions and conditions of a request.

    Args:
        scaling: scaling of the motion.

    Raises:
        InputError: an unknown input, output or joint, or an invalid value for it.
        NotSupportedError: the device cannot do it.
        UnavailableError: the device's inputs and outputs cannot be read.
    """
    reader = _Reader(services)
    if body.start_when is not None or body.pause_while is not None:
        reader.require_own_time("start_when" if body.start_when else "pause_while")
    if body.pause_while is not None and body.pause_while.edge is not None:
        raise InputError("pause_while.edge: an edge has no duration; give is, above or below")
    return PathSignals(
        tuple(reader.action(f"actions[{index}]", each) for index, each in enumerate(body.actions)),
        reader.input("start_when", body.start_when),
        reader.input("pause_while", body.pause_while),
        None if body.until is None else reader.until(body.until, scaling),
    )


def input_condition(services: Services, field: str, body: StepCondition) -> Condition:
    """Return a condition on an input.

    Raises:
        InputError, NotSupportedError, UnavailableError: see `signals_of`.
    """
    return _Reader(services).on_input(field, body.input, body)


class _Reader:
    """Reads the actions and conditions of a request for one robot."""

    def __init__(self, services: Services) -> None:
        self._services = services
        self._points: Sequence[IoPoint] | None = None

    def action(self, field: str, body: PathAction) -> Action:
        place, stops = _place(body.at), body.on_failure == "stop"
        if body.gripper is not None:
            return self._gripper(field, body.gripper, place)
        if body.set is None:
            return Action(field, place, event=body.event or "", stops_on_failure=stops)
        try:
            output = output_of(self.points(f"{field}.set"), body.set.output)
            value = number_of(output, body.set.value)
        except CobotError as exc:
            if isinstance(exc, InputError):
                raise InputError(f"{field}.set: {exc}") from exc
            raise
        return Action(field, place, body.set.output, value, stops_on_failure=stops)

    def _gripper(self, field: str, command: Mapping[str, Any], place: PathPlace) -> Action:
        try:
            self._services.path_gripper.check(command)
        except InputError as exc:
            raise InputError(f"{field}.gripper.{exc}") from exc
        except NotSupportedError as exc:
            raise exc.with_message(f"{field}.gripper: {exc}") from exc
        return Action(field, place, gripper=command)

    def input(self, field: str, body: InputCondition | UntilCondition | None) -> Condition | None:
        if body is None or body.input is None:
            return None
        return self.on_input(field, body.input, body)

    def on_input(self, field: str, name: str, body: InputTest) -> Condition:
        """Return the condition on the input with this name."""
        points = self.points(field)
        point = next((each for each in points if each.name == name), None)
        if point is None or point.is_output:
            known = ", ".join(each.name for each in points if not each.is_output) or "none"
            raise InputError(f"{field}.input: there is no input {shown(name)}; valid names: {known}")
        edge = getattr(body, "edge", None)
        low, high = self._bounds(field, body, edge, point)
        return Condition(Quantity.INPUT, low, high, name, edge=edge is not None)

    def until(self, body: UntilCondition, scaling: Scaling) -> Until:
        condition = self.input("until", body) or self._force(body)
        fast = body.stop == "fast"
        if fast and "stop" in body.model_fields_set:
            self.require_own_time("until.stop")
        return Until(
            condition,
            fast,
            body.retract,
            body.if_not_met == "error",
            body.relative_to == "zero" and condition.quantity is not Quantity.INPUT,
            scaling,
        )

    def points(self, field: str) -> Sequence[IoPoint]:
        """The device's inputs and outputs."""
        if self._points is None:
            backend, points = self._services.io.points()
            if points is None:
                raise NotSupportedError(f"{field}: the backend {backend} has no inputs and outputs")
            self._points = points
        return self._points

    def require_own_time(self, field: str) -> None:
        """Require that the real-time loop controls the motion. A device that executes whole motions itself
        cannot fire actions.
        """
        named = self._services.link.device()
        if named is not None and named[1].capabilities.trajectories:
            raise NotSupportedError(
                f"{field}: the backend {named[0]} executes whole motions by itself and supports "
                "only actions, and until with stop path"
            )

    def _bounds(self, field: str, body: InputTest, edge: str | None, point: IoPoint) -> tuple[float, float]:
        if point.kind is IoKind.BOOLEAN:
            if body.above is not None or body.below is not None:
                valid = " or ".join(test for test in body.TESTS if test not in ("above", "below"))
                raise InputError(f"{field}: {point.name} is boolean; give {valid}")
            wanted = body.is_ if edge is None else edge == "rising"
            return TRUE if wanted else FALSE
        if body.above is None and body.below is None:
            raise InputError(f"{field}: {point.name} is {point.kind}; give above or below")
        return (body.above, math.inf) if body.above is not None else (-math.inf, float(body.below or 0.0))

    def _force(self, body: UntilCondition) -> Condition:
        zero, limits = self._services.motion.force_zero, self._services.robot.limits
        if (force := body.force) is not None:
            zero.require_measured(Quantity.FORCE, "until.force")
            direction = _unit("until.force.direction", force.direction)
            return Condition(
                Quantity.FORCE, force.threshold, direction=direction, in_tool=force.frame == "tool"
            )
        torque = body.torque
        assert torque is not None
        if torque.joint is None:
            zero.require_measured(Quantity.TORQUE, "until.torque")
            direction = _unit("until.torque.direction", torque.direction)
            in_tool = torque.frame == "tool"
            return Condition(Quantity.TORQUE, torque.threshold, direction=direction, in_tool=in_tool)
        if torque.joint not in limits.names:
            valid = ", ".join(limits.names)
            raise InputError(
                f"until.torque.joint: there is no joint {shown(torque.joint)}; valid names: {valid}"
            )
        zero.require_measured(Quantity.JOINT, "until.torque")
        joint = limits.names.index(torque.joint)
        return Condition(Quantity.JOINT, torque.threshold, name=torque.joint, joint=joint)


def _place(body: ActionPlace) -> PathPlace:
    unit = next(name for name in PLACE_UNITS if getattr(body, name) is not None)
    return PathPlace(unit, getattr(body, unit), body.from_ == "end")


def _unit(field: str, direction: Direction | None) -> tuple[float, float, float] | None:
    """Return the direction, scaled to unit length."""
    if direction is None:
        return None
    length = math.hypot(direction.x, direction.y, direction.z)
    if not length > MIN_AXIS_LENGTH:
        raise InputError(
            f"{field}: the length is {length:g}; it must be above {MIN_AXIS_LENGTH:g} to give a direction"
        )
    return direction.x / length, direction.y / length, direction.z / length
