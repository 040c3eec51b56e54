"""What results say. Oracles: scipy's intervals of a binomial share, NumPy's moments."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import scipy.stats
from study_functions import function_study

from cobot.errors import InputError
from cobot.studies.parameters.sampled import wilson


@pytest.mark.parametrize("tries", [1, 2, 7, 50, 10_000])
@pytest.mark.parametrize("confidence", [0.5, 0.9, 0.95, 0.999])
def test_the_interval_is_that_of_scipy(tries: int, confidence: float) -> None:
    for successes in {0, 1, tries // 3, tries // 2, tries - 1, tries}:
        test = scipy.stats.binomtest(successes, tries)
        theirs = test.proportion_ci(confidence_level=confidence, method="wilson")
        np.testing.assert_allclose(wilson(successes, tries, confidence), tuple(theirs), atol=1e-12)


def test_the_interval_contains_the_true_share_as_often_as_it_promises() -> None:
    random = np.random.default_rng(8)
    draws = random.binomial(80, 0.3, 4000)
    inside = [low <= 0.3 <= high for low, high in (wilson(int(each), 80, 0.9) for each in draws)]
    assert abs(np.mean(inside) - 0.9) < 0.025


def test_numbers_are_summed_up_with_the_best_point_of_the_grid(tmp_path: Path) -> None:
    study = function_study(tmp_path, goal="min", space={"a": {"values": [3, -2]}, "b": {"values": [1, 5]}})
    columns = {"task": np.arange(4), **study.kernel()(0, 4)}
    values = np.array([3, 15, -2, -10.0])
    answer = study.answer(columns)
    assert answer["mean value"] == pytest.approx(values.mean())
    assert answer["standard deviation"] == pytest.approx(values.std(ddof=1))
    assert (answer["least"], answer["greatest"]) == (-10.0, 15.0)
    assert (answer["best value"], answer["at"]) == (-10.0, "a -2, b 5")


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("more", [{}, {"search": {"trials": 4}}])
def test_tasks_without_a_finite_value_are_counted_and_never_the_best(
    value: float, more: dict[str, object], tmp_path: Path
) -> None:
    study = function_study(tmp_path, goal="max" if value > 0.0 else "min", **more)
    columns = {
        "task": np.arange(4),
        "a": np.zeros(4),
        "b": np.arange(4.0),
        "value": np.array([value, 5.0, 5.0, value]),
    }
    answer = study.answer(columns)
    assert (answer["tasks without a finite value"], answer["best value"]) == (2, 5.0)
    assert "tasks without a finite value" not in study.answer(columns | {"value": np.ones(4)})


def test_true_and_false_are_a_share_with_its_interval(tmp_path: Path) -> None:
    study = function_study(tmp_path, metric="even")
    answer = study.answer({"task": np.arange(20), **study.kernel()(0, 20)})
    assert answer["mean even"] == pytest.approx(0.6)
    assert re.fullmatch(r"1 \(1 of 1\), 95 % interval 0.2065 to 1", answer["even at a 0, b 0"])


def test_a_metric_that_the_function_does_not_return_is_an_error(tmp_path: Path) -> None:
    study = function_study(tmp_path, metric="vale")
    with pytest.raises(
        InputError, match=r"metric: unknown result 'vale' \(did you mean 'value'\?\); valid results: "
    ):
        study.answer({"task": np.arange(2), **study.kernel()(0, 2)})
    study = function_study(tmp_path, metric="name")
    with pytest.raises(InputError, match="metric: 'name' is a string; it must be a number, or true or false"):
        study.answer({"task": np.arange(2), **study.kernel()(0, 2)})
