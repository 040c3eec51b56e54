"""Writes the maps of a study's results into its folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from cobot.robot.kept import keep
from cobot.studies.chunks import Columns, has_result
from cobot.studies.map_html import map_page
from cobot.studies.map_png import draw_map
from cobot.studies.results_folder import ResultsFolder
from cobot.studies.study import Study

PNG, HTML = "map.png", "map.html"
MAX_POINTS = 100_000
"""Maximum number of places in a page, which a browser can turn."""
SAMPLES = 200
METRICS = ("share", "manipulability", "redundancy")


def write_maps(
    study: Study, folder: ResultsFolder, answer: dict[str, object], columns: Columns
) -> list[Path]:
    """Write `map.png` and `map.html`, and return their paths; nothing if the results are no places.

    Raises:
        UnavailableError: the folder cannot be written.
    """
    if not study.maps or not columns or "share" not in columns:
        return []
    known = has_result(columns)
    columns = {name: values[known] for name, values in columns.items()}
    if not len(columns["x"]):
        return []
    places = np.column_stack([np.asarray(columns[axis], dtype=float) for axis in "xyz"])
    share = np.asarray(columns["share"], dtype=float)
    values = {name: np.where(share > 0.0, np.asarray(columns[name], dtype=float), np.nan) for name in METRICS}
    metrics = [study.metric_of_map, *(name for name in METRICS if name != study.metric_of_map)]
    picture = draw_map(places, values[study.metric_of_map], study.metric_of_map)
    every = -(-len(places) // MAX_POINTS)
    shown = {name: each[::every] for name, each in (dict(columns) | values).items()}
    if every > 1:
        answer = answer | {"shown here": f"one of {every} places"}
    page = map_page(study.question, answer, shown, metrics, _spacing(places))
    paths = [folder.path / PNG, folder.path / HTML]
    for path, content in zip(paths, (picture, page.encode()), strict=True):
        keep(path, content, "the map")
    return paths


def _spacing(places: np.ndarray) -> float:
    """Typical distance of neighbouring places, m."""
    if len(places) < 2:
        return 0.01
    some = places[:: max(1, len(places) // SAMPLES)]
    away, _ = cKDTree(places).query(some, k=2)
    return float(np.median(np.asarray(away)[:, 1])) or 0.01
