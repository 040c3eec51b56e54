"""Runs of studies. Oracles: the function itself, called in a loop; the bytes of the files of two runs."""

from __future__ import annotations

import errno
import json
import os
import random
import sqlite3
import threading
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joblib.externals.loky import get_reusable_executor
from study_functions import function_study, reach_study

import cobot.studies.results.tables
from cobot.errors import CobotError, ConflictError, InputError, UnavailableError
from cobot.studies import Advance, ForeignWorkerError, LocalPool, ResultsFolder, run_study
from cobot.studies.orders import Order, fill
from cobot.studies.results.folder import CHUNKS


@pytest.fixture(autouse=True)
def _without_duckdb(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cobot.studies.results.tables, "find_spec", lambda name: None)


class Shuffled(ThreadPoolExecutor):
    """Computes the calls in a random order."""

    def __init__(self, seed: int) -> None:
        super().__init__(1)
        self._random, self._held = random.Random(seed), []  # type: ignore[var-annotated]

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self._held.append((future, fn, args))
        if len(self._held) >= 3:
            self._random.shuffle(self._held)
        super().submit(self._one)
        return future

    def _one(self) -> None:
        future, fn, args = self._held.pop()
        future.set_result(fn(*args))


def files_of(folder: Path) -> dict[str, bytes]:
    """All files of results but the chunks, whose borders depend on the speed."""
    return {
        path.name: path.read_bytes() for path in folder.iterdir() if path.is_file() and path.name != ".lock"
    }


def test_the_results_are_those_of_a_loop(tmp_path: Path) -> None:
    result = run_study(function_study(tmp_path), tmp_path / "out", executor=ThreadPoolExecutor(2))
    assert (result.done, result.tasks, result.complete) == (20, 20, True)
    with closing(sqlite3.connect(tmp_path / "out" / "results.sqlite")) as table:
        rows = table.execute("SELECT task, a, b, value, even, name FROM results ORDER BY task").fetchall()
    loop = [(a, b) for a in range(5) for b in range(4)]
    assert rows == [(i, a, b, a * b, a % 2 == 0, f"{a} x {b}") for i, (a, b) in enumerate(loop)]
    assert result.answer["best value"] == 12.0
    assert result.answer["at"] == "a 4, b 3"


@pytest.mark.parametrize("seed", range(3))
def test_any_order_gives_the_same_bytes(seed: int, tmp_path: Path) -> None:
    study = function_study(tmp_path, "draws", space={"a": {"uniform": [0, 1]}}, samples=40, seed=5)
    run_study(study, tmp_path / "first", executor=ThreadPoolExecutor(1))
    with Shuffled(seed) as executor:
        run_study(study, tmp_path / "second", executor=executor, workers=4)
    assert files_of(tmp_path / "first") == files_of(tmp_path / "second")


def test_any_number_and_kind_of_workers_gives_the_same_bytes(tmp_path: Path) -> None:
    study = reach_study()
    run_study(study, tmp_path / "threads", executor=ThreadPoolExecutor(1))
    run_study(study, tmp_path / "local", workers=2)
    with ProcessPoolExecutor(1) as processes:
        run_study(study, tmp_path / "processes", executor=processes)
    assert files_of(tmp_path / "threads") == files_of(tmp_path / "local") == files_of(tmp_path / "processes")


def test_the_adapter_of_joblib_computes_the_same(tmp_path: Path) -> None:
    """The executor that docs/studies.md names, in processes of joblib's own."""
    study = reach_study()
    run_study(study, tmp_path / "threads", executor=ThreadPoolExecutor(1))
    with get_reusable_executor(max_workers=2) as executor:
        run_study(study, tmp_path / "joblib", executor=executor, workers=2)
    assert files_of(tmp_path / "joblib") == files_of(tmp_path / "threads")


