"""A thread for requests that take some tenths of a second: the cycle never waits for them."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

ResultT = TypeVar("ResultT")


class RmiWorker:
    """Runs one job after the other, on a thread of its own."""

    def __init__(self, *, threaded: bool = True) -> None:
        """threaded: False runs each job at once, for tests in robot time."""
        self._executor = ThreadPoolExecutor(1, "fanuc-rmi") if threaded else None

    def begin(self, job: Callable[[], ResultT]) -> Future[ResultT]:
        if self._executor is not None:
            return self._executor.submit(job)
        done: Future[ResultT] = Future()
        try:
            done.set_result(job())
        except Exception as exc:  # noqa: BLE001 - as a thread passes on whatever a job raises
            done.set_exception(exc)
        return done

    def close(self) -> None:
        """Wait for the job that runs; the others are dropped."""
        if self._executor is not None:
            self._executor.shutdown(wait=True, cancel_futures=True)
