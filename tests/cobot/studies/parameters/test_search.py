"""Searches. Oracles: Optuna's own studies, and an exhaustive grid."""

from __future__ import annotations

import threading
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learning_peers import need
from study_functions import function_study

from cobot.errors import CobotError, ConfigError
from cobot.studies import ResultsFolder, Study, run_study
from cobot.studies.parameters.search import OptunaSearch, SearchChoice
from cobot.studies.parameters.spaces import Axis

SPACE = {"a": {"uniform": [-2.0, 3.0]}, "b": {"uniform": [-1.0, 4.0]}}


@pytest.fixture
def optuna() -> Any:
    need("cmaes", "study")
    return need("optuna", "study")


def bowl(folder: Path, **more: Any) -> Study:
    choice = {"sampler": "tpe", "trials": 40, "batch": 8}
    return function_study(folder, "bowl", **({"space": SPACE, "goal": "min", "search": choice} | more))


@pytest.mark.parametrize("sampler", ["tpe", "cmaes", "random"])
def test_trials_are_those_of_optunas_own_study(sampler: Any, optuna: Any) -> None:
    def value(a: float, b: float) -> float:
        return float((a - 1.0) ** 2 + (b - 2.0) ** 2)

    axes = {name: Axis(**axis) for name, axis in SPACE.items()}
    ours = OptunaSearch(axes, SearchChoice(sampler=sampler, trials=30, batch=1), 5, "min")
    mine = []
    for _ in range(30):
        (point,) = ours.ask(1)
        mine.append(point)
        ours.tell([value(**point)])  # type: ignore[arg-type]
    samplers = optuna.samplers
    kinds = {"tpe": samplers.TPESampler, "cmaes": samplers.CmaEsSampler, "random": samplers.RandomSampler}
    theirs = optuna.create_study(sampler=kinds[sampler](seed=5))
    theirs.optimize(
        lambda trial: value(trial.suggest_float("a", -2.0, 3.0), trial.suggest_float("b", -1.0, 4.0)), 30
    )
    assert mine == [trial.params for trial in theirs.trials]


@pytest.mark.parametrize("sampler", ["tpe", "cmaes"])
def test_the_best_is_near_that_of_an_exhaustive_grid(sampler: str, tmp_path: Path, optuna: Any) -> None:
    study = bowl(tmp_path, search={"sampler": sampler, "trials": 120, "batch": 4})
    result = run_study(study, tmp_path / "out", executor=ThreadPoolExecutor(1))
    a, b = np.meshgrid(np.linspace(-2, 3, 201), np.linspace(-1, 4, 201))
    grid = (a - 1.0) ** 2 + (b - 2.0) ** 2 + 0.1 * np.sin(5.0 * a)
    assert result.answer["best value"] < grid.min() + 0.05
    where = np.unravel_index(grid.argmin(), grid.shape)
    assert abs(result.answer["at"]["b"] - b[where]) < 0.4


def test_workers_and_interruptions_do_not_change_a_search(tmp_path: Path, optuna: Any) -> None:
    study, cancel = bowl(tmp_path), threading.Event()
    first = run_study(study, tmp_path / "one", executor=ThreadPoolExecutor(1))
    run_study(
        study,
        tmp_path / "two",
        executor=ThreadPoolExecutor(1),
        report=lambda advance: cancel.set() if advance.done >= 13 else None,
        cancel=cancel,
    )
    assert 13 <= len(ResultsFolder(tmp_path / "two").columns()["task"]) < 40
    second = run_study(study, tmp_path / "two", workers=2)
    assert second.computed < 40
    assert second.answer == first.answer
    one, two = (ResultsFolder(tmp_path / name).columns() for name in ("one", "two"))
    assert all(np.array_equal(one[name], two[name], equal_nan=one[name].dtype.kind == "f") for name in one)


def test_failed_trials_are_not_the_best(tmp_path: Path, optuna: Any) -> None:
    study = function_study(
        tmp_path,
        "fails_at_three",
        space={"a": {"values": [1, 3]}, "b": {"values": [0]}},
        search={"trials": 12},
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = run_study(study, tmp_path / "out", executor=ThreadPoolExecutor(1))
    assert result.answer["at"] == {"a": 1.0, "b": 0.0}
    assert result.answer["failed tasks"] > 0


def test_the_goal_belongs_to_a_search(tmp_path: Path) -> None:
    """Because the trials depend on it; those of a grid do not."""
    from cobot.studies.orders import Order

    assert Order.of(bowl(tmp_path)).key != Order.of(bowl(tmp_path, metric="other")).key
    plain = {"search": None, "samples": 4}
    assert Order.of(bowl(tmp_path, **plain)).key == Order.of(bowl(tmp_path, metric="other", **plain)).key


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"search": {"trials": 0}}, "search.trials: must be greater than or equal to 1"),
        ({"search": {"sampler": "cma", "trials": 5}}, "search.sampler: must be 'tpe', 'cmaes' or 'random'"),
        ({"samples": 5}, "samples: has no effect in a search"),
    ],
)
def test_a_bad_search_names_the_key(more: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=message):
        bowl(tmp_path, **more)


def test_a_distribution_is_no_range(tmp_path: Path, optuna: Any) -> None:
    study = bowl(tmp_path, space={"a": {"normal": [0, 1]}, "b": {"values": [1]}})
    with pytest.raises(CobotError, match=r"space.a: is of kind normal; a search needs uniform"):
        run_study(study, tmp_path / "out", executor=ThreadPoolExecutor(1))


def test_without_optuna_a_search_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cobot.studies.parameters.search.find_spec", lambda name: None)
    with pytest.raises(CobotError, match=r"search needs optuna; install cobot\[study\]"):
        run_study(bowl(tmp_path), tmp_path / "out", executor=ThreadPoolExecutor(1))
