"""Maps. Oracles: Pillow reads the PNG; Chromium runs the page's script (tests/e2e/test_studies.py)."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from study_functions import function_study, reach_study

from cobot.studies import ResultsFolder, run_study
from cobot.studies.results.colours import NOTHING, SCALE, colours_of, range_of
from cobot.studies.results.map_png import GLYPHS, draw_map
from cobot.studies.results.maps import write_maps


def pixels(content: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(content)).convert("RGB"))


def test_each_place_of_a_slice_has_its_colour() -> None:
    axes = np.meshgrid([0.0, 0.1, 0.2], [0.0, 0.1], [0.0, 0.5], indexing="ij")
    places = np.column_stack([axis.ravel() for axis in axes])
    values = np.where(places[:, 0] > 0.15, np.nan, places[:, 1] * 10.0)
    seen = pixels(draw_map(places, values, "share"))
    colours = {tuple(each) for each in seen.reshape(-1, 3)}
    assert {tuple(NOTHING), tuple(SCALE[0].astype(int)), tuple(SCALE[-1].astype(int))} <= colours
    # y points up: the yellow row, y = 0.1, is above the blue one.
    rows = np.nonzero((seen == SCALE[-1].astype(int)).all(axis=2))[0]
    low = np.nonzero((seen == SCALE[0].astype(int)).all(axis=2))[0]
    assert np.median(rows) < np.median(low)


@pytest.mark.parametrize("count", [1, 2, 3, 500])
def test_any_places_can_be_drawn(count: int) -> None:
    random = np.random.default_rng(count)
    seen = pixels(draw_map(random.normal(size=(count, 3)), random.random(count), "manipulability"))
    assert seen.shape[0] > 100


def test_values_are_coloured_in_order_and_unknown_ones_grey() -> None:
    colours = colours_of(np.array([0.0, 0.25, 0.5, 1.0, np.nan]), 0.0, 1.0)
    assert (np.diff(colours[:4].astype(float).sum(axis=1)) > 0).all()
    assert (colours[4] == NOTHING).all()
    assert range_of(np.array([np.nan])) == (0.0, 1.0)
    assert range_of(np.array([2.0, 2.0])) == (0.0, 2.0)


def test_the_characters_can_be_told_apart() -> None:
    assert len(set(GLYPHS.values())) >= len(GLYPHS) - 3  # o and 0, s and 5, z and 2 may look alike
    assert all(re.fullmatch("[0-7]{5}", rows) for rows in GLYPHS.values())


def test_the_page_has_the_places_and_cannot_be_broken_by_a_question(tmp_path: Path) -> None:
    study = reach_study(question="</script><script>alert(1)</script>")
    result = run_study(study, tmp_path / "out", workers=1)
    folder = ResultsFolder(tmp_path / "out")
    paths = write_maps(study, folder, result.answer, folder.columns())
    page = paths[1].read_text(encoding="utf-8")
    assert "<script>alert" not in page
    data = json.loads(re.search(r"const data = (.*);\n", page)[1])  # type: ignore[index]
    assert len(data["x"]) == result.tasks
    assert [value is not None for value in data["values"]["share"]] == (
        folder.columns()["reached"] > 0
    ).tolist()
    first = [path.read_bytes() for path in paths]
    write_maps(study, folder, result.answer, folder.columns())
    assert [path.read_bytes() for path in paths] == first


def test_a_page_has_no_more_places_than_a_browser_turns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = reach_study()
    folder = ResultsFolder(tmp_path / "out")
    result = run_study(study, folder.path, workers=1)
    monkeypatch.setattr("cobot.studies.results.maps.MAX_POINTS", 10)
    page = write_maps(study, folder, result.answer, folder.columns())[1].read_text(encoding="utf-8")
    data = json.loads(re.search(r"const data = (.*);\n", page)[1])  # type: ignore[index]
    assert len(data["x"]) <= 10
    assert "one of 5 places" in page
    assert data["spacing"] == pytest.approx(0.4)


def test_results_that_are_no_places_have_no_map(tmp_path: Path) -> None:
    study = function_study(tmp_path)
    columns = {"task": np.arange(3), **study.kernel()(0, 3)}
    assert write_maps(study, ResultsFolder(tmp_path), {}, columns) == []
