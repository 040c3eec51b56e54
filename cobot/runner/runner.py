"""Runs a sequence, target by target, over HTTP, with a log line for each step."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from enum import IntEnum
from functools import partial
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from cobot.client import Client
from cobot.errors import CobotError, InputError, UnavailableError
from cobot.foreign import plain_lines
from cobot.runner.lua_sandbox import Limits, run_apart
from cobot.runner.moving import go
from cobot.runner.progress import Progress
from cobot.runner.schema import AnyTarget, Sequence, read_file, read_sequence

if TYPE_CHECKING:  # imported only by runs that record: it takes longer than all other imports
    from cobot.runner.recorder import Recorder

SIGNALS = (signal.SIGTERM, signal.SIGINT)
Chain = list[tuple[int, AnyTarget]]


class ReturnCode(IntEnum):
    """Exit status of a run. As in a shell, a run that a signal ends has 128 plus the signal's number."""

    DONE = 0
    BAD_INPUT = 2
    MOTION_FAILED = 3
    UNAVAILABLE = 4


class Ended(BaseException):
    """A signal ended the runner. Not an Exception, so that no handler of ordinary errors catches it."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.number = number


@dataclass(frozen=True, slots=True)
class Run:
    """The settings of a run.

    Attributes:
        name: name of the file, for messages.
        lua: limits of a Lua program; None for a sequence file.
        motion_token: the service's token, by which it recognises the sequence's requests; None for a manual
            start.
        from_service: whether the service started the run.
        progress: consulted before each motion.
    """

    file: Path
    name: str
    lua: Limits | None
    url: str
    iterations: int
    delay_s: float
    motion_timeout_s: float
    bag: Path | None
    topics: str
    motion_token: str | None
    from_service: bool
    progress: Progress


def run(order: Run) -> int:
    """Execute a run and return the exit status."""
    for number in SIGNALS:
        signal.signal(number, _end)
    recorder: Recorder | None = None
    try:
        source = read_file(order.file) if order.lua else b""
        sequence = None if order.lua else read_sequence(order.file)
        recorder = _recorder(order)
        if recorder is not None:
            recorder.start()
            log(f"recording {', '.join(recorder.topics)} to {order.bag}")
        timeout_s, token = order.motion_timeout_s, order.motion_token
        with Client(order.url, motion_timeout_s=timeout_s, motion_token=token) as client:
            if sequence is None:
                _iterate_program(order, source, client, recorder)
            else:
                _iterate(order, sequence, client, recorder)
    except Ended as exc:
        log(f"ended by {exc}")
        return 128 + exc.number
    except InputError as exc:
        log(f"error: {exc}")
        return ReturnCode.BAD_INPUT
    except UnavailableError as exc:
        log(f"error: {exc}")
        return ReturnCode.UNAVAILABLE
    except CobotError as exc:
        log(f"error: {exc}")
        return ReturnCode.MOTION_FAILED
    finally:
        _ignore_signals()  # so that the bag is closed
        if recorder is not None:
            recorder.close()
            if recorder.problem:
                log(f"the recording ended with: {recorder.problem}")
    log("done")
    return ReturnCode.DONE


def _recorder(order: Run) -> Recorder | None:
    """The recorder of the bag; None if nothing is recorded.

    Raises:
        InputError: a topic does not exist.
    """
    if order.bag is None and not order.topics:
        return None
    from cobot.runner.recorder import Recorder, parse_topics

    topics = parse_topics(order.topics)
    return None if order.bag is None else Recorder(order.bag, topics, order.url)


def log(text: str) -> None:
    """Print a line with its time, unbuffered. Further lines are indented, so that none looks like a log
    line."""
    lines = plain_lines(text, "    | ")
    print(f"{datetime.now().astimezone().isoformat(timespec='milliseconds')} {lines}", flush=True)


def say(text: str) -> None:
    """Print a line of a program, marked as such, so that it does not look like the runner's own."""
    log(f"program: {text}")


