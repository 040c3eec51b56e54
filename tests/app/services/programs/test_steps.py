"""What a runner is told between two waypoints. Oracle: docs/jobs.md, written out by hand."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator

import pytest

from app.services.programs.steps import NEXT, RunnerInstructions
from cobot.errors import ConflictError, InputError


class Bench:
    """A runner's end of the pipe."""

    def __init__(self, first: int | None = None, *, hold: bool = False) -> None:
        self._read_end, write_end = os.pipe()
        os.set_blocking(self._read_end, False)
        self.held: list[bool] = []
        self.steps = RunnerInstructions(write_end, first, self.held.append, hold=hold)

    def answers(self) -> list[int | None]:
        try:
            lines = os.read(self._read_end, 65536).splitlines()
        except BlockingIOError:
            return []
        return [json.loads(line)["waypoint"] for line in lines]

    def ask(self, behind: int, of: int = 4) -> list[int | None]:
        if self.steps.ask(behind, of):
            self.steps.answer()
        return self.answers()

    def close(self) -> None:
        self.steps.close()
        os.close(self._read_end)


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


def test_a_runner_goes_on_unless_it_is_to_wait(bench: Bench) -> None:
    assert [bench.ask(behind) for behind in range(4)] == [[None]] * 4
    assert bench.held == []


def test_it_waits_where_it_is_told_to_and_steps_from_there(bench: Bench) -> None:
    bench.steps.hold(2)  # before it has said how many there are
    assert bench.ask(0) == [None]
    with pytest.raises(InputError, match="there are 4 waypoints, numbered from 1; got 5"):
        bench.steps.hold(5)
    assert bench.ask(1) == [None]
    assert bench.ask(2) == []
    assert bench.steps.held
    bench.steps.resume(step=True)
    assert bench.answers() == [None]
    assert bench.ask(3) == []
    bench.steps.resume()
    assert bench.answers() == [None]
    assert bench.ask(4) == [None]
    assert bench.held == [True, False, True, False]


def test_a_waypoint_that_is_passed_without_a_stop_holds_at_the_next_stop(bench: Bench) -> None:
    bench.ask(0)
    bench.steps.hold(2)
    assert bench.ask(3) == []


def test_a_waypoint_ahead_stays_set_while_it_waits_and_is_stepped(bench: Bench) -> None:
    bench.steps.hold(NEXT)
    assert bench.ask(1) == []
    bench.steps.hold(1)  # it waits there already
    bench.steps.hold(3)
    bench.steps.resume(step=True)
    assert bench.answers() == [None]
    assert bench.ask(2) == []
    bench.steps.resume()
    assert bench.answers() == [None]
    assert bench.ask(3) == []
    bench.steps.resume()
    assert bench.answers() == [None]
    assert bench.ask(4) == [None]
    assert bench.ask(0) == [None], "the next iteration"


def test_a_pause_on_the_path_ends_a_step_and_keeps_the_waypoint_ahead(bench: Bench) -> None:
    bench.ask(0)
    bench.steps.hold(3)
    bench.steps.hold(NEXT)
    bench.steps.resume()
    assert bench.ask(1) == [None]
    assert bench.ask(3) == []


def test_it_goes_on_from_any_waypoint(bench: Bench) -> None:
    bench.ask(0)
    bench.steps.hold(NEXT)
    assert bench.ask(1) == []
    for wrong in (0, 5):
        with pytest.raises(InputError, match=f"there are 4 waypoints, numbered from 1; got {wrong}"):
            bench.steps.resume(wrong)
    bench.steps.resume(4)
    assert bench.answers() == [4]
    with pytest.raises(ConflictError, match="the sequence is not at a waypoint"):
        bench.steps.resume(1)


def test_it_begins_where_it_is_told_to() -> None:
    bench = Bench(first=3)
    bench.steps.hold(NEXT)
    assert bench.ask(0) == [3]
    assert bench.ask(3) == []
    bench.close()


@pytest.mark.parametrize("first", [None, 3])
def test_it_waits_before_its_first_motion_if_it_is_to(first: int | None) -> None:
    bench = Bench(first, hold=True)
    assert bench.ask(0) == []
    assert bench.steps.held
    bench.steps.resume(step=True)
    assert bench.answers() == [first]
    assert bench.ask(first or 1) == []
    bench.steps.resume()
    assert bench.answers() == [None]
    bench.close()


def test_a_beginning_that_was_to_wait_goes_on_if_it_is_resumed_before() -> None:
    waiting = Bench(hold=True)
    waiting.steps.resume()
    assert waiting.ask(0) == [None]
    waiting.close()


def test_a_program_waits_before_its_next_motion_only(bench: Bench) -> None:
    assert bench.ask(0, 0) == [None]
    with pytest.raises(InputError, match="a program has no waypoints"):
        bench.steps.hold(1)
    bench.steps.hold(NEXT)
    assert bench.ask(0, 0) == []
    with pytest.raises(InputError, match="there are 0"):
        bench.steps.resume(1)
    bench.steps.resume()
    assert bench.answers() == [None]


def test_a_runner_that_has_ended_is_no_error(bench: Bench) -> None:
    os.close(bench._read_end)
    bench.steps.answer()
    bench._read_end, other = os.pipe()
    os.close(other)
