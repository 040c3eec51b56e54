"""Values of inputs and outputs by GPIO/INTERFACE, and the messages of a GPIO controller that contain them."""

from __future__ import annotations

from collections.abc import Mapping

from cobot.dds.node import Message

GPIO = "control_msgs/msg/DynamicInterfaceGroupValues"


def values_of(message: Message) -> dict[str, float]:
    """The values that a message contains."""
    return {
        f"{group}/{name}": float(value)
        for group, interfaces in zip(message["interface_groups"], message["interface_values"], strict=False)
        for name, value in zip(interfaces["interface_names"], interfaces["values"], strict=False)
    }


def message_of(values: Mapping[str, float]) -> Message:
    """Create a message that contains these values."""
    groups: dict[str, Message] = {}
    for each, value in values.items():
        group, _, name = each.rpartition("/")
        interfaces = groups.setdefault(group, {"interface_names": [], "values": []})
        interfaces["interface_names"].append(name)
        interfaces["values"].append(value)
    return {"interface_groups": list(groups), "interface_values": list(groups.values())}