def test_a_cancelled_run_answers_in_part_and_the_next_one_computes_the_rest(tmp_path: Path) -> None:
    study, cancel, seen = function_study(tmp_path, "slow"), threading.Event(), list[Advance]()

    def report(advance: Advance) -> None:
        seen.append(advance)
        if advance.done >= 3:
            cancel.set()

    with ThreadPoolExecutor(1) as executor:
        first = run_study(study, tmp_path / "out", executor=executor, report=report, cancel=cancel)
    assert 3 <= first.done < 20
    assert first.answer["done"] == first.done
    assert seen[-1].rate_hz > 0.0
    second = run_study(study, tmp_path / "out", executor=ThreadPoolExecutor(1))
    assert second.complete
    assert second.computed == 20 - first.done
    run_study(study, tmp_path / "whole", executor=ThreadPoolExecutor(1))
    assert files_of(tmp_path / "out") == files_of(tmp_path / "whole")


def test_a_complete_study_is_not_computed_again(tmp_path: Path) -> None:
    study = function_study(tmp_path)
    run_study(study, tmp_path / "out", executor=ThreadPoolExecutor(1))
    assert run_study(study, tmp_path / "out", executor=_Nobody()).computed == 0


class _Nobody(Executor):
    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        raise AssertionError("nothing is missing")


