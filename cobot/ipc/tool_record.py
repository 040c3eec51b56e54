"""The tool in shared memory, as far as rtloop needs it."""

from __future__ import annotations

from typing import Any

import numpy as np

from cobot.robot.tool import Tool


def fill(record: np.ndarray, tool: Tool) -> None:
    """Write a tool into a record of `cobot.ipc.layout.TOOL`."""
    record["version"], record["mass"], record["centre"] = tool.version, tool.mass, tool.centre
    for name in ("inertia", "tcp", "gravity"):
        value = getattr(tool, name)
        record[name] = np.nan if value is None else value


def tool_of(record: np.ndarray) -> Tool:
    """Read a tool from a record, without its name and shapes.

    Raises:
        ValueError: the record is invalid; `cobot.robot.tool.check_tool` checks the rest.
    """
    fields: dict[str, Any] = {}
    for name in ("inertia", "tcp", "gravity"):
        values = record[name].tolist()
        fields[name] = None if np.isnan(values).all() else tuple(values)
    mass, centre = float(record["mass"]), tuple(record["centre"].tolist())
    return Tool(version=int(record["version"]), mass=mass, centre=centre, **fields)
