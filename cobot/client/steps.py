"""Steps of programs. Their names are the same as in sequence files and in Lua, see docs/programs.md."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote

from cobot.client.conditions import describe, find_input, holds, require_condition
from cobot.client.connection import Json
from cobot.client.jobs import JobHandle, Jobs
from cobot.client.pallets import PalletPlace, places
from cobot.clock import SYSTEM, Clock
from cobot.errors import (
    CobotError,
    DeviceError,
    ExecutionError,
    InputError,
    MotionStopped,
    PlanningError,
)
from cobot.reasons import Reason, ReasonCode

Result = TypeVar("Result")
WAIT_FOR_TIMEOUT_S = 60.0
POLL_S = 0.05
"""Interval between two readings of the inputs, in seconds. A signal that is shorter may be missed."""
MAX_TIME_S = 86_400.0
"""Maximum duration of a wait, in seconds."""
MAX_RETRIES = 1000
RECOVERABLE = (PlanningError, ExecutionError, DeviceError)
"""Errors that `on_error` handles: a failed motion, wait or device. A mistake in the program, a stop, and a
robot that is not available always end the program.
"""


def is_recoverable(error: BaseException) -> bool:
    """Whether `on_error` handles an error."""
    return isinstance(error, RECOVERABLE) and not isinstance(error, MotionStopped)


def require_time(value: object, name: str) -> float:
    """Check a time in seconds.

    Raises:
        InputError: the value is not a number from 0 to `MAX_TIME_S`.
    """
    if isinstance(value, int | float) and not isinstance(value, bool) and 0.0 <= value <= MAX_TIME_S:
        return float(value)
    raise InputError(f"{name} is {json.dumps(value, default=repr)[:40]}, allowed: 0 to {MAX_TIME_S:g} s")


def wait_until(
    condition: Mapping[str, Any],
    read: Callable[[], Sequence[Json]],
    timeout_s: float,
    clock: Clock = SYSTEM,
    paused_s: Callable[[], float] = lambda: 0.0,
) -> float:
    """Wait until a condition holds. Returns the waiting time, s.

    Args:
        read: reads the inputs.
        paused_s: total time that the program has been paused, s. This time does not count.

    Raises:
        ExecutionError: the condition does not hold within `timeout_s`.
        NotFoundError, InputError: the input does not exist, or its kind does not match the condition.
    """
    begin_s, paused_before_s = clock.now_s(), paused_s()
    end_s = begin_s + timeout_s
    while not holds(condition, points := read()):
        if clock.now_s() >= end_s:
            paused_now_s = paused_s()
            if paused_now_s <= paused_before_s:
                value = json.dumps(find_input(points, condition["input"])["value"])
                raise ExecutionError(
                    f"wait_for: {describe(condition)} did not become true within {timeout_s:g} s; the input "
                    f"is {value}. Check the sensor, or give a longer timeout_s",
                    details=Reason(
                        "", ReasonCode.INPUT_NOT_MET, (str(condition["input"]),), limit=timeout_s, unit="s"
                    ).fields(),
                )
            end_s, paused_before_s = end_s + paused_now_s - paused_before_s, paused_now_s
            continue
        clock.sleep(min(POLL_S, max(end_s - clock.now_s(), 0.0)))
    return clock.now_s() - begin_s


def wait(seconds: float, clock: Clock = SYSTEM, paused_s: Callable[[], float] = lambda: 0.0) -> None:
    """Wait for a given time, s. Paused time does not count."""
    begin_s, paused_before_s = clock.now_s(), paused_s()
    end_s = begin_s + seconds
    while (left_s := end_s - clock.now_s()) > 0.0:
        clock.sleep(left_s)
        end_s = begin_s + seconds + paused_s() - paused_before_s


def on_error(
    work: Callable[[], Result],
    *,
    retry: int = 0,
    run: Callable[[CobotError], object] | None = None,
    go_on: bool = False,
) -> Result | None:
    """Call a function, and call it again if it fails. Returns its result, or None if it has failed and
    `go_on` is set.

    Args:
        retry: number of further attempts.
        run: called after each failed attempt with its error.
        go_on: whether the error of the last attempt is dropped. Otherwise it is raised.

    Raises:
        CobotError: an error that a retry cannot cure, see `RECOVERABLE`, or the error of the last attempt.
    """
    if isinstance(retry, bool) or not isinstance(retry, int) or not 0 <= retry <= MAX_RETRIES:
        raise InputError(f"retry is {retry!r}, allowed: 0 to {MAX_RETRIES}")
    for attempt in range(retry + 1):
        try:
            return work()
        except CobotError as exc:
            if not is_recoverable(exc):
                raise
            if run is not None:
                run(exc)
            if attempt == retry and not go_on:
                raise
    return None


class Steps(Jobs):
    """The steps of sequence files as methods for Python programs."""

    def io(self) -> list[Json]:
        """The device's inputs and outputs: `name`, `kind`, `direction`, `value`."""
        return list(self._json("GET", "/robot/io")["points"])

    def set(self, output: str, value: float) -> Json:
        """Set an output of the device by name. Returns when the device reports the new value.

        Args:
            value: true or false for a boolean output, otherwise a number.
        """
        return self._json("PUT", f"/robot/io/{quote(output, safe='')}", json={"value": value})

    def set_output(self, name: str, value: float) -> Json:
        """Set an output. This is the earlier name of `set`."""
        return self.set(name, value)

    def wait_for(self, condition: Mapping[str, Any], timeout_s: float = WAIT_FOR_TIMEOUT_S) -> float:
        """Wait until a condition such as `{"input": "part_there", "is": True}` holds. Returns the time that
        it took, s.

        Raises:
            ExecutionError: the condition does not hold within `timeout_s`.
        """
        require_condition(condition)
        return wait_until(condition, self.io, require_time(timeout_s, "timeout_s"))

    def wait_s(self, seconds: float) -> None:
        """Wait for a given time, s. Paused time does not count."""
        wait(require_time(seconds, "wait_s"))

    def on_error(
        self,
        work: Callable[[], Result],
        *,
        retry: int = 0,
        run: Callable[[CobotError], object] | None = None,
        go_on: bool = False,
    ) -> Result | None:
        """Call a function, and call it again if it fails; see `cobot.client.steps.on_error`."""
        return on_error(work, retry=retry, run=run, go_on=go_on)

    def pallet(
        self, origin: Mapping[str, Any], counts: Sequence[int], offsets: Sequence[Mapping[str, Any]]
    ) -> Iterator[PalletPlace]:
        """The places of a pallet; see `cobot.client.pallets.places`. `move_pose(**place.at(z=-0.1))` moves to
        a point 0.1 m before a place.
        """
        return places(origin, counts, offsets)

    def call(self, path: str | Path, timeout_s: float = math.inf) -> Json:
        """Run a sequence file or a Lua program to its end. Returns the job of the program.

        Raises:
            CobotError: the program has failed, or has not ended within `timeout_s`.
        """
        with Path(path).open("rb") as file:
            job = self._json(
                "POST",
                "/sequences/start",
                params={"wait": False},
                files={"config": (Path(path).name, file, "application/json")},
                data={"n_iterations": "1", "delay_between_iterations": "0"},
            )
        return JobHandle(self, str(job["id"])).wait(timeout_s)
