"""Keeps planning processes alive, and gives each one task at a time.

Each process has its own socket and shares no lock with other processes, so a stop, a timeout or another
program can kill it at any time. A process that has ended or is suspended is replaced; its task is lost, and
the caller gets an error. Times are on the event loop's clock, so changes of the system's clock have no
effect.
"""

from __future__ import annotations

import asyncio
import logging
import pickle
import signal
import socket
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from app.services.motion.planning_worker import HEAD, Task, TooLargeError, message
from cobot.errors import UnavailableError
from cobot.launch.forked import Forked
from cobot.launch.process import RUN_MODULE, is_stopped

WORKER = "app.services.motion.planning_worker"
STDOUT = 1
LARGE_BYTES = 2**18
"""Minimum size of a message that is pickled or unpickled in a thread, bytes. For smaller messages, switching
threads takes longer than that.
"""
LOOK_S = 0.5
"""Interval between checks whether busy workers are suspended, s."""
START_S = 60.0
"""Time after which a worker that is still not ready is replaced, s."""
BACKOFF_S = (0.2, 5.0)
"""First and longest pause before the next attempt to start a worker, if attempts fail, s."""

log = logging.getLogger("cobot.planning")


class WorkerLost(Exception):
    """Raised if the worker of a task has ended or is suspended. The text states which of the two.

    Attributes:
        begun: whether the worker had begun the task.
    """

    begun = False


class Preparation:
    """A task without an answer that a worker does once, before other tasks. It is pickled only once for all
    workers.
    """

    def __init__(self, task: Task) -> None:
        self._task: Task | None = task
        self._packed = b""

    async def pack(self) -> bytes:
        if self._task is not None:
            self._packed = await _pack(self._task, ahead=True)
            self._task = None
        return self._packed


@dataclass(eq=False)
class _Worker:
    """A planning process and the state of its current task.

    Attributes:
        prepared: the newest preparation that was sent to the process.
        preparing: whether the process is still carrying out this preparation.
        answer: future for the answer to the current task: whether the task returned a value or raised an
            error, and this value or error. None without a task.
        begun: whether the process has reported that it has begun the current task or its preparation.
        usable: whether the process has loaded its robot and is still running.
        dismissed: whether the pool itself has ended the process.
        paused: whether the process was suspended at the last check.
    """

    process: subprocess.Popen[bytes] | Forked
    writer: asyncio.StreamWriter
    prepared: Preparation | None = None
    preparing: bool = False
    answer: asyncio.Future[tuple[bool, Any]] | None = None
    begun: bool = False
    usable: bool = False
    dismissed: bool = False
    paused: bool = False

    def end(self) -> None:
        """Kill the worker. The pool then starts a new one."""
        self.usable = False
        self.process.kill()

    def prepare(self, ahead: Preparation, packed: bytes) -> None:
        """Send a preparation, unless the process already has it."""
        if self.prepared is not ahead:
            self.prepared, self.preparing = ahead, True
            self.writer.write(packed)

    def stands_still(self) -> bool:
        """Whether the process is suspended, and was also suspended at the last check."""
        before, self.paused = self.paused, is_stopped(self.process.pid)
        return before and self.paused


