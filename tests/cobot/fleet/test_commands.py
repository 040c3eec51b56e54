"""Which commands a cell executes.

Oracle: what the deadline means, on a clock that the test sets.
"""

from __future__ import annotations

import threading
from typing import Any

import pytest

from cobot.errors import ConflictError, InputError, UnavailableError
from cobot.fleet.commands import MAX_COMMANDS, CommandBook, Deadlines, SeenMessages
from cobot.fleet.messages import MAX_BYTES, FleetCommand, HubTime, read

EPOCH = "aaaaaaaaaaaaaaaa"


class Clock:
    """The clock of the cell. The hub's is 1000 s ahead, as clocks from different starts are."""

    def __init__(self) -> None:
        self.s = 500.0
        self.epoch = EPOCH
        self.round_trip_s = 0.0
        self.answers = True

    def now_s(self) -> float:
        return self.s

    def ask(self) -> HubTime | None:
        """The hub reads its clock at the beginning of the round trip: the worst case for the cell."""
        found = HubTime(epoch=self.epoch, time_s=self.hub_s) if self.answers else None
        self.s += self.round_trip_s
        return found

    @property
    def hub_s(self) -> float:
        return self.s + 1000.0


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def book(clock: Clock) -> CommandBook:
    made = CommandBook("cell", "arm", clock.ask, clock)  # type: ignore[arg-type]
    made.synchronize()
    return made


def command(clock: Clock, **changes: Any) -> FleetCommand:
    values = {
        "id": "12345678",
        "fleet": "hall",
        "cell": "cell",
        "robot": "*",
        "role": "operator",
        "action": {"kind": "stop"},
        "who": "ada",
        "epoch": clock.epoch,
        "issued_s": clock.hub_s,
        "expires_s": clock.hub_s + 2.0,
    }
    return FleetCommand(**(values | changes))


def test_a_command_is_executed_once_and_a_retry_has_its_answer(clock: Clock, book: CommandBook) -> None:
    done: list[str] = []
    stop = command(clock)
    first = book.run(stop, lambda: done.append("stop") or "at rest")  # type: ignore[func-returns-value]
    again = book.run(stop, lambda: done.append("again") or "at rest")  # type: ignore[func-returns-value]
    assert (first.code, first.text, first.repeated) == ("ok", "at rest", False)
    assert again == first.model_copy(update={"repeated": True})
    assert done == ["stop"]


def test_a_retry_waits_for_the_first_try(clock: Clock, book: CommandBook) -> None:
    begun, go = threading.Event(), threading.Event()
    stop = command(clock)

    def slowly() -> str:
        begun.set()
        assert go.wait(20.0)
        return "at rest"

    thread = threading.Thread(target=book.run, args=(stop, slowly))
    thread.start()
    assert begun.wait(20.0)
    threading.Timer(0.05, go.set).start()
    assert book.run(stop, lambda: pytest.fail("executed twice")).repeated
    thread.join()


def test_an_error_is_the_answer_of_the_retry_too(clock: Clock, book: CommandBook) -> None:
    def fail() -> str:
        raise UnavailableError("it still moves")

    stop = command(clock)
    assert book.run(stop, fail).code == "unavailable"
    again = book.run(stop, lambda: pytest.fail("executed twice"))
    assert (again.code, again.text, again.repeated) == ("unavailable", "it still moves", True)


@pytest.mark.parametrize(
    ("changes", "code", "words"),
    [
        ({"issued_s": 1490.0, "expires_s": 1499.0}, "conflict", "1.0 s late and was not executed"),
        ({"issued_s": 1560.0, "expires_s": 1562.0}, "conflict", "60.0 s later than the hub's time"),
        ({"expires_s": 1500.0}, "input", "0 s after issued_s, allowed: more than 0 and up to 60 s"),
        ({"expires_s": 1561.0}, "input", "61 s after issued_s"),
        ({"epoch": "bbbbbbbbbbbbbbbb"}, "conflict", "is not the epoch of the current hub"),
        ({"issued_s": 1499.0, "action": {"kind": "pause"}}, "conflict", "issued before this cell joined"),
    ],
)
def test_a_command_with_wrong_times_is_not_executed(
    clock: Clock, book: CommandBook, changes: dict[str, Any], code: str, words: str
) -> None:
    answer = book.run(command(clock, **changes), lambda: pytest.fail("executed"))
    assert answer.code == code
    assert words in answer.text


