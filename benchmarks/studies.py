"""Studies: the share of a kernel's rate that a study reaches, and the cost of a task with many workers.

All figures are in processor time, so other programs on the computer hardly change them.
"""

from __future__ import annotations

import resource
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.table import Row, row
from cobot.studies import Study, run_study, study_of
from cobot.studies.chunks import as_columns, to_bytes
from cobot.studies.orders import Filled

TASK_S, WORKERS = 0.005, 100
"""Duration of a task and number of the simulated workers."""


def studies(places: int, tasks: int) -> Iterator[Row]:
    """A reach study on this computer, and a study of short tasks on workers whose tasks take no time."""
    study = _reach(places)
    bare_hz = _bare_rate(study)
    for workers in (1, 2):
        yield row(
            f"study of {study.tasks} places on {workers} {'core' if workers == 1 else 'cores'}",
            "",
            [_rate(study, workers)],
            "the bare kernel on one core",
            [bare_hz],
            columns=("tasks per second of processor time",),
            aim="90 %",
        )
    yield row(
        f"study on {WORKERS} simulated workers with tasks of {1e3 * TASK_S:g} ms",
        "",
        [1e6 * _cost_s(tasks)],
        f"what {WORKERS} workers leave for a task",
        [1e6 * TASK_S / WORKERS],
        columns=("µs per task of the coordinator",),
        aim="below",
    )


def _reach(places: int) -> Study:
    side = round(places ** (1.0 / 3.0))
    box = {"low": [-0.7, -0.7, 0.05], "high": [0.7, 0.7, 1.45]}
    space = {"box": box, "spacing_m": 1.4 / max(side - 1, 1)}
    return study_of({"question": "benchmark", "kind": "reach", "space": space, "spins": 4})


def _bare_rate(study: Study) -> float:
    kernel = study.kernel()
    kernel(0, 10)
    begin = time.process_time()
    kernel(0, study.tasks)
    return study.tasks / (time.process_time() - begin)


def _rate(study: Study, workers: int) -> float:
    """Tasks per second of CPU time for a whole run, including the start of the workers, the files and the
    table.
    """
    begin = _all_processes_s()
    with tempfile.TemporaryDirectory() as folder:
        result = run_study(study, Path(folder) / "out", workers=workers)
    return result.computed / (_all_processes_s() - begin)


def _all_processes_s() -> float:
    """CPU time of this process and of its children that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


class WorkersWithoutCost(Executor):
    """Answers immediately, and reports the time that a worker would have taken."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        _, first, last, _ = args
        content = to_bytes(as_columns({"value": np.arange(first, last, dtype=float)}, last - first))
        future: Future[Any] = Future()
        future.set_result(Filled(content, TASK_S * (last - first)))
        return future


def _cost_s(tasks: int) -> float:
    """The coordinator's time per task, including all files and the table."""
    space = {"x": {"low": 0.0, "high": 1.0, "count": tasks}}
    study = study_of({"question": "benchmark", "kind": "python", "function": "bisect:bisect", "space": space})
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        result = run_study(study, folder, executor=WorkersWithoutCost(), workers=WORKERS)
        assert result.complete
    return (time.process_time() - begin) / tasks
