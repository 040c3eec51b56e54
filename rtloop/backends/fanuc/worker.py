"""A thread for requests that take a few tenths of a second, so that the cycle never waits for them."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from cobot.launch.process import leave_real_time

ResultT = TypeVar("ResultT")


class RmiWorker:
    """Runs jobs one at a time, in a separate thread without real-time priority."""

    def __init__(self, *, threaded: bool = True) -> None:
        """
        Args:
            threaded: whether jobs run in the thread. If not, each runs at once, for tests in robot time.
        """
        self._executor = ThreadPoolExecutor(1, "fanuc-rmi", leave_real_time) if threaded else None

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
        """Drop all waiting jobs, and wait for the running one to end."""
        if self._executor is not None:
            self._executor.shutdown(wait=True, cancel_futures=True)