def _end(number: int, frame: FrameType | None) -> None:
    _ignore_signals()
    raise Ended(number)


def _ignore_signals() -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def _iterate(order: Run, sequence: Sequence, client: Client, recorder: Recorder | None) -> None:
    chains = sequence.chains()
    for iteration in _iterations(order):
        left = chains
        while left:
            place = _place(order, iteration, left[0], sequence)
            waypoint = order.progress.ask(place)
            if waypoint is not None:
                left = _from(chains, waypoint)
                place = _place(order, iteration, left[0], sequence)
                log(f"continuing from waypoint {waypoint}")
                order.progress.tell(place)
            _step(order, client, recorder, place, [target for _, target in left[0]])
            order.progress.behind = place["waypoint"]
            left = left[1:]


def _place(order: Run, iteration: int, chain: Chain, sequence: Sequence) -> dict[str, int]:
    return {
        "iteration": iteration,
        "n_iterations": order.iterations,
        "waypoint": chain[-1][0],
        "n_waypoints": len(sequence.waypoints),
    }


def _from(chains: list[Chain], waypoint: int) -> list[Chain]:
    """The rest of an iteration that continues from a waypoint, which may be inside a chain.

    Raises:
        InputError: the waypoint does not exist.
    """
    for index, chain in enumerate(chains):
        if chain[-1][0] >= waypoint:
            return [[each for each in chain if each[0] >= waypoint], *chains[index + 1 :]]
    raise InputError(f"there is no waypoint {waypoint}: the last one is {chains[-1][-1][0]}")


def _iterations(order: Run) -> Iterator[int]:
    for iteration in range(1, order.iterations + 1):
        if iteration > 1:
            log(f"waiting {order.delay_s:g} s")
            time.sleep(order.delay_s)
        yield iteration


def _iterate_program(order: Run, source: bytes, client: Client, recorder: Recorder | None) -> None:
    from cobot.runner.lua_program import Program

    assert order.lua is not None
    for iteration in _iterations(order):
        place = {"iteration": iteration, "n_iterations": order.iterations, "waypoint": 0, "n_waypoints": 0}
        order.progress.tell(place)

        def moved(event: dict[str, object], place: dict[str, int] = place) -> None:
            if event["event"] == "start":
                order.progress.ask(place)
            if recorder is not None:
                recorder.event({**event, **place})

        program = Program(client, order.url, order.lua, say if order.from_service else log, moved)
        run_apart(partial(program.run, source, order.name), program.watch)


def _step(
    order: Run, client: Client, recorder: Recorder | None, place: dict[str, int], chain: list[AnyTarget]
) -> None:
    """Go to the last target of a chain, passing the others without a stop."""
    target = chain[-1]
    name = f"waypoint {place['waypoint']}/{place['n_waypoints']}" if place["waypoint"] else "home"
    where = f"iteration {place['iteration']}/{place['n_iterations']}, {name}"
    if len(chain) > 1:
        first = place["waypoint"] - len(chain) + 1
        where += f", through {f'waypoint {first}' if first else 'home'} on without a stop"
    if target.label:
        where += f" ({target.label})"
    log(f"{where}: start")
    event = {**place, "target": target.model_dump()}
    if len(chain) > 1:
        event["through"] = [each.model_dump() for each in chain[:-1]]
    if recorder is not None:
        recorder.event({"event": "start", **event})
    try:
        answer = go(client, chain)
    except CobotError as exc:
        if recorder is not None:
            recorder.event({"event": "failed", "reason": str(exc), **event})
        raise type(exc)(f"{where}: {exc}") from exc
    note = f"; {answer['note']}" if len(chain) > 1 and answer.get("note") else ""
    log(f"{where}: arrived after {answer['duration_s']:.2f} s{note}")
    if recorder is not None:
        recorder.event({"event": "arrived", "motion_id": answer["motion_id"], **event})
