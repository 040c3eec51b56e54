"""The recorder of one robot. Its thread keeps the history, and writes recordings for requests and faults.

This module is long because a single thread owns all of its state.
"""

from __future__ import annotations

import contextlib
import logging
import os
import threading
import time
from concurrent.futures import Future
from queue import Empty, SimpleQueue

import numpy as np

from cobot.config import Settings
from cobot.errors import CobotError, ConflictError, InputError, UnavailableError, exhausted
from cobot.ipc.layout import text
from cobot.ipc.recording_memory import RecordingMemory
from cobot.ipc.shm import encoded
from cobot.recorder.writing import Writing
from cobot.recording.events import latched_in
from cobot.recording.messages import RecordMessages
from cobot.recording.store import RecordingStore, part_name, run_name
from cobot.types import LoopMode

PERIOD_S = 0.05
BATCH = 500
"""Maximum number of cycles that are written at once. The history is updated between two batches."""
REASONS = {LoopMode.FAULT: "fault", LoopMode.ESTOP: "estop"}
PARTS = 4
"""Number of parts of a continuous recording that fit into `recording.max_mb`. When a part would become
larger, the recording continues in the next one.
"""
GRACE_S = 2.0
"""Additional time to wait for missing cycles, in seconds. If they are still missing after it, the real-time
loop has ended, and the recording ends without them.
"""
LIST_S = 1.0
"""Interval at which the list of recordings is updated, in seconds."""
LATEST_WALL_NS = 2_100_000_000 * 10**9
LEFT = ".left"
"""Suffix of the unfinished file of a killed recorder while the continuous recording in it is taken over."""

log = logging.getLogger("cobot.recorder")
Answer = dict[str, object]


