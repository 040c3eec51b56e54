"""Runs a sequence file or a Lua program for a number of iterations, with a log and a recording."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime
from enum import IntEnum
from functools import partial
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from cobot.client import Client
from cobot.errors import CobotError, InputError, UnavailableError
from cobot.foreign import plain_lines
from cobot.runner.interpreter import Interpreter
from cobot.runner.library import Library
from cobot.runner.lua_sandbox import LuaLimits, run_apart
from cobot.runner.progress import Progress
from cobot.runner.schema import Sequence, read_file, read_sequence

if TYPE_CHECKING:  # imported only by runs that record, because this import takes longer than all others
    from cobot.runner.recorder import Recorder

SIGNALS = (signal.SIGTERM, signal.SIGINT)
Event = dict[str, Any]


class ReturnCode(IntEnum):
    """Exit status of a run. As in a shell, the exit status of a run that a signal ends is 128 plus the
    signal's number.
    """

    DONE = 0
    BAD_INPUT = 2
    MOTION_FAILED = 3
    UNAVAILABLE = 4


class Ended(BaseException):
    """Raised when a signal ends the runner. This is not an Exception, so that code that handles ordinary
    errors does not catch it.
    """

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


@dataclass(frozen=True, slots=True)
class RunSettings:
    """The settings of a run.

    Attributes:
        name: file name, for messages.
        folder: folder of the sequences that are called.
        lua: limits of a Lua program; None for a sequence file.
        motion_token: token that identifies the sequence's requests to the service; None for a manual start.
        from_service: whether the service started the run.
        progress: the object to which each step is reported before it begins.
    """

    file: Path
    name: str
    folder: Path
    lua: LuaLimits | None
    url: str
    iterations: int
    delay_s: float
    motion_timeout_s: float
    bag: Path | None
    topics: str
    motion_token: str | None
    from_service: bool
    progress: Progress


def run(order: RunSettings) -> int:
    """Execute a run and return the exit status."""
    for number in SIGNALS:
        signal.signal(number, _end)
    recorder: Recorder | None = None
    try:
        source = read_file(order.file) if order.lua else b""
        library = Library(order.folder)
        sequence = None if order.lua else read_sequence(order.file)
        if sequence is not None:
            library.require(sequence, order.name)
        recorder = _recorder(order)
        if recorder is not None:
            recorder.start()
            log(f"recording {', '.join(recorder.topics)} to {order.bag}")
        timeout_s, token = order.motion_timeout_s, order.motion_token
        with Client(order.url, motion_timeout_s=timeout_s, motion_token=token) as client:
            report = recorder.event if recorder is not None else lambda _: None
            interpreter = Interpreter(client, library, order.progress, log, report)
            if sequence is None:
                _iterate_program(order, source, client, interpreter, report)
            else:
                _iterate(order, sequence, interpreter)
    except Ended as exc:
        log(f"ended by {exc}")
        return 128 + exc.number
    except CobotError as exc:
        order.progress.fail(exc)
        log(f"error: {exc}" if order.lua or order.name == "-" else f"error: {order.name}: {exc}")
        return _return_code(exc)
    finally:
        _ignore_signals()  # the bag must be closed
        if recorder is not None:
            recorder.close()
            if recorder.problem:
                log(f"the recording ended with: {recorder.problem}")
    log("done")
    return ReturnCode.DONE


def _return_code(error: CobotError) -> ReturnCode:
    if isinstance(error, InputError):
        return ReturnCode.BAD_INPUT
    return ReturnCode.UNAVAILABLE if isinstance(error, UnavailableError) else ReturnCode.MOTION_FAILED


def _recorder(order: RunSettings) -> Recorder | None:
    """The recorder that writes the bag; None if nothing is recorded.

    Raises:
        InputError: a topic does not exist.
    """
    if order.bag is None and not order.topics:
        return None
    from cobot.runner.recorder import Recorder, parse_topics

    topics = parse_topics(order.topics)
    return None if order.bag is None else Recorder(order.bag, topics, order.url)


def log(text: str) -> None:
    """Print a line with its time, without buffering. Further lines of the text are indented, so that none
    looks like a log line.
    """
    lines = plain_lines(text, "    | ")
    print(f"{datetime.now().astimezone().isoformat(timespec='milliseconds')} {lines}", flush=True)


def say(text: str) -> None:
    """Print a line of a program. It is marked, so that it does not look like a line from the runner."""
    log(f"program: {text}")


def _end(number: int, frame: FrameType | None) -> None:
    _ignore_signals()
    raise Ended(number)


def _ignore_signals() -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def _iterate(order: RunSettings, sequence: Sequence, interpreter: Interpreter) -> None:
    for iteration in _iterations(order):
        interpreter.run(sequence, iteration, order.iterations)


def _iterations(order: RunSettings) -> Iterator[int]:
    for iteration in range(1, order.iterations + 1):
        if iteration > 1:
            log(f"waiting {order.delay_s:g} s")
            time.sleep(order.delay_s)
        yield iteration


def _iterate_program(
    order: RunSettings,
    source: bytes,
    client: Client,
    interpreter: Interpreter,
    report: Callable[[Event], None],
) -> None:
    from cobot.runner.lua_program import Program

    assert order.lua is not None
    for iteration in _iterations(order):
        place = {"iteration": iteration, "n_iterations": order.iterations, "waypoint": 0, "n_waypoints": 0}
        order.progress.tell(place)

        def report_event(event: Event, place: Event = place) -> None:
            if event["event"] == "start":
                order.progress.ask(place)
            report({**event, **place})

        program = Program(
            client,
            order.url,
            order.lua,
            say if order.from_service else log,
            report_event,
            partial(interpreter.call, place=place),
            order.progress.ask_paused_s,
        )
        run_apart(partial(program.run, source, order.name), program.watch)
