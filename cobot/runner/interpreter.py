"""Runs the steps of sequences over REST, one at a time."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from cobot.client import Client
from cobot.client.conditions import describe, holds
from cobot.client.pallets import places
from cobot.client.steps import on_error, wait, wait_until
from cobot.clock import SYSTEM, Clock
from cobot.errors import CobotError
from cobot.motions.conditions import StepCondition
from cobot.runner import schema
from cobot.runner.blocks import Numbered, groups
from cobot.runner.force_step import describe_end, describe_force, run_force
from cobot.runner.gripper_step import describe_command, run_command
from cobot.runner.library import Library
from cobot.runner.moving import go
from cobot.runner.pace import StepPace
from cobot.runner.progress import Progress
from cobot.runner.steps import (
    FORCE_STEPS,
    CallStep,
    ForceStep,
    GripperStep,
    IfStep,
    OnErrorStep,
    PalletStep,
    RepeatStep,
    SetStep,
    Step,
    WaitForStep,
    WaitStep,
)
from cobot.runner.targets import Target
from cobot.runner.where import Where


class Jump(Exception):
    """Raised if the service requests that the sequence continues at a different step of its outermost
    list.
    """

    def __init__(self, number: int) -> None:
        super().__init__(f"step {number}")
        self.number = number


class Interpreter:
    """Runs sequences.

    Args:
        library: contains the sequences that can be called.
        log: called with a line for each step.
        report: called at the start and the end of each motion and each other step.
    """

    def __init__(
        self,
        client: Client,
        library: Library,
        progress: Progress,
        log: Callable[[str], None],
        report: Callable[[dict[str, Any]], None] = lambda _: None,
        clock: Clock = SYSTEM,
    ) -> None:
        self._client = client
        self._library = library
        self._progress = progress
        self._log = log
        self._report = report
        self._clock = clock
        self._pace = StepPace(clock)
        self._place: dict[str, Any] = {}
        self._permitted = False
        self._prefix = ""
        self._do: dict[type[Step], Callable[[Any, Where], None]] = {
            GripperStep: self._gripper,
            **dict.fromkeys(FORCE_STEPS.values(), self._force),
            SetStep: self._set,
            WaitForStep: self._wait_for,
            WaitStep: self._wait,
            RepeatStep: self._repeat,
            IfStep: self._if,
            CallStep: self._call,
            PalletStep: self._pallet,
            OnErrorStep: self._on_error,
        }

    def run(self, sequence: schema.Sequence, iteration: int = 1, n_iterations: int = 1) -> None:
        """Run a sequence once.

        Raises:
            CobotError: a step has failed. The message begins with the place of the step.
        """
        total = len(sequence.items)
        where, self._prefix = Where(sequence.word, total), f"iteration {iteration}/{n_iterations}, "
        left = sequence.groups()
        while left:
            number = left[0][-1][0]
            self._place = {
                "iteration": iteration,
                "n_iterations": n_iterations,
                "waypoint": number,
                "n_waypoints": total,
            }
            try:
                self._group(left[0], where, total)
            except Jump as jump:
                left = sequence.groups_from(jump.number)
                self._permitted = True
                self._log(f"continuing from {sequence.word} {jump.number}")
                continue
            self._progress.behind = number
            left = left[1:]

    def call(self, name: str, place: dict[str, Any]) -> None:
        """Run a sequence file from the library once, within a program.

        Args:
            place: place in the program, for the progress.

        Raises:
            CobotError: the file is not valid, or a step has failed. The message begins with the place.
        """
        sequence = self._library.find(name)
        self._library.require(sequence, name)
        self._place, self._prefix = place, ""
        self._steps(sequence, Where(sequence.word, len(sequence.items), caller=f"{name} "))

    def _steps(self, sequence: schema.Sequence, where: Where) -> None:
        for group in sequence.groups():
            self._group(group, where, len(sequence.items))

    def _block(self, steps: Sequence[Target | Step], where: Where) -> None:
        for group in groups(steps):
            self._group(group, where, len(steps))

    def _group(self, group: Sequence[Numbered], where: Where, of: int) -> None:
        number, step = group[-1]
        here = where.at(number, of)
        self._await_permission(here)
        if isinstance(step, Step):
            self._do[type(step)](step, here)
        else:
            self._move(group[0][0], [each for _, each in group if isinstance(each, Target)], here)

    def _await_permission(self, here: Where) -> None:
        self._pace.keep()
        place = {**self._place, "step": str(here), "share": here.begin}
        if self._permitted:
            self._permitted = False
            self._progress.tell(place)
            return
        number = self._progress.ask(place)
        if number is not None:
            raise Jump(number)

    def _move(self, first: int, chain: Sequence[Target], here: Where) -> None:
        """Move to the last target of a chain. The arm passes the other targets without a stop."""
        text = f"{self._prefix}{here}"
        content: dict[str, Any] = {"target": chain[-1].model_dump(by_alias=True, exclude={"comment"})}
        if len(chain) > 1:
            through = f"{here.word} {first}" if first else "home"
            text += f", through {through} on without a stop"
            content["through"] = [each.model_dump(by_alias=True, exclude={"comment"}) for each in chain[:-1]]
        with self._report_motion(text + _label(chain[-1]), here, content) as done:
            answer = go(self._client, chain, here.frames)
            done["motion_id"] = answer["motion_id"]
        note = f"; {answer['note']}" if len(chain) > 1 and answer.get("note") else ""
        self._log(f"{text}{_label(chain[-1])}: arrived after {answer['duration_s']:.2f} s{note}")

    @contextlib.contextmanager
    def _report_motion(self, text: str, here: Where, content: dict[str, Any]) -> Iterator[dict[str, Any]]:
        """Context manager for a motion. It reports the motion's start and end, and adds the location to any
        error raised.
        """
        self._log(f"{text}: start")
        event = {**self._place, "step": str(here), **content}
        self._report({"event": "start", **event})
        done: dict[str, Any] = {}
        try:
            yield done
        except CobotError as exc:
            self._report({"event": "failed", "reason": str(exc), **event})
            raise self._error_at(exc, text, here) from exc
        self._report({"event": "arrived", **done, **event})

    @contextlib.contextmanager
    def _report_step(self, step: Step, here: Where, doing: str) -> Iterator[None]:
        """Context manager for a step that is not a motion: logs and reports the step, and adds its location
        to any error raised.
        """
        text = self._text(step, here)
        self._log(f"{text}: {doing}")
        event = {
            **self._place,
            "step": str(here),
            "content": step.model_dump(by_alias=True, exclude={"comment"}),
        }
        try:
            yield
        except CobotError as exc:
            self._report({"event": "failed", "reason": str(exc), **event})
            raise self._error_at(exc, text, here) from exc
        self._report({"event": "done", **event})

    def _error_at(self, error: CobotError, text: str, here: Where) -> CobotError:
        """The error of a step, extended by the step's location. The details contain the step's number in the
        file that was started, and the original message.
        """
        placed = error.with_message(f"{text}: {error}")
        number = str(self._place["waypoint"] or "") if here.caller else ".".join(here.numbers)
        placed.details = {**error.details, "step": number, "message": str(error)}
        return placed

    def _text(self, step: Step, here: Where) -> str:
        return f"{self._prefix}{here}{_label(step)}"

    def _set(self, step: SetStep, here: Where) -> None:
        output, value = step.set.output, step.set.value
        with self._report_step(step, here, f"set {output} to {_shown(value)}"):
            self._client.set(output, value)

    def _gripper(self, step: GripperStep, here: Where) -> None:
        with self._report_step(step, here, f"gripper: {describe_command(step.gripper)}"):
            run_command(self._client, step.gripper)

    def _force(self, step: ForceStep, here: Where) -> None:
        with self._report_step(step, here, describe_force(step)):
            answer = run_force(self._client, step, here.frames)
        self._log(f"{self._text(step, here)}: {describe_end(answer)}")

    def _wait_for(self, step: WaitForStep, here: Where) -> None:
        condition = step.wait_for.as_json()
        doing = f"wait until {describe(condition)}, up to {step.timeout_s:g} s"
        with self._report_step(step, here, doing):
            wait_until(condition, self._client.io, step.timeout_s, self._clock, self._progress.ask_paused_s)

    def _wait(self, step: WaitStep, here: Where) -> None:
        with self._report_step(step, here, f"wait {step.wait_s:g} s"):
            wait(step.wait_s, self._clock, self._progress.ask_paused_s)

    def _repeat(self, step: RepeatStep, here: Where) -> None:
        rounds, number = step.repeat, 0
        while rounds.count is None or number < rounds.count:
            self._pace.keep()
            if rounds.while_ is not None and not self._holds(rounds.while_, step, here):
                return
            number += 1
            self._block(step.do, here.in_round("round", number, rounds.count))
            if rounds.until is not None and self._holds(rounds.until, step, here):
                return

    def _if(self, step: IfStep, here: Where) -> None:
        if self._holds(step.if_, step, here):
            self._block(step.then, here)
        elif step.else_:
            self._block(step.else_, here.in_part("else"))

    def _holds(self, condition: StepCondition, step: Step, here: Where) -> bool:
        text = self._text(step, here)
        try:
            found = holds(condition.as_json(), self._client.io())
        except CobotError as exc:
            raise self._error_at(exc, text, here) from exc
        self._log(f"{text}: {describe(condition.as_json())}: {'yes' if found else 'no'}")
        return found

    def _call(self, step: CallStep, here: Where) -> None:
        sequence = self._library.find(step.call)
        self._steps(sequence, here.in_file(step.call, sequence.word, len(sequence.items)))

    def _pallet(self, step: PalletStep, here: Where) -> None:
        grid = step.pallet
        origin, offsets = grid.origin.model_dump(), [each.model_dump() for each in grid.offsets]
        outer = here.frames.get(grid.origin.frame_id)
        if outer is not None:  # the pallet is at a place of another pallet
            origin, offsets = outer.resolve(origin), [outer.turn(each) for each in offsets]
        found = list(places(origin, grid.counts, offsets))
        for place in found:
            there = here.in_round(grid.frame, place.number, len(found))
            self._block(step.do, there.with_place(grid.frame, place))

    def _on_error(self, step: OnErrorStep, here: Where) -> None:
        recovery, attempts = step.on_error, 0

        def recover(error: CobotError) -> None:
            nonlocal attempts
            attempts += 1
            self._log(f"{self._text(step, here)}: attempt {attempts} of {recovery.retry + 1} failed: {error}")
            self._block(recovery.run, here.in_part("run"))

        on_error(lambda: self._block(step.do, here), retry=recovery.retry, run=recover, go_on=recovery.go_on)


def _label(step: Target | Step) -> str:
    return f" ({step.label})" if step.label else ""


def _shown(value: float) -> str:
    return json.dumps(value)
