"""Spaces of parameters. Oracles: itertools, scipy's distributions and designs."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
import scipy.stats
from study_functions import function_study

from cobot.errors import CobotError, ConfigError
from cobot.studies.parameters.spaces import Axis, ParameterSpace, seed_of


def space(samples: int | None = None, design: Any = "random", seed: int = 3, **axes: Any) -> ParameterSpace:
    return ParameterSpace.of({name: Axis(**axis) for name, axis in axes.items()}, samples, design, seed)


def test_a_grid_has_each_combination_once() -> None:
    points = space(a={"values": [1, 2]}, b={"low": 0, "high": 1, "count": 3}, c={"values": ["x", "y"]})
    expected = [dict(zip("abc", each, strict=True)) for each in itertools.product([1, 2], [0, 0.5, 1], "xy")]
    assert [points.at(task) for task in range(points.tasks)] == expected


def test_random_parameters_have_their_distributions() -> None:
    points = space(5000, u={"uniform": [2, 5]}, n={"normal": [1.0, 0.5]})
    assert scipy.stats.kstest(points.samples["u"], scipy.stats.uniform(2, 3).cdf).pvalue > 0.01
    assert scipy.stats.kstest(points.samples["n"], scipy.stats.norm(1.0, 0.5).cdf).pvalue > 0.01
    assert abs(np.corrcoef(points.samples["u"], points.samples["n"])[0, 1]) < 0.05


def test_the_samples_are_the_same_at_each_point_of_the_grid_and_depend_on_the_seed() -> None:
    first = space(3, a={"values": [0, 1]}, u={"uniform": [0, 1]})
    rows = [first.at(task)["u"] for task in range(6)]
    assert rows[:3] == rows[3:]
    assert rows == [space(3, a={"values": [0, 1]}, u={"uniform": [0, 1]}).at(task)["u"] for task in range(6)]
    assert rows != [
        space(3, seed=4, a={"values": [0, 1]}, u={"uniform": [0, 1]}).at(task)["u"] for task in range(6)
    ]


@pytest.mark.parametrize("design", ["sobol", "halton", "latin"])
def test_designs_are_those_of_scipy_and_more_even_than_chance(design: Any) -> None:
    points = space(64, design, a={"uniform": [0, 1]}, b={"uniform": [0, 1]})
    rows = np.column_stack([points.samples["a"], points.samples["b"]])
    class_ = {"sobol": "Sobol", "halton": "Halton", "latin": "LatinHypercube"}[design]
    theirs = getattr(scipy.stats.qmc, class_)(2, rng=np.random.default_rng(3)).random(64)
    np.testing.assert_allclose(rows, theirs, atol=1e-12)
    chance = scipy.stats.qmc.discrepancy(np.random.default_rng(0).random((64, 2)))
    assert scipy.stats.qmc.discrepancy(rows) < chance


def test_each_task_has_a_seed_of_its_own() -> None:
    seeds = {seed_of(seed, task) for seed in range(3) for task in range(1000)}
    assert len(seeds) == 3000
    assert all(0 <= each < 2**63 for each in seeds)
    assert seed_of(1, 2) == seed_of(1, 2)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (
            {"space": {"a": {"values": [1], "uniform": [0, 1]}}},
            "space.a: must have one of: .*; got values, uniform",
        ),
        ({"space": {"a": {}}}, "space.a: must have one of: .*; got nothing"),
        ({"space": {"a": {"low": 0, "high": 1}}}, "space.a: must have one of"),
        ({"space": {"a": {"uniform": [1, 0]}}}, "uniform: low is 1; it must be at most high, 0"),
        ({"space": {"a": {"normal": [0, -1]}}}, "the standard deviation is -1; it must not be negative"),
        ({"space": {"a": {"vales": [0]}}}, r"unknown key 'vales' \(did you mean 'values'\?\)"),
        ({"design": "sobl"}, "design: must be"),
        ({"confidence": 1.0}, "confidence: must be less than 1, got 1.0"),
    ],
)
def test_a_bad_space_names_the_parameter(more: dict[str, Any], message: str, tmp_path: Any) -> None:
    with pytest.raises(ConfigError, match=message):
        function_study(tmp_path, **more)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"space": {"a": {"uniform": [0, 1]}}}, "samples: is missing, but a is random"),
        (
            {"space": {"a": {"uniform": [0, 1]}}, "samples": 100, "design": "sobol"},
            "is 100; .* such as 64 or 128",
        ),
        (
            {"space": {n: {"low": 0, "high": 1, "count": 99_999} for n in "ab"}},
            "space: has 9999800001 points, allowed: 100000000",
        ),
    ],
)
def test_a_space_without_a_sensible_number_of_points_is_rejected(
    more: dict[str, Any], message: str, tmp_path: Any
) -> None:
    with pytest.raises(CobotError, match=message):
        _ = function_study(tmp_path, **more).tasks
