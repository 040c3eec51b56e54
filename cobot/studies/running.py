"""Runs a study on an executor, chunk by chunk, and writes the results into its folder."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cobot.errors import CobotError, UnavailableError
from cobot.foreign import plain_error
from cobot.studies.chunks import FAILURE, Columns, failures, from_bytes, has_result, to_bytes
from cobot.studies.engines.local_pool import LocalPool, LostWorkerError
from cobot.studies.orders import Filled, Order, fill
from cobot.studies.results.folder import ResultsFolder
from cobot.studies.study import Round, Study

CHUNK_S = 1.0
"""Target duration of the work in a chunk, s."""
GROWTH = 8
"""Maximum ratio between the sizes of consecutive chunks, because the first tasks may be unusual."""
IN_FLIGHT = 2
"""Number of chunks per worker that are submitted, so that no worker waits for the next one."""
TRIES = 3
"""Number of times that a worker may die with one task. After that, the task is given up."""
POLL_S = 0.2
DEATHS = ("KilledWorker", "LostWorkerError")
"""Names of the errors that executors raise if the worker computing a call has died."""


@dataclass(frozen=True, slots=True)
class Advance:
    """Progress of a run.

    Attributes:
        computed: number of tasks that this run has computed; `done` includes those of earlier runs.
        rate_hz: tasks per second of this run; 0 before the first chunk.
        left_s: estimated remaining time; infinite before the first chunk.
    """

    done: int
    tasks: int
    computed: int
    rate_hz: float
    left_s: float


@dataclass(frozen=True, slots=True)
class StudyResult:
    """The results that exist so far.

    Attributes:
        answer: the results by readable names. They are partial if not all tasks are done.
        computed: number of tasks that this run has computed.
        duration_s: duration of this run.
        kernel_share: time that the workers spent in tasks, as a share of their total time.
        lost: number of times that a worker died.
    """

    folder: Path
    table: Path | None
    answer: dict[str, Any]
    done: int
    tasks: int
    computed: int
    duration_s: float
    kernel_share: float
    lost: int

    @property
    def complete(self) -> bool:
        return self.done == self.tasks


@dataclass(slots=True)
class _Run:
    study: Study
    folder: ResultsFolder
    order: Order
    tasks: int
    workers: int
    size: int
    done: int = 0
    gaps: list[tuple[int, int]] = field(default_factory=list)
    computed: int = 0
    busy_s: float = 0.0
    lost: int = 0
    begin_s: float = field(default_factory=time.monotonic)
    tries: dict[tuple[int, int], int] = field(default_factory=dict)

    def next_range(self) -> tuple[int, int] | None:
        if not self.gaps:
            return None
        first, last = self.gaps.pop(0)
        if (first, last) in self.tries:  # not joined with other ranges, because a worker died with this one
            return first, last
        left = last - first + sum(end - begin for begin, end in self.gaps)
        size = min(self.size, math.ceil(left / self.workers), last - first)
        if first + size < last:
            self.gaps.insert(0, (first + size, last))
        return first, first + size

    def keep(self, first: int, last: int, filled: Filled) -> None:
        self.folder.add(first, last, filled.content)
        self.done += last - first
        self.computed += last - first
        self.busy_s += filled.busy_s
        wanted = round((last - first) * CHUNK_S / max(filled.busy_s, 1e-6))
        self.size = min(max(wanted, 1), GROWTH * max(self.size, last - first))

    def give_back(self, first: int, last: int, reason: BaseException) -> None:
        """Compute a range again after its worker has died. It is divided into halves, to find the task that
        kills workers.
        """
        self.lost += 1
        tries = self.tries.pop((first, last), 0) + 1
        if last - first > 1 and tries > 1:
            middle = (first + last) // 2
            self.gaps[:0] = [(first, middle), (middle, last)]
            self.tries |= {(first, middle): 1, (middle, last): 1}
        elif tries < TRIES:
            self.gaps.insert(0, (first, last))
            self.tries[first, last] = tries
        else:
            text = f"{TRIES} workers died with this task, the last one because {reason}"
            self.keep(first, last, Filled(to_bytes(failures(1, text)), 0.0))

    def advance(self) -> Advance:
        rate = self.computed / max(time.monotonic() - self.begin_s, 1e-9)
        left = (self.tasks - self.done) / rate if rate else math.inf
        return Advance(self.done, self.tasks, self.computed, rate, left)


def run_study(
    study: Study,
    folder: Path | str,
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    niceness: int = 0,
    report: Callable[[Advance], None] | None = None,
    cancel: threading.Event | None = None,
) -> StudyResult:
    """Compute the missing results in a folder, and compute the study's answer from all results.

    Args:
        folder: folder for the results. It is a new folder, or the folder of an earlier run of the same study.
        executor: executor that computes the tasks; None means a `LocalPool` for this run.
        workers: number of the executor's workers; None means one for each core of this computer.
        niceness: niceness of the workers of the `LocalPool`.
        report: called after each chunk, and at least five times a second.
        cancel: event. When it is set, the run ends with a partial answer.

    Raises:
        ForeignWorkerError: a worker has a different version of cobot or different files.
        UnavailableError: the folder cannot be written or the executor is broken; finished chunks are kept.
        CobotError: the study contradicts the robot or a file.
    """
    count = workers or len(os.sched_getaffinity(0))
    if executor is None:
        study.kernel()  # errors of the study appear here, in the caller's process
    order = Order.of(study)
    results = ResultsFolder(folder)
    with results.writing(study, order):
        missing = sum(last - first for first, last in results.gaps(study.tasks))
        run = _Run(study, results, order, study.tasks, count, study.first_chunk, study.tasks - missing)
        if missing:
            with (
                _local_pool(min(count, missing), niceness)
                if executor is None
                else nullcontext(executor) as used
            ):
                _compute_rounds(run, used, report, cancel or threading.Event())
        duration_s = time.monotonic() - run.begin_s
        columns = results.columns()
        answer = answer_of(study, columns, run.tasks)
        table = results.write_results(answer, columns) if columns else None
    share = run.busy_s / max(duration_s * count, 1e-9)
    return StudyResult(
        results.path, table, answer, run.done, run.tasks, run.computed, duration_s, share, run.lost
    )


@contextmanager
def _local_pool(workers: int, niceness: int) -> Iterator[Executor]:
    """Context manager that provides a pool of processes. When the context ends, running calls are ended,
    because their results would be lost.
    """
    pool = LocalPool(workers, niceness)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def answer_of(study: Study, columns: Columns, tasks: int) -> dict[str, Any]:
    """The answer computed from the available results. It has only the progress if there are no results."""
    known = has_result(columns)
    answer: dict[str, Any] = {"done": len(known), "tasks": tasks}
    if not known.all():
        first = int(np.flatnonzero(~known)[0])
        answer |= {
            "failed tasks": int((~known).sum()),
            "first failure": f"task {int(columns['task'][first])}: {columns[FAILURE][first]}",
        }
    if known.any():
        answer |= study.answer({name: values[known] for name, values in columns.items()})
    return answer


def _compute_rounds(
    run: _Run, executor: Executor, report: Callable[[Advance], None] | None, cancel: threading.Event
) -> None:
    rounds = run.study.rounds()
    turn = next(rounds)
    while True:
        run.gaps = run.folder.gaps(turn.last, turn.first)
        _compute(run, executor, turn, report, cancel)
        if cancel.is_set():
            return
        try:
            turn = rounds.send({} if turn.points is None else run.folder.columns(turn.first, turn.last))
        except StopIteration:
            return


def _compute(
    run: _Run,
    executor: Executor,
    turn: Round,
    report: Callable[[Advance], None] | None,
    cancel: threading.Event,
) -> None:
    waiting: dict[Future[Filled], tuple[int, int]] = {}
    try:
        while not cancel.is_set():
            while len(waiting) < IN_FLIGHT * run.workers and (piece := run.next_range()):
                points = (
                    None
                    if turn.points is None
                    else turn.points[piece[0] - turn.first : piece[1] - turn.first]
                )
                waiting[executor.submit(fill, run.order, *piece, points)] = piece
            if not waiting:
                return
            for future in wait(waiting, POLL_S, FIRST_COMPLETED).done:
                _record_result(run, future, waiting.pop(future))
            if report is not None:
                report(run.advance())
    except BrokenExecutor as exc:
        raise UnavailableError(
            f"the executor is broken: {exc}; {run.done} of {run.tasks} tasks are kept in "
            f"{run.folder.path}; run the study again to continue"
        ) from exc
    finally:
        for future in waiting:
            future.cancel()


def _record_result(run: _Run, future: Future[Filled], piece: tuple[int, int]) -> None:
    try:
        filled = future.result()
    except BrokenExecutor:
        raise
    except Exception as exc:
        if isinstance(exc, CobotError) and not isinstance(exc, LostWorkerError):
            raise
        if type(exc).__name__ not in DEATHS:
            place = f"tasks {piece[0]} to {piece[1] - 1}"
            raise UnavailableError(f"a worker could not compute {place}: {plain_error(exc)}") from exc
        run.give_back(*piece, exc)
        return
    run.tries.pop(piece, None)
    first = not run.computed
    run.keep(*piece, filled)
    if first:  # reports a metric that does not exist here and not at the end
        answer_of(run.study, {"task": np.arange(*piece), **from_bytes(filled.content)}, run.tasks)
