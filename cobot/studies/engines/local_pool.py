"""A process pool that continues if a worker dies. It is a `concurrent.futures.Executor`.

`concurrent.futures.ProcessPoolExecutor` fails as a whole when one of its processes dies, and its processes
survive their parent. Here, if a worker dies, only the call that it was computing fails, and the worker is
replaced. Linux kills the workers when this process ends in any way. Workers are new interpreters, so they do
not import the caller's main module.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import signal
import socket
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from typing import Any, ParamSpec, TypeVar

from cobot.errors import UnavailableError, exhausted

MAX_STARTS_IN_A_ROW = 5
"""Number of workers in a row that may die before they have computed anything. After that, the pool gives
up.
"""
SINGLE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that limit the libraries of a worker to one core."""
READY = b"ready"
STDERR = 2
"""File descriptor of standard error."""

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class LostWorkerError(UnavailableError):
    """Raised if the process that was computing a call has died. The call may be repeated."""


@dataclass(slots=True)
class _Call:
    future: Future[Any]
    content: bytes
    begun: bool = False


@dataclass(slots=True)
class _Worker:
    process: subprocess.Popen[bytes]
    connection: Connection
    ready: bool = False
    call: _Call | None = field(default=None)


class LocalPool(Executor):
    """Processes on this computer.

    Args:
        workers: number of processes; None means one per core that this process may use.
        niceness: niceness of the workers, 0 to 19.

    Raises:
        ValueError: `workers` is not positive.
    """

    def __init__(self, workers: int | None = None, niceness: int = 0) -> None:
        self.workers = len(os.sched_getaffinity(0)) if workers is None else workers
        if self.workers < 1:
            raise ValueError(f"workers is {workers}; it must be 1 or more")
        self._niceness = niceness
        self._orders: queue.SimpleQueue[_Call | None] = queue.SimpleQueue()
        self._wake_reader, self._wake_writer = socket.socketpair()
        self._lock = threading.Lock()
        self._closing = False
        self._pids: list[int] = []
        self._failed_starts = 0
        self._broken: UnavailableError | None = None
        # The workers are children of this thread and die with it, so it lives as long as the pool.
        self._thread = threading.Thread(target=self._run, name="study workers", daemon=True)
        self._thread.start()

    @property
    def pids(self) -> list[int]:
        """Process ids of the current workers."""
        return list(self._pids)

    def submit(
        self, fn: Callable[Arguments, Result], /, *args: Arguments.args, **kwargs: Arguments.kwargs
    ) -> Future[Result]:
        """See `concurrent.futures.Executor`. The function is pickled by its name.

        Raises:
            RuntimeError: the pool has been shut down.
            UnavailableError: the workers of the pool cannot be started.
        """
        content = pickle.dumps((fn, args, kwargs))
        future: Future[Result] = Future()
        with self._lock:
            if self._broken is not None:
                raise self._broken
            if self._closing:
                raise RuntimeError("the pool has been shut down")
            self._orders.put(_Call(future, content))
        self._wake()
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """See `concurrent.futures.Executor`. With `cancel_futures`, running calls are also ended."""
        with self._lock:
            already, self._closing = self._closing, True
            if cancel_futures:
                self._orders.put(None)
        if not already or cancel_futures:
            self._wake()
        if wait:
            self._thread.join()

    def _wake(self) -> None:
        with contextlib.suppress(OSError):  # the thread has ended
            self._wake_writer.send(b"x")

    def _run(self) -> None:
        workers: list[_Worker] = []
        waiting: deque[_Call] = deque()
        try:
            self._serve(workers, waiting)
        finally:
            self._end(workers, waiting)

    def _serve(self, workers: list[_Worker], waiting: deque[_Call]) -> None:
        while True:
            if not self._take_orders(waiting):
                return
            for call in [call for call in waiting if not call.begun and call.future.cancelled()]:
                call.future.set_running_or_notify_cancel()
                waiting.remove(call)
            self._start_workers(workers, len(waiting))
            if self._broken is not None:
                return
            self._assign(workers, waiting)
            busy = any(worker.call for worker in workers)
            if self._closing and not waiting and not busy and self._orders.empty():
                return
            self._listen(workers)

    def _take_orders(self, waiting: deque[_Call]) -> bool:
        """Move new calls to `waiting`. Returns False if the pool must end immediately."""
        while True:
            try:
                call = self._orders.get_nowait()
            except queue.Empty:
                return True
            if call is None:
                return False
            waiting.append(call)

    def _start_workers(self, workers: list[_Worker], waiting: int) -> None:
        idle = sum(worker.call is None for worker in workers)
        for _ in range(min(self.workers - len(workers), waiting - idle)):
            if self._failed_starts >= MAX_STARTS_IN_A_ROW:
                self._broken = UnavailableError(
                    f"{self._failed_starts} worker processes in a row died before they computed anything; "
                    "their messages are on standard error"
                )
                return
            try:
                workers.append(self._start())
            except OSError as exc:
                self._broken = exhausted(exc) or UnavailableError(f"a worker cannot be started: {exc}")
                return
        self._pids = [worker.process.pid for worker in workers]

    def _start(self) -> _Worker:
        ours, theirs = socket.socketpair()
        with theirs:
            command = [
                *(sys.executable, "-P", "-m", "cobot.studies.engines.worker"),
                *(str(theirs.fileno()), str(os.getpid()), str(self._niceness)),
            ]
            environment = os.environ | dict.fromkeys(SINGLE_THREAD, "1")
            try:
                process = subprocess.Popen(
                    command,
                    pass_fds=[theirs.fileno()],
                    env=environment,
                    stdin=subprocess.DEVNULL,
                    stdout=STDERR,  # standard output is only for the answer, which may be JSON
                )
            except OSError:
                ours.close()
                raise
        return _Worker(process, Connection(ours.detach()))

    def _assign(self, workers: list[_Worker], waiting: deque[_Call]) -> None:
        for worker in workers:
            while worker.ready and worker.call is None and waiting:
                call = waiting.popleft()
                if not call.begun and not call.future.set_running_or_notify_cancel():
                    continue
                call.begun = True
                try:
                    worker.connection.send_bytes(call.content)
                    worker.call = call
                except OSError:  # the worker died while it was idle
                    worker.ready = False
                    waiting.appendleft(call)

    def _listen(self, workers: list[_Worker]) -> None:
        by_connection = {worker.connection: worker for worker in workers}
        for each in wait([self._wake_reader, *by_connection]):
            if each is self._wake_reader:
                self._wake_reader.recv(4096)
                continue
            worker = by_connection[each]  # type: ignore[index]
            try:
                content = worker.connection.recv_bytes()
            except (EOFError, OSError):
                workers.remove(worker)
                self._clean_up(worker)
                continue
            self._note(worker, content)
        self._pids = [worker.process.pid for worker in workers]

    def _note(self, worker: _Worker, content: bytes) -> None:
        if content == READY:
            worker.ready = True
            return
        self._failed_starts = 0
        call, worker.call = worker.call, None
        if call is None:
            return
        try:
            good, value = pickle.loads(content)
        except Exception as exc:  # noqa: BLE001 - whatever a foreign class raises while it is unpickled
            good, value = False, exc
        if good:
            call.future.set_result(value)
        else:
            call.future.set_exception(value)

    def _clean_up(self, worker: _Worker) -> None:
        worker.connection.close()
        worker.process.kill()
        status = worker.process.wait()
        call = worker.call
        if call is None:
            self._failed_starts += not worker.ready
            return
        how = f"signal {signal.Signals(-status).name}" if status < 0 else f"exit status {status}"
        call.future.set_exception(LostWorkerError(f"the worker process {worker.process.pid} died ({how})"))

    def _end(self, workers: list[_Worker], waiting: deque[_Call]) -> None:
        with self._lock:
            self._closing = True
        self._take_orders(waiting)
        error = self._broken
        for call in waiting:
            if error is None and not call.begun:
                call.future.cancel()
            if call.begun or call.future.set_running_or_notify_cancel():
                call.future.set_exception(error or LostWorkerError("the pool was shut down"))
        for worker in workers:
            worker.connection.close()
            worker.process.kill()
            worker.process.wait()
            if worker.call is not None:
                worker.call.future.set_exception(error or LostWorkerError("the pool was shut down"))
        self._pids = []
        self._wake_reader.close()
        self._wake_writer.close()