class PlanningPool:
    """A pool with a fixed number of workers, which are started with the first task.

    Args:
        arguments: the arguments of a worker's command line.
        blanks: processes that were started in advance and become the first workers. Processes that are used
            are removed from the list.

    Attributes:
        replaced: the number of workers that have ended or were suspended, without a request of the pool.
        problem: reason why the last start of a worker failed; "" if it succeeded.
    """

    def __init__(self, arguments: Sequence[str], size: int, blanks: list[Forked] | None = None) -> None:
        self.size = size
        self.replaced = 0
        self.problem = ""
        self._blanks = blanks if blanks is not None else []
        self._command = [*RUN_MODULE, WORKER, *arguments]
        self._workers: set[_Worker] = set()
        # LIFO, because the worker that was busy last is still in the processor's caches.
        self._idle: asyncio.LifoQueue[_Worker] = asyncio.LifoQueue()
        self._keepers: list[asyncio.Task[None]] = []

    @property
    def usable(self) -> int:
        """Number of workers that have a task or can get one."""
        return sum(worker.usable for worker in self._workers)

    @property
    def busy(self) -> int:
        """Number of workers that have a task."""
        return sum(worker.usable and worker.answer is not None for worker in self._workers)

    def start(self) -> None:
        """Start the workers, unless they have already been started."""
        if not self._keepers:
            self._keepers = [asyncio.create_task(self._keep()) for _ in range(self.size)]

    async def prepare(self, ahead: Preparation, workers: int) -> None:
        """Let idle workers prepare in advance, at most `workers` of them, in the order in which they get
        tasks. Does not wait for the preparations. A worker that is still preparing is skipped, so that
        preparations do not pile up.
        """
        packed = await ahead.pack()
        taken: list[_Worker] = []
        while len(taken) < workers and not self._idle.empty():
            worker = self._idle.get_nowait()
            if worker.usable:
                taken.append(worker)
        for worker in reversed(taken):
            if not worker.preparing:
                worker.prepare(ahead, packed)
            self._idle.put_nowait(worker)

    async def run(
        self, task: Task, timeout_s: float, asked_s: float | None = None, ahead: Preparation | None = None
    ) -> Any:
        """Run a task in a worker, and return its result or raise its error. If the call is cancelled, the
        worker is killed.

        Args:
            asked_s: start of the timeout, on the event loop's clock; None for now.
            ahead: preparation that the task needs. If it fails, its error is the task's error.

        Raises:
            TimeoutError: the task has taken too long. The error states how long it took until a worker was
                free.
            WorkerLost: the worker has ended or was suspended during the task.
            UnavailableError: no worker can be started, or no worker was free within the timeout.
        """
        loop = asyncio.get_running_loop()
        asked_s = loop.time() if asked_s is None else asked_s
        self.start()
        packed = await _pack(task)
        first = b"" if ahead is None else await ahead.pack()
        try:
            async with asyncio.timeout_at(asked_s + timeout_s):
                worker = await self._wait_for_worker()
        except TimeoutError:
            busy = f"all {self.usable} have other tasks"
            has = busy if self.usable else "the processes have not started yet"
            raise UnavailableError(f"no planning process was free within {timeout_s:g} s: {has}") from None
        waited_s = loop.time() - asked_s
        worker.answer, worker.begun = loop.create_future(), False
        try:
            async with asyncio.timeout_at(asked_s + timeout_s):
                if ahead is not None:
                    worker.prepare(ahead, first)
                worker.writer.write(packed)
                succeeded, found = await self._answer(worker)
        except BaseException as exc:
            worker.dismissed = not isinstance(exc, WorkerLost)
            worker.end()
            if isinstance(exc, TimeoutError):
                raise TimeoutError(f"{waited_s:.1f} s of this passed until a process was free") from None
            if isinstance(exc, WorkerLost):
                exc.begun = worker.begun
            raise
        finally:
            worker.answer = None
        self._idle.put_nowait(worker)
        if succeeded:
            return found
        raise found

    def close(self) -> None:
        """End all workers."""
        for keeper in self._keepers:
            keeper.cancel()
        for worker in self._workers:
            worker.dismissed = True
            worker.end()

    async def _wait_for_worker(self) -> _Worker:
        """Wait for an idle worker, and return it."""
        while True:
            try:
                async with asyncio.timeout(LOOK_S):
                    worker = await self._idle.get()
            except TimeoutError:
                if self.problem and not self.usable:
                    raise UnavailableError(self.problem) from None
                continue
            if worker.usable and not is_stopped(worker.process.pid):
                return worker
            worker.end()

    async def _answer(self, worker: _Worker) -> tuple[bool, Any]:
        assert worker.answer is not None
        while True:
            await asyncio.wait({worker.answer}, timeout=LOOK_S)
            if worker.answer.done():
                return worker.answer.result()
            if not worker.usable:
                raise WorkerLost(f"(pid {worker.process.pid}) has ended")
            if worker.stands_still():
                raise WorkerLost(f"(pid {worker.process.pid}) is suspended")

    async def _keep(self) -> None:
        """Keep one worker running until cancelled."""
        pause_s, longest_s = BACKOFF_S
        while True:
            try:
                was_usable = await self._live()
            except (OSError, RuntimeError) as exc:  # RuntimeError: no thread can be started
                was_usable = False
                self._fail(f"cannot be started: {getattr(exc, 'strerror', None) or exc}")
            pause_s = BACKOFF_S[0] if was_usable else min(2.0 * pause_s, longest_s)
            if not was_usable:
                await asyncio.sleep(pause_s)

    async def _live(self) -> bool:
        """Run one worker from its start to its end. Return whether it became usable.

        Raises:
            OSError: the worker cannot be started.
        """
        worker, reader = await self._start_worker()
        self._workers.add(worker)
        began = False
        try:
            async with asyncio.timeout(START_S):
                await _receive(reader)
            began = worker.usable = True
            self.problem = ""
            self._idle.put_nowait(worker)
            while True:
                is_ahead, packed = await _receive(reader)
                if is_ahead:
                    worker.preparing = False
                    continue
                if not packed:
                    worker.begun = True
                    continue
                large = len(packed) > LARGE_BYTES
                outcome = await asyncio.to_thread(_outcome, packed) if large else _outcome(packed)
                if worker.answer is not None and not worker.answer.done():
                    worker.answer.set_result(outcome)
        except (asyncio.IncompleteReadError, OSError):  # the worker has ended, or has failed to start
            worker.end()
            while worker.process.poll() is None:
                await asyncio.sleep(0.01)
            self._note_end(worker, began)
            return began
        finally:
            self._workers.discard(worker)
            worker.end()
            worker.writer.close()
            worker.process.wait()

    async def _start_worker(self) -> tuple[_Worker, asyncio.StreamReader]:
        ours, theirs = socket.socketpair()
        with theirs:
            try:
                process = self._launch(theirs.fileno())
            except OSError:
                ours.close()
                raise
        try:
            reader, writer = await asyncio.open_unix_connection(sock=ours, limit=2**20)
        except BaseException:
            process.kill()
            process.wait()
            raise
        return _Worker(process, writer), reader

    def _launch(self, descriptor: int) -> subprocess.Popen[bytes] | Forked:
        """Start a worker process, which inherits the worker's end of the socket."""
        command = [*self._command, "--fd", str(descriptor)]
        while self._blanks:
            blank = self._blanks.pop()
            if blank.become(command, STDOUT, (descriptor,), {}):
                return blank
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            pass_fds=(descriptor,),
            start_new_session=True,  # not in the service's session, which has priority over others: see `be`
        )

    def _note_end(self, worker: _Worker, began: bool) -> None:
        """Report the end of a worker to the waiting tasks and to the log."""
        ending = _ending(worker.process.wait())
        how = f"(pid {worker.process.pid}) {ending}"
        if worker.answer is not None and not worker.answer.done():
            worker.answer.set_exception(WorkerLost(how))
        if not began:
            self._fail(f"{ending} at its start")
        elif not worker.dismissed:
            self.replaced += 1
            log.warning("a planning process %s and is replaced", how)

    def _fail(self, why: str) -> None:
        problem = f"a planning process {why}; cobot tries again"
        if problem != self.problem:
            log.error("%s", problem)
        self.problem = problem


async def _pack(task: Task, *, ahead: bool = False) -> bytes:
    try:
        return message(task, LARGE_BYTES, ahead=ahead)
    except TooLargeError:
        return await asyncio.to_thread(message, task, ahead=ahead)


def _outcome(packed: bytes) -> tuple[bool, Any]:
    try:
        found: tuple[bool, Any] = pickle.loads(packed)
    except Exception as exc:  # noqa: BLE001 - an error that cannot be told is one
        return False, exc
    return found


def _ending(status: int) -> str:
    return f"was ended by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"


async def _receive(reader: asyncio.StreamReader) -> tuple[bool, bytes]:
    """Read the next message. Returns whether it is about a preparation, and the message's pickle.

    Raises:
        asyncio.IncompleteReadError: the other end is closed.
    """
    is_ahead, size = HEAD.unpack(await reader.readexactly(HEAD.size))
    return is_ahead, await reader.readexactly(size)