class RobotRecorder:
    """Follows a robot from `start` to `close`.

    Args:
        memory: recording memory of the robot, which was attached together with its history.
    """

    def __init__(self, settings: Settings, memory: RecordingMemory) -> None:
        assert memory.history is not None
        self.robot = memory.robot
        section = settings.recording
        self._memory, self._history = memory, memory.history
        self._messages = RecordMessages(memory.joint_names, settings.robot.base_frame, memory.period_s)
        self._store = RecordingStore(settings.recording_folder, section.max_mb * 1_000_000)
        self._before = round(section.before_s / memory.period_s)
        self._after = round(section.after_s / memory.period_s)
        self._status = memory.status.data
        self._latches_seen = 0  # the next recorder begins at `handled`
        self._listed_s = float("-inf")
        self._asked: SimpleQueue[tuple[Answer, Future[Answer]]] = SimpleQueue()
        self._writings: list[Writing] = []
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"recorder {self.robot}", daemon=True)

    def start(self) -> None:
        """Start at the cycle where the last recorder stopped, regardless of how it ended."""
        self._thread.start()

    def close(self) -> None:
        """Finish the recordings in progress."""
        self._ended.set()
        if self._thread.ident is not None:
            self._thread.join()

    def ask(self, request: Answer) -> Future[Answer]:
        """Pass a request to the thread. `action` is dump (with `seconds`), start or stop.

        The future's result is the file names or a CobotError.
        """
        answer: Future[Answer] = Future()
        self._asked.put((request, answer))
        return answer

    def _run(self) -> None:
        self.take_over()
        while not self._ended.is_set():
            try:
                busy = self.step()
            except Exception as exc:
                log.error("%s: the recorder failed", self.robot, exc_info=exc)
                busy = False
            if not busy:
                self._ended.wait(PERIOD_S)
        self.step()
        for writing in list(self._writings):
            self._end(writing, stays=writing.run == text(self._status["name"]))
        self._publish()

    def step(self) -> bool:
        """Update the history, and write a batch of each recording. Returns whether more cycles are
        waiting.
        """
        self._follow()
        self._heed_latches()
        while True:
            try:
                request, answer = self._asked.get_nowait()
            except Empty:
                break
            self._handle(request, answer)
        for writing in list(self._writings):
            self._write(writing)
        self._publish()
        return any(writing.waits(self._history, BATCH) for writing in self._writings)

    # The history

    def take_over(self) -> None:
        """Continue the continuous recording of a killed recorder."""
        status, block = self._status, self._memory.status
        if not block.try_read() and int(block.salvage()["recording"]) > 1:  # the value is neither 0 nor 1
            status[...] = np.zeros((), status.dtype)
        run, part = text(status["name"]), int(status["part"])
        current = part_name(run, part) if status["recording"] else ""
        left = self._store.folder / f"{current}{LEFT}"
        try:
            for name, file in self._store.unfinished().items():
                if name == current and not left.exists():
                    os.replace(file, left)
                else:
                    file.unlink(missing_ok=True)
            if current:
                writing = self._begin(run, "continuous", int(status["next"]), None, part)
                writing.next = max(writing.next, writing.file.take_over(left) + 1)
                left.unlink(missing_ok=True)
                log.warning("%s: the recording continues in %s", self.robot, current)
        except OSError as exc:
            self._fail(None, exc)

    def _follow(self) -> None:
        fresh, history = self._memory.fresh, self._history
        newest, begin = fresh.newest, history.newest + 1
        if newest and newest + 1 < begin and len(fresh.read(newest, 1)):
            log.warning("%s: cycle numbers restart because the memory was damaged", self.robot)
            begin = 1
            self._status["handled"] = self._latches_seen = 0
            for writing in list(self._writings):
                writing.next = 1
                (self._next_part if writing.last is None else self._end)(writing)
        elif begin == 1:  # without a history, cycles that rtloop has overwritten do not count as lost
            begin = max(1, newest - fresh.capacity + 1)
        _, lost = history.copy_from(fresh, begin)
        self._status["lost"] += lost

    def _heed_latches(self) -> None:
        """Start a recording for each fault and e-stop."""
        status, newest = self._status, self._history.newest
        seen = max(int(status["handled"]), self._latches_seen)
        first = max(seen + 1, newest - self._history.capacity + 1)
        if first > newest:
            return
        records = self._history.read(first, newest + 1 - first)
        before = self._history.read(first - 1, 1)
        for cycle, mode in latched_in(records, before[0] if len(before) else None):
            self._keep(cycle, REASONS[mode])
        self._latches_seen = newest
        unfinished = [writing.trigger for writing in self._writings if writing.trigger]
        status["handled"] = min([newest, *(trigger - 1 for trigger in unfinished)])

    def _keep(self, cycle: int, reason: str) -> None:
        """Record the cycles before and after a fault or e-stop. Events that are close to each other share a
        recording.
        """
        for writing in self._writings:
            if writing.trigger:
                if cycle > writing.trigger and writing.last is not None:
                    writing.extend(min(cycle + self._after, writing.first + self._history.capacity - 1))
                return
        record = self._history.read(cycle, 1)
        moment_ns = int(record[0]["monotonic_ns"]) if len(record) else time.monotonic_ns()
        run = run_name(self.robot, moment_ns + _ahead_ns(), reason)
        oldest = max(1, self._history.newest - self._history.capacity + 1)
        try:
            writing = self._begin(run, reason, max(oldest, cycle - self._before), cycle + self._after)
        except OSError as exc:
            self._fail(None, exc)
            return
        writing.trigger = cycle

    # Requests

    def _handle(self, request: Answer, answer: Future[Answer]) -> None:
        try:
            now_ns = time.monotonic_ns()
            late_s = (now_ns - int(str(request.get("until_ns", now_ns)))) * 1e-9
            if late_s > 0.0:  # the client's timeout has passed
                raise UnavailableError(f"the recorder read the request {late_s:.1f} s after its deadline")
            match request["action"]:
                case "dump":
                    self._dump(request, answer)
                case "start":
                    answer.set_result({"names": [self._start()]})
                case "stop":
                    answer.set_result({"names": self._stop()})
                case other:
                    raise InputError(f"action: there is no {other!r}; valid actions: dump, start, stop")
        except CobotError as exc:
            answer.set_exception(exc)
        except OSError as exc:
            answer.set_exception(self._fail(None, exc))
        except Exception as exc:
            answer.set_exception(UnavailableError(f"the recorder failed: {exc}"))
            raise

    def _dump(self, request: Answer, answer: Future[Answer]) -> None:
        seconds = request.get("seconds")
        newest, capacity = self._history.newest, self._history.capacity
        period_s = self._memory.period_s
        wanted = self._before if seconds is None else max(1, round(float(str(seconds)) / period_s))
        if not newest:
            raise UnavailableError(f"{self.robot}: there is nothing to record yet: rtloop has not started")
        # A margin of one batch prevents these cycles from being overwritten before they are read.
        first = max(1, newest - min(wanted, capacity - BATCH) + 1)
        writing = self._begin(run_name(self.robot, time.time_ns(), "request"), "request", first, newest)
        writing.waiting.append(answer)

    def _start(self) -> str:
        if self._status["recording"]:
            raise ConflictError(f"{self.robot} is already being recorded, since {text(self._status['name'])}")
        run = run_name(self.robot, time.time_ns(), "continuous")
        writing = self._begin(run, "continuous", self._history.newest + 1, None, 1)
        self._status["recording"], self._status["name"] = 1, run.encode()
        self._status["first"] = self._status["next"] = writing.next
        self._status["part"] = 1
        return run

    def _stop(self) -> list[str]:
        if not self._status["recording"]:
            raise ConflictError(f"{self.robot} is not being recorded")
        run = text(self._status["name"])
        for writing in [each for each in self._writings if each.run == run]:
            self._write(writing, to_the_end=True)
            if writing in self._writings:
                self._end(writing)
        self._status["recording"], self._status["name"], self._status["part"] = 0, b"", 0
        if self._status["problem"]:
            raise UnavailableError(text(self._status["problem"]))
        return [each.name for each in reversed(self._store.all()) if each.name.startswith(f"{run}-")]

    # Files

    def _begin(self, run: str, reason: str, first: int, last: int | None, part: int = 0) -> Writing:
        """Start a recording. Raises OSError if its file cannot be created."""
        self._store.make_room(0)
        path = self._store.folder / part_name(run, part)
        writing = Writing(
            run, path, self._memory, self._messages, _ahead_ns(), reason=reason, first=first, last=last
        )
        self._writings.append(writing)
        return writing

    def _write(self, writing: Writing, *, to_the_end: bool = False) -> None:
        """Write a batch, or all available cycles. After the last cycle, end the file or start the next
        part.
        """
        try:
            while writing.write(self._history, self._memory.notes, BATCH) and to_the_end:
                pass
            self._status["lost"] += writing.take_lost()
            if grown := writing.has_grown():
                writing.file.sync()
            if grown and self._store.make_room(0) > self._store.max_bytes:
                raise OSError(
                    f"recording.max_mb: {self._store.max_bytes} bytes are used by recordings in progress"
                )
            if writing.last is None:
                if writing.file.size > self._store.max_bytes // PARTS:
                    self._next_part(writing)
            elif writing.next > writing.last or self._is_overdue(writing):
                self._end(writing)
        except OSError as exc:
            self._fail(writing, exc)
        except Exception as exc:  # it would fail again, so the recording ends
            log.error("%s: the recorder failed", self.robot, exc_info=exc)
            self._fail(writing, OSError(f"the recorder failed: {exc}"))

    def _is_overdue(self, writing: Writing) -> bool:
        """Whether the cycles that the recording still needs will never arrive."""
        return time.monotonic() - writing.wrote_s > GRACE_S + self._after * self._memory.period_s

    def _next_part(self, writing: Writing) -> None:
        self._end(writing)
        part = int(self._status["part"]) + 1
        self._begin(writing.run, "continuous", writing.next, None, part)
        self._status["part"] = part

    def _end(self, writing: Writing, *, stays: bool = False) -> None:
        """Finish a file. If `stays` is true, the next recorder continues the continuous recording."""
        self._writings.remove(writing)
        empty = writing.file.cycles == 0
        try:
            if empty:
                writing.file.abandon()
            else:
                writing.file.finish()
            self._store.make_room(0, {writing.file.path.name})
        except OSError as exc:
            self._fail(writing, exc)
            return
        if writing.run == text(self._status["name"]):
            self._status["next"] = writing.next
            self._status["part"] += stays and not empty
        self._status["problem"] = b""
        if not empty:
            log.info("%s: recorded %s, %d cycles", self.robot, writing.file.path.name, writing.file.cycles)
        for answer in writing.waiting:
            answer.set_result({"names": [writing.file.path.name]})

    def _fail(self, writing: Writing | None, error: OSError) -> UnavailableError:
        """Report that recordings cannot be written, and end the recordings that are affected."""
        why = exhausted(error) or error.strerror or error
        problem = UnavailableError(f"{self._store.folder}: recordings cannot be written: {why}")
        log.error("%s: %s", self.robot, problem)
        self._status["problem"] = encoded(str(problem))
        if writing is not None:
            if writing in self._writings:
                self._writings.remove(writing)
            writing.file.abandon()
            if writing.run == text(self._status["name"]):
                self._status["recording"], self._status["name"] = 0, b""
            for answer in writing.waiting:
                answer.set_exception(problem)
        elif self._status["recording"] and not any(each.last is None for each in self._writings):
            self._status["recording"], self._status["name"] = 0, b""
        return problem

    def _publish(self) -> None:
        status = self._status
        status["pid"], status["monotonic_ns"] = os.getpid(), time.monotonic_ns()
        recordings = self._store.all() if time.monotonic() - self._listed_s > LIST_S else None
        if recordings is not None:
            self._listed_s = time.monotonic()
            status["files"], status["bytes"] = len(recordings), sum(each.size for each in recordings)
            if status["problem"]:
                with contextlib.suppress(OSError):
                    self._store.try_out()
                    status["problem"] = b""
        self._memory.status.publish()


def _ahead_ns() -> int:
    """The offset of the wall clock from CLOCK_MONOTONIC, ns. It is clamped so that messages can represent all
    recorded times, from 1970 to 2036.
    """
    now_ns = time.monotonic_ns()
    return min(max(time.time_ns() - now_ns, 0), LATEST_WALL_NS - now_ns)
