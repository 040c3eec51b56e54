"""A map as one HTML file that needs no network. It shows points in 3D, which can be turned with the mouse."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cobot.studies.chunks import Columns
from cobot.studies.results.colours import SCALE, range_of
from cobot.types import Array

DIGITS = 5
"""Significant digits of the numbers in the file."""

_PAGE = Path(__file__).with_name("map_page.html")


def map_page(
    question: str, answer: Mapping[str, Any], columns: Columns, metrics: Sequence[str], spacing_m: float
) -> str:
    """The page of a map.

    Args:
        columns: x, y, z (m) and the metrics.
        metrics: columns that may colour the map. The chosen one is the first.
    """
    content = map_content(columns, metrics, spacing_m)
    parts = {
        "title": html.escape(question),
        "gradient": ", ".join("rgb({:.0f},{:.0f},{:.0f})".format(*colour) for colour in SCALE),
        "rows": "".join(
            f"<tr><td>{html.escape(name)}<td>{html.escape(_said(value))}" for name, value in answer.items()
        ),
        "options": "".join(f"<option>{html.escape(name)}" for name in metrics),
        "data": json.dumps(content, allow_nan=False).replace("</", "<\\/"),
    }
    page = _PAGE.read_text(encoding="utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], page)


def map_content(columns: Columns, metrics: Sequence[str], spacing_m: float) -> dict[str, Any]:
    """The points of a map as JSON, with the ranges and colours of their metrics; see `map_page`."""
    values = {name: np.asarray(columns[name], dtype=float) for name in metrics}
    data = {axis: _short(np.asarray(columns[axis], dtype=float)) for axis in "xyz"}
    return data | {
        "values": {name: _short(each) for name, each in values.items()},
        "ranges": {name: range_of(each) for name, each in values.items()},
        "scale": SCALE.tolist(),
        "spacing": spacing_m,
    }


def _short(values: Array) -> list[float | None]:
    return [float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None for value in values.tolist()]


def _said(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
