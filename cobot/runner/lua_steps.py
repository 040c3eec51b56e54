"""The steps of sequences as Lua functions with the same names, see docs/programs.md."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

from pydantic import ValidationError

from cobot.client import Client
from cobot.client.conditions import describe, require_condition
from cobot.client.pallets import ANGLES, POSITION, PalletPlace, places
from cobot.client.steps import (
    MAX_RETRIES,
    MAX_TIME_S,
    WAIT_FOR_TIMEOUT_S,
    is_recoverable,
    require_time,
    wait,
    wait_until,
)
from cobot.clock import SystemClock
from cobot.errors import CobotError, InputError
from cobot.runner.force_step import describe_force, run_force
from cobot.runner.gripper_step import COMMAND_TAGS, describe_command, run_command
from cobot.runner.lua_sandbox import Function, ProgramWatch
from cobot.runner.lua_values import number, plain, text
from cobot.runner.pace import StepPace
from cobot.runner.steps import FORCE_STEPS, Grid, GripperStep
from cobot.strict import sentences


class WatchedCall(Protocol):
    """Calls a function that waits for the service. See `Program`."""

    def __call__(self, work: Callable[[], Any]) -> Any: ...


class WatchedClock(SystemClock):
    """The clock of a program. Its waits end when the program must end."""

    def __init__(self, watch: ProgramWatch) -> None:
        self._watch = watch

    def now_s(self) -> float:
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        self._watch.sleep(seconds)


class LuaSteps:
    """The functions of one program.

    Args:
        unless_ended: calls a function that waits for the service, unless the program must end.
        report: called at the start and the end of each step. It may wait until a step is permitted.
        table: converts JSON to a Lua value.
        failure: returns the latest error that was reported to the program.
        call: runs a sequence file.
        paused_s: function that returns the total time that the program has been paused, s.
    """

    def __init__(
        self,
        client: Client,
        watch: ProgramWatch,
        unless_ended: WatchedCall,
        report: Callable[[dict[str, Any]], None],
        table: Callable[[Any], Any],
        failure: Callable[[], CobotError | None],
        call: Callable[[str], None],
        paused_s: Callable[[], float],
    ) -> None:
        self._client = client
        self._clock = WatchedClock(watch)
        self._pace = StepPace(self._clock)
        self._run_in_thread = unless_ended
        self._report = report
        self._table = table
        self._failure = failure
        self._run_file = call
        self._paused_s = lambda: float(unless_ended(paused_s))

    def functions(self) -> dict[str, Function]:
        """The functions for `sandbox.lua`."""
        return {
            "gripper": self._gripper,
            **{f"program_{name}": partial(self._force, name) for name in FORCE_STEPS},
            "program_set": self._set,
            "program_wait_for": self._wait_for,
            "program_wait_s": self._wait_s,
            "program_call": self._call,
            "places": self._places,
            "place_at": self._place_at,
            "require_retry": self._require_retry,
            "is_recoverable": self._is_recoverable,
        }

    def _set(self, output: object = None, value: object = None) -> None:
        name = text(output, "the output")
        if not isinstance(value, bool):
            number(value, f"the value of {name}")
        shown = f"set {name} to {json.dumps(value)}"
        self._do(shown, lambda: self._run_in_thread(lambda: self._client.set(name, value)))  # type: ignore[arg-type]

    def _gripper(self, command: object = None, how: object = None) -> None:
        name = text(command, "the command")
        fields = _fields(how, "the command", f"gripper.{name} takes a table such as {{width = 0.04}}")
        try:
            given = GripperStep.model_validate({"gripper": {**fields, "command": name}}).gripper
        except ValidationError as exc:
            raise InputError(sentences(exc.errors(), ignored=COMMAND_TAGS)) from exc
        self._do(
            f"gripper: {describe_command(given)}",
            lambda: self._run_in_thread(lambda: run_command(self._client, given)),
        )

    def _force(self, name: str, how: object = None) -> Any:
        """Execute a motion with force, and return its answer as a table."""
        fields = _fields(how, "the motion", f"{name} takes a table such as {{force = 10}}")
        try:
            step = FORCE_STEPS[name].model_validate({name: fields})
        except ValidationError as exc:
            raise InputError(sentences(exc.errors())) from exc
        answers: list[Any] = []

        def work() -> None:
            answers.append(self._run_in_thread(lambda: run_force(self._client, step)))

        self._do(describe_force(step), work)
        return self._table(answers[0])

    def _wait_for(self, condition: object = None, timeout_s: object = None) -> float:
        wanted = plain(condition, "the condition")
        require_condition(wanted)
        limit_s = WAIT_FOR_TIMEOUT_S if timeout_s is None else require_time(timeout_s, "timeout_s")
        taken: list[float] = []

        def work() -> None:
            taken.append(wait_until(wanted, self._read, limit_s, self._clock, self._paused_s))

        self._do(f"wait until {describe(wanted)}, up to {limit_s:g} s", work)
        return taken[0]

    def _read(self) -> Any:
        return self._run_in_thread(self._client.io)

    def _wait_s(self, seconds: object = None) -> None:
        time_s = number(seconds, "wait_s", 0.0, MAX_TIME_S)
        self._do(f"wait {time_s:g} s", lambda: wait(time_s, self._clock, self._paused_s))

    def _call(self, file: object = None) -> None:
        name = text(file, "the file")
        self._do(f"call {name}", lambda: self._run_in_thread(lambda: self._run_file(name)))

    def _do(self, what: str, work: Callable[[], Any]) -> None:
        self._pace.keep()
        # The report may have to wait until the program is resumed.
        self._run_in_thread(lambda: self._report({"event": "start", "content": what}))
        try:
            work()
        except CobotError as exc:
            self._report({"event": "failed", "content": what, "reason": str(exc)})
            raise
        self._report({"event": "done", "content": what})

    def _places(self, origin: object = None, counts: object = None, offsets: object = None) -> Any:
        """The places of a pallet. Each consists of its pose and its number."""
        given = {"origin": origin, "counts": counts, "offsets": offsets}
        try:
            grid = Grid.model_validate({name: plain(value, name) for name, value in given.items()})
        except ValidationError as exc:
            raise InputError(f"pallet: {sentences(exc.errors())}") from exc
        found = places(grid.origin.model_dump(), grid.counts, [each.model_dump() for each in grid.offsets])
        return self._table([{**place.at(), "number": place.number} for place in found])

    def _place_at(self, pose: object = None, relative: object = None) -> Any:
        """A target whose pose is relative to a place."""
        fields = _fields(relative, "the pose", "at takes a table such as {z = -0.1}")
        for name in (*POSITION, *ANGLES):
            number(fields.get(name, 0.0), name)
        return self._table(PalletPlace.of(plain(pose, "the place")).at(**fields))

    def _require_retry(self, retry: object = None) -> int:
        if isinstance(retry, bool) or not isinstance(retry, int) or not 0 <= retry <= MAX_RETRIES:
            raise InputError(f"retry must be a whole number from 0 to {MAX_RETRIES}")
        return retry

    def _is_recoverable(self, reason: object = None) -> bool:
        """Whether an error that the program has caught is a `CobotError` that `on_error` handles."""
        failure = self._failure()
        same = failure is not None and isinstance(reason, bytes) and reason.endswith(str(failure).encode())
        return same and failure is not None and is_recoverable(failure)


def _fields(value: object, what: str, otherwise: str) -> dict[str, Any]:
    """Check that a value is a table with names.

    Raises:
        InputError: the value is not such a table; the message is `otherwise`.
    """
    fields = {} if value is None else plain(value, what)
    if fields == []:  # an empty table is a list and an object
        return {}
    if not isinstance(fields, dict):
        raise InputError(otherwise)
    return fields