def test_a_stop_from_before_the_cell_knew_the_time_is_executed(clock: Clock, book: CommandBook) -> None:
    assert book.run(command(clock, issued_s=1499.0), lambda: "at rest").code == "ok"


def test_a_replayed_command_is_late_after_its_deadline(clock: Clock, book: CommandBook) -> None:
    stop = command(clock)
    assert book.run(stop, lambda: "at rest").code == "ok"
    clock.s += 3.5
    assert book.run(command(clock, id="another-1"), lambda: "at rest").code == "ok"  # forgets the first one
    assert "late" in book.run(stop, lambda: pytest.fail("executed twice")).text


def test_a_retry_with_a_later_deadline_is_answered_as_the_first_try(clock: Clock, book: CommandBook) -> None:
    first = command(clock)
    assert book.run(first, lambda: "at rest").code == "ok"
    later = first.model_copy(update={"expires_s": first.expires_s + 1.0})
    answer = book.run(later, lambda: pytest.fail("executed"))
    assert (answer.code, answer.text, answer.repeated) == ("ok", "at rest", True)


def test_another_command_with_a_used_id_is_not_executed(clock: Clock, book: CommandBook) -> None:
    assert book.run(command(clock), lambda: "at rest").code == "ok"
    answer = book.run(command(clock, who="eve"), lambda: pytest.fail("executed"))
    assert "already used this id" in answer.text


def test_the_round_trip_counts_against_a_command_that_may_be_late(clock: Clock) -> None:
    book = CommandBook("cell", "arm", clock.ask, clock)  # type: ignore[arg-type]
    clock.round_trip_s = 0.5
    book.synchronize()
    # The hub's clock is 1500.0 when it is read, and 1500.5 or less when the answer arrives.
    assert book.run(command(clock, issued_s=1500.0, expires_s=1500.4), lambda: "").code == "conflict"
    assert book.run(command(clock, id="another-1", issued_s=1500.0), lambda: "").code == "ok"


def test_a_message_of_another_kind_is_executed_once_too(clock: Clock) -> None:
    deadlines = Deadlines(clock.ask, clock)  # type: ignore[arg-type]
    deadlines.synchronize()
    seen, message = SeenMessages(deadlines), command(clock)
    seen.require_new(message)
    with pytest.raises(ConflictError, match="was executed before"):
        seen.require_new(message)
    clock.s += 3.0
    with pytest.raises(ConflictError, match=r"is 1.0 s late"):
        seen.require_new(message)


def test_without_the_hubs_time_nothing_is_executed(clock: Clock) -> None:
    clock.answers = False
    book = CommandBook("cell", "arm", clock.ask, clock)  # type: ignore[arg-type]
    answer = book.run(command(clock), lambda: pytest.fail("executed"))
    assert (answer.code, answer.text[:31]) == ("unavailable", "the hub does not send its time,")


def test_a_new_hub_is_asked_for_its_time(clock: Clock, book: CommandBook) -> None:
    clock.epoch = "cccccccccccccccc"
    assert book.run(command(clock), lambda: "at rest").code == "ok"


def test_the_number_of_remembered_commands_is_bounded(clock: Clock, book: CommandBook) -> None:
    for number in range(MAX_COMMANDS):
        assert book.run(command(clock, id=f"number-{number}"), lambda: "").code == "ok"
    answer = book.run(command(clock), lambda: pytest.fail("executed"))
    assert "allowed: 1000" in answer.text
    clock.s += 3.5
    assert book.run(command(clock), lambda: "at rest").code == "ok"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "FleetCommand: "),
        (b"\xff\xfe", "FleetCommand: "),
        (b'{"id": "12345678"}', "action"),
        (b"[" * 10_000, "FleetCommand: "),
        (b" " * (MAX_BYTES + 1), "65537 bytes, allowed: 65536"),
        (
            command(Clock()).model_dump_json().replace("stop", "start").encode(),
            "action.start.program: is missing",
        ),
        (command(Clock()).model_dump_json().replace("1500.0", "NaN").encode(), "FleetCommand: "),
        (command(Clock()).model_dump_json().replace('"ada"', '"a\\nb"').encode(), "who: "),
    ],
)
def test_what_is_no_command_is_an_error_with_a_reason(content: bytes, words: str) -> None:
    with pytest.raises(InputError, match="FleetCommand") as caught:
        read(FleetCommand, content)
    assert words in str(caught.value)
