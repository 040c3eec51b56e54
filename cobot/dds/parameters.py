"""The node's parameters: the options in the vendor's manual, which `ros2 param` lists, gets and sets.

Parameters that are only used at the start can be read, but not set. The answer to an attempt gives the
reason.
"""

from __future__ import annotations

import math
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from cobot.dds.node import DdsNode, Message
from cobot.errors import CobotError
from cobot.ros.messages import ros_time

Value = bool | int | float | str
SEPARATOR = "."


class ParameterType(IntEnum):
    """The types of rcl_interfaces/msg/ParameterType."""

    NOT_SET = 0
    BOOL = 1
    INTEGER = 2
    DOUBLE = 3
    STRING = 4


FIELDS = {
    ParameterType.BOOL: "bool_value",
    ParameterType.INTEGER: "integer_value",
    ParameterType.DOUBLE: "double_value",
    ParameterType.STRING: "string_value",
}
KINDS: dict[type, ParameterType] = {
    bool: ParameterType.BOOL,
    int: ParameterType.INTEGER,
    float: ParameterType.DOUBLE,
    str: ParameterType.STRING,
}


@dataclass(slots=True)
class Parameter:
    """One parameter.

    Attributes:
        value: the current value. Its type is the type of the parameter.
        set_: function that applies a new value, or raises a CobotError. With None, the parameter cannot be
            set, and `fixed` is the reason.
        low, high: smallest and largest value of a number that can be set.
    """

    name: str
    value: Value
    doc: str
    set_: Callable[[Any], Awaitable[None]] | None = None
    fixed: str = ""
    low: float = -math.inf
    high: float = math.inf

    @property
    def kind(self) -> ParameterType:
        return KINDS[type(self.value)]

    @property
    def message(self) -> Message:
        """The parameter as rcl_interfaces/msg/Parameter."""
        return {"name": self.name, "value": {"type": int(self.kind), FIELDS[self.kind]: self.value}}

    @property
    def descriptor(self) -> Message:
        """The description of the parameter as rcl_interfaces/msg/ParameterDescriptor."""
        made: Message = {
            "name": self.name,
            "type": int(self.kind),
            "description": self.doc,
            "additional_constraints": self.fixed,
            "read_only": self.set_ is None,
        }
        if math.isfinite(self.low) and self.kind is ParameterType.INTEGER:
            made["integer_range"] = [{"from_value": int(self.low), "to_value": int(self.high), "step": 1}]
        elif math.isfinite(self.low) and self.kind is ParameterType.DOUBLE:
            made["floating_point_range"] = [{"from_value": self.low, "to_value": self.high}]
        return made

    def refusal(self, message: Message) -> str:
        """The reason why this parameter cannot be set to an rcl_interfaces/msg/ParameterValue; "" if it can
        be set.
        """
        if self.set_ is None:
            return f"{self.name} cannot be set while cobot runs: {self.fixed}"
        if message["type"] != self.kind:
            got = (
                ParameterType(message["type"]).name
                if message["type"] in list(ParameterType)
                else "another type"
            )
            return f"{self.name} is of type {self.kind.name}, got {got}"
        value = message[FIELDS[self.kind]]
        if self.kind in (ParameterType.INTEGER, ParameterType.DOUBLE) and not self.low <= value <= self.high:
            return f"{self.name} must be from {self.low:g} to {self.high:g}, got {value:g}"
        return ""


class Parameters:
    """Serves the parameters of a node as rclcpp and rclpy do."""

    def __init__(self, node: DdsNode, parameters: list[Parameter]) -> None:
        self._node = node
        self._all = {
            parameter.name: parameter for parameter in sorted(parameters, key=lambda each: each.name)
        }
        self._events = node.publisher("/parameter_events", "rcl_interfaces/msg/ParameterEvent", depth=1000)
        handlers = {
            "describe_parameters": ("DescribeParameters", self._describe),
            "get_parameter_types": ("GetParameterTypes", self._types),
            "get_parameters": ("GetParameters", self._get),
            "list_parameters": ("ListParameters", self._list),
            "set_parameters": ("SetParameters", self._set),
            "set_parameters_atomically": ("SetParametersAtomically", self._set_all),
        }
        for name, (type_, handler) in handlers.items():
            node.service(f"{node.name.full}/{name}", f"rcl_interfaces/srv/{type_}", handler)

    async def _list(self, request: Message) -> Message:
        prefixes = request["prefixes"]
        names = [
            name
            for name in self._all
            if not prefixes or any(name == each or name.startswith(each + SEPARATOR) for each in prefixes)
        ]
        return {"result": {"names": names, "prefixes": []}}

    async def _get(self, request: Message) -> Message:
        return {"values": [self._value(name) for name in request["names"]]}

    async def _types(self, request: Message) -> Message:
        return {"types": [self._value(name)["type"] for name in request["names"]]}

    async def _describe(self, request: Message) -> Message:
        known = [self._all.get(name) for name in request["names"]]
        return {
            "descriptors": [
                found.descriptor if found else {"name": name}
                for name, found in zip(request["names"], known, strict=True)
            ]
        }

    async def _set(self, request: Message) -> Message:
        return {"results": [await self._change([each]) for each in request["parameters"]]}

    async def _set_all(self, request: Message) -> Message:
        return {"result": await self._change(request["parameters"])}

    async def _change(self, asked: list[Message]) -> Message:
        """Set parameters. All are checked before the first one is set. Returns an
        rcl_interfaces/msg/SetParametersResult.
        """
        for each in asked:
            found = self._all.get(each["name"])
            if found is None:
                valid = ", ".join(self._all)
                return _result(f"there is no parameter {each['name']!r}; valid names: {valid}")
            reason = found.refusal(each["value"])
            if reason:
                return _result(reason)
        for each in asked:
            found = self._all[each["name"]]
            value = each["value"][FIELDS[found.kind]]
            try:
                if found.set_ is not None:
                    await found.set_(value)
            except CobotError as exc:
                return _result(str(exc))
            found.value = value
            self._tell(found)
        return _result("")

    def _tell(self, changed: Parameter) -> None:
        self._events.publish(
            {
                "stamp": ros_time(time.time_ns()),
                "node": self._node.name.full,
                "changed_parameters": [changed.message],
            }
        )

    def _value(self, name: str) -> Message:
        found = self._all.get(name)
        value: Message = found.message["value"] if found else {"type": int(ParameterType.NOT_SET)}
        return value


def _result(reason: str) -> Message:
    return {"successful": not reason, "reason": reason}
