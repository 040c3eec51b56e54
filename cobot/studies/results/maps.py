"""Writes the maps of a study's results into its folder."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from cobot.robot.kept import keep
from cobot.studies.chunks import Column, Columns, has_result
from cobot.studies.results.folder import ResultsFolder
from cobot.studies.results.map_html import map_page
from cobot.studies.results.map_png import draw_map
from cobot.studies.study import MAX_TASKS, Study

PNG, HTML = "map.png", "map.html"
MAX_POINTS = 100_000
"""Maximum number of places in a page, so that a browser can turn it."""
SAMPLES = 200
METRICS = ("share", "manipulability", "redundancy")


class MapColumns(NamedTuple):
    """The places of a map with their metrics. A metric is NaN at places that are not reached.

    Attributes:
        metrics: names of the columns that may colour the map. The chosen one is the first.
        every: the map shows one in this many places.
    """

    columns: Columns
    metrics: list[str]
    spacing_m: float
    every: int


def map_columns(study: Study, columns: Columns, max_points: int) -> MapColumns | None:
    """A map of a study's results with at most `max_points` places; None if the results have no places."""
    if not study.maps or not columns or "share" not in columns:
        return None
    known = has_result(columns)
    if not known.any():
        return None
    found: dict[str, Column] = {axis: np.asarray(columns[axis][known], dtype=float) for axis in "xyz"}
    share = np.asarray(columns["share"][known], dtype=float)
    for name in METRICS:
        found[name] = np.where(share > 0.0, np.asarray(columns[name][known], dtype=float), np.nan)
    spacing_m = _spacing(np.column_stack([found[axis] for axis in "xyz"]))
    every = -(-len(share) // max_points)
    metrics = [study.metric_of_map, *(name for name in METRICS if name != study.metric_of_map)]
    return MapColumns({name: each[::every] for name, each in found.items()}, metrics, spacing_m, every)


def write_maps(
    study: Study, folder: ResultsFolder, answer: dict[str, object], columns: Columns
) -> list[Path]:
    """Write `map.png` and `map.html`, and return their paths. If the results have no places, nothing is
    written.

    Raises:
        UnavailableError: the folder cannot be written.
    """
    whole, shown = (map_columns(study, columns, most) for most in (MAX_TASKS, MAX_POINTS))
    if whole is None or shown is None:
        return []
    places = np.column_stack([np.asarray(whole.columns[axis], dtype=float) for axis in "xyz"])
    chosen = whole.metrics[0]
    picture = draw_map(places, np.asarray(whole.columns[chosen], dtype=float), chosen)
    if shown.every > 1:
        answer = answer | {"shown here": f"one of {shown.every} places"}
    page = map_page(study.question, answer, shown.columns, shown.metrics, whole.spacing_m)
    paths = [folder.path / PNG, folder.path / HTML]
    for path, content in zip(paths, (picture, page.encode()), strict=True):
        keep(path, content, "the map")
    return paths


def _spacing(places: np.ndarray) -> float:
    """Typical distance between neighbouring places, m."""
    if len(places) < 2:
        return 0.01
    some = places[:: max(1, len(places) // SAMPLES)]
    away, _ = cKDTree(places).query(some, k=2)
    return float(np.median(np.asarray(away)[:, 1])) or 0.01
