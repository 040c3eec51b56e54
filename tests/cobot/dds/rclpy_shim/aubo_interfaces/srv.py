"""aubo_interfaces.srv: whatever the package's .srv files define, by name."""

from typing import Any

from rclpy.types import service


def __getattr__(name: str) -> Any:
    if name.startswith("_"):
        raise AttributeError(name)
    return service(f"aubo_interfaces/srv/{name}")