def test_a_damaged_chunk_is_computed_again(tmp_path: Path) -> None:
    study, out = function_study(tmp_path), tmp_path / "out"
    run_study(study, out, executor=ThreadPoolExecutor(1))
    before = files_of(out)
    chunk = sorted((out / CHUNKS).iterdir())[0]
    content = bytearray(chunk.read_bytes())
    content[len(content) // 2] ^= 1
    chunk.write_bytes(content)
    assert run_study(study, out, executor=ThreadPoolExecutor(1)).computed > 0
    assert files_of(out) == before


def test_a_task_that_raises_is_reported_and_the_others_go_on(tmp_path: Path) -> None:
    result = run_study(
        function_study(tmp_path, "fails_at_three"), tmp_path / "out", executor=ThreadPoolExecutor(1)
    )
    assert result.answer["failed tasks"] == 4
    assert result.answer["first failure"] == "task 12: ValueError: three is not allowed"
    assert result.answer["greatest"] == 7.0


@pytest.mark.thorough
def test_a_task_that_kills_its_workers_is_found_and_the_others_go_on(tmp_path: Path) -> None:
    result = run_study(function_study(tmp_path, "dies_at_three"), tmp_path / "out", workers=1)
    assert result.complete
    assert result.answer["failed tasks"] == 1
    assert result.answer["first failure"].startswith("task 13: 3 workers died with this task")
    columns = ResultsFolder(tmp_path / "out").columns()
    expected = [a + b for a in range(5) for b in range(4)]
    expected[13] = np.nan
    np.testing.assert_array_equal(columns["value"], expected)


def test_a_folder_keeps_the_results_of_one_study(tmp_path: Path) -> None:
    run_study(function_study(tmp_path), tmp_path / "out", executor=ThreadPoolExecutor(1))
    with pytest.raises(
        ConflictError, match=r"another study \(seed was null and is now 4\); give another --output"
    ):
        run_study(function_study(tmp_path, seed=4), tmp_path / "out", executor=ThreadPoolExecutor(1))
    with (tmp_path / "functions.py").open("a") as file:
        file.write("# changed\n")
    changed = Order.of(function_study(tmp_path)).contents
    assert changed.keys() >= {"cobot", "source of cobot", "numpy", "function"}


def test_another_question_about_the_same_results_is_the_same_study(tmp_path: Path) -> None:
    run_study(function_study(tmp_path), tmp_path / "out", executor=ThreadPoolExecutor(1))
    other = function_study(tmp_path, question="And now?", metric="even", confidence=0.5)
    result = run_study(other, tmp_path / "out", executor=_Nobody())
    assert result.complete
    assert "mean even" in result.answer
    assert ResultsFolder(tmp_path / "out").study().question == "And now?"


def test_a_metric_that_does_not_exist_is_reported_after_the_first_chunk(tmp_path: Path) -> None:
    study = function_study(tmp_path, "slow", metric="vale")
    with pytest.raises(InputError, match="metric: unknown result 'vale'"):
        run_study(study, tmp_path / "out", executor=ThreadPoolExecutor(1), workers=1)
    assert sum(last - first for first, last, _ in ResultsFolder(tmp_path / "out").chunks()) < 20


def test_results_of_two_kinds_are_an_error(tmp_path: Path) -> None:
    study = function_study(tmp_path, "mixed")
    with pytest.raises(
        InputError, match=r"result 'value': is a string in some (tasks|calls) and a number in others"
    ):
        run_study(study, tmp_path / "out", executor=ThreadPoolExecutor(1))


def test_two_runs_do_not_share_a_folder(tmp_path: Path) -> None:
    study = function_study(tmp_path)
    writing = ResultsFolder(tmp_path / "out").writing(study, Order.of(study))
    with writing, pytest.raises(ConflictError, match=r"process \d+ is computing this study"):
        run_study(study, tmp_path / "out", executor=ThreadPoolExecutor(1))


NAMES = ("cobot", "source of cobot", "compiled code of cobot", "function", "model of the robot", "scene")


@pytest.mark.parametrize("name", NAMES)
def test_a_worker_with_another_version_or_file_refuses_by_name(name: str, tmp_path: Path) -> None:
    study = reach_study() if " of the robot" in name or name == "scene" else function_study(tmp_path)
    order = Order.of(study)
    foreign = Order(order.document, order.folder, order.contents | {name: "other"}, "another key")
    with pytest.raises(ForeignWorkerError, match=f"has a different {name}: "):
        fill(foreign, 0, 1)


def test_a_broken_executor_keeps_what_is_finished(tmp_path: Path) -> None:
    study = function_study(tmp_path, "dies_at_three")
    with ProcessPoolExecutor(1) as executor, pytest.raises(UnavailableError, match="run the study again"):
        run_study(study, tmp_path / "out", executor=executor, workers=1)
    kept = sum(last - first for first, last, _ in ResultsFolder(tmp_path / "out").chunks())
    assert 0 < kept < 20


def test_a_full_disk_ends_the_run_and_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study, folder = function_study(tmp_path), ResultsFolder(tmp_path / "out")

    def replace(source: Path, target: Path) -> None:
        if target.parent.name == CHUNKS and _take(left) < 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        real(source, target)

    left, real = [2], os.replace
    monkeypatch.setattr(os, "replace", replace)
    with pytest.raises(UnavailableError, match=r"out/chunks/.*disk is full.* run the study again"):
        run_study(study, folder.path, executor=ThreadPoolExecutor(1), workers=1)
    monkeypatch.setattr(os, "replace", real)
    kept = sum(last - first for first, last, _ in folder.chunks())
    assert kept > 0
    assert run_study(study, folder.path, executor=ThreadPoolExecutor(1)).computed == 20 - kept


@pytest.mark.parametrize("name", ["manifest.json", "answer.json", "map.png", "results.sqlite"])
def test_files_that_are_not_of_a_study_are_not_replaced(name: str, tmp_path: Path) -> None:
    foreign = tmp_path / "out" / name
    foreign.parent.mkdir()
    foreign.write_text("{}")
    with pytest.raises(CobotError, match=f"out/{name}: (does not belong to|is not the manifest of) a study"):
        run_study(function_study(tmp_path), foreign.parent, executor=ThreadPoolExecutor(1))
    assert foreign.read_text() == "{}"
    if name != "manifest.json":
        assert list(foreign.parent.iterdir()) == [foreign], "nothing is added to a folder that is not ours"


def _take(left: list[int]) -> int:
    left[0] -= 1
    return left[0]


def test_a_folder_without_results_is_an_error_with_advice(tmp_path: Path) -> None:
    with pytest.raises(CobotError, match=r"manifest.json: there is no such file; give a folder"):
        ResultsFolder(tmp_path).study()
    (tmp_path / "manifest.json").write_text(json.dumps({"format": 99}))
    with pytest.raises(CobotError, match="has format 99, but this cobot reads the format 1"):
        ResultsFolder(tmp_path).study()


def test_the_pool_of_a_run_may_be_the_callers(tmp_path: Path) -> None:
    with LocalPool(2) as pool:
        assert run_study(function_study(tmp_path), tmp_path / "one", executor=pool, workers=2).complete
        assert run_study(function_study(tmp_path), tmp_path / "two", executor=pool, workers=2).complete
