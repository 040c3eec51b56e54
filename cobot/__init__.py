"""cobot: the library. `from cobot import Robot, Mode, CoordType` is the real-time client."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cobot.client import CoordType, Mode, Robot

__all__ = ["CoordType", "Mode", "Robot"]


def __getattr__(name: str) -> Any:
    """Import a name on first use, because rtloop also imports this package and does not need the client."""
    if name in __all__:
        return getattr(import_module("cobot.client"), name)
    raise AttributeError(f"module 'cobot' has no attribute {name!r}")
