"""The record for the arm's load in shared memory, with the values that rtloop needs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cobot.robot.tool import Tool


def fill(record: np.ndarray, tool: Tool, mounted: Tool) -> None:
    """Write a load into a record of `cobot.ipc.layout.TOOL`.

    Args:
        tool: the tool with everything that the arm carries.
        mounted: the tool without the carried parts of a simulated cell.
    """
    record["version"], record["mass"], record["centre"] = tool.version, tool.mass, tool.centre
    record["mounted_mass"], record["mounted_centre"] = mounted.mass, mounted.centre
    for name in ("inertia", "tcp", "gravity"):
        record[name] = _or_nan(getattr(tool, name))
    record["mounted_inertia"] = _or_nan(mounted.inertia)


def load_of(record: np.ndarray) -> tuple[Tool, Tool]:
    """Read the two tools that `fill` has written into a record. They have neither names nor shapes.

    Raises:
        ValueError: the record is invalid. `cobot.robot.tool.check_tool` checks everything else.
    """
    fields = {name: _or_none(record[name]) for name in ("inertia", "tcp", "gravity")}
    tool = Tool(version=int(record["version"]), **_mass_of(record, ""), **fields)
    mounted = _mass_of(record, "mounted_") | {"inertia": _or_none(record["mounted_inertia"])}
    return tool, replace(tool, **mounted)


def _mass_of(record: np.ndarray, prefix: str) -> dict[str, Any]:
    mass, centre = record[f"{prefix}mass"], record[f"{prefix}centre"]
    return {"mass": float(mass), "centre": tuple(centre.tolist())}


def _or_nan(values: tuple[float, ...] | None) -> Any:
    return np.nan if values is None else values


def _or_none(values: np.ndarray) -> Any:
    return None if np.isnan(values).all() else tuple(values.tolist())
