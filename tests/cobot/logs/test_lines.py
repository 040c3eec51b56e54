"""Lines of the log: one line each, whatever is in them.

Oracle: str.splitlines and str.isprintable of Python, json.
"""

from __future__ import annotations

import json
import logging

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cobot.logs import add_ids, bind, log_context, printable
from cobot.logs.lines import MAX_MESSAGE, RECORD_SEPARATOR, Line, separated

FORGERIES = (
    "\n2026-11-22T00:00:00.000+00:00 INFO service: motion 7: arrived",
    "\r2026-11-22 the cursor goes back",
    "\x1b[2J\x1b[H cleared",
    "\x9b31m one byte for an escape",
    "\u2028line separator\u2029paragraph separator\x85next line\x0bvertical tab\x0cform feed",
    "\u202eesrever\u2066\u2069\u200b\ufeff",
    "\x1e" + '{"process": "service", "message": "forged"}',
    "\x00\x07\x08\x7f\ud800",
)


def line(message: str, **ids: str) -> Line:
    return Line(0.0, "INFO", "service", "cobot.test", printable(message), ids)


def record(message: str, *arguments: object, exc: BaseException | None = None) -> logging.LogRecord:
    information = (type(exc), exc, exc.__traceback__) if exc else None
    return logging.LogRecord("cobot.test", logging.INFO, __file__, 1, message, arguments, information)


@pytest.mark.parametrize("text", FORGERIES)
def test_whatever_a_client_sends_is_one_line_without_control(text: str) -> None:
    made = Line.of(record("a client says %s", text), "service")
    for written in (made.text(), made.text(timed=False), made.json()):
        decoded = written.decode()
        assert decoded.endswith("\n")
        assert decoded[:-1].isprintable()
        assert len(decoded.splitlines()) == 1


@given(st.text(max_size=300))
def test_all_text_is_printable_and_bounded(text: str) -> None:
    assert printable(text).isprintable()
    assert len(printable(text, 20)) < 60
    if text.isprintable():
        assert printable(text) == text


def test_a_long_line_is_cut_and_says_how_long_it_was() -> None:
    message = Line.of(record("x" * 1_000_000), "service").message
    assert len(message) < MAX_MESSAGE + 50
    assert message.endswith("... (1000000 characters)")


@pytest.mark.parametrize("text", FORGERIES)
def test_an_exception_can_forge_no_line(text: str) -> None:
    try:
        raise ValueError(text)
    except ValueError as exc:
        made = Line.of(record("it failed", exc=exc), "service")
    first, *others = made.text().decode().splitlines()
    assert first.endswith("service: it failed")
    assert others
    assert all(other.startswith("    | ") and other.isprintable() for other in others)
    assert "Traceback" in others[0]


@given(st.binary(max_size=200))
def test_what_a_process_prints_is_one_line_of_its_own(text: bytes) -> None:
    """Whatever it is: text, half a line, JSON of another kind."""
    for piece in separated(text.replace(b"\n", b"")):
        written = Line.parsed(piece, "rtloop").text(timed=False).decode()
        assert written.startswith("rtloop")
        assert written[:-1].isprintable()


@pytest.mark.parametrize("sent", ["{}", "[]", "1", '{"process": 1, "time": ""}', "[" * 100_000])
def test_json_that_is_no_line_is_text(sent: str) -> None:
    made = Line.parsed(RECORD_SEPARATOR + sent.encode(), "service")
    assert (made.process, made.logger) == ("service", "output")


def test_a_line_survives_the_way_to_the_supervisor() -> None:
    sent = Line(
        1e9, "ERROR", "service", "cobot.x", "µ failed", {"request": "a", "motion": "3"}, ["one", "two"]
    )
    assert Line.parsed(sent.wire(), "service") == sent
    assert Line.parsed(sent.wire(), "rtloop").process == "rtloop, service"


def test_a_line_that_is_written_into_another_is_found() -> None:
    pieces = separated(b"half of a line" + line("whole").wire())
    assert [Line.parsed(piece, "service").message for piece in pieces] == ["half of a line", "whole"]


def test_json_has_one_object_per_line_with_its_ids() -> None:
    content = json.loads(line('"quoted" \\ µ', request="r-1", motion="7").json())
    assert content["message"] == '"quoted" \\ µ'
    assert (content["request"], content["motion"], content["level"]) == ("r-1", "7", "INFO")
    assert content["time"] == "1970-01-01T00:00:00.000+00:00"


def test_the_ids_are_those_of_the_present_context() -> None:
    with add_ids(request="r-1\n", client="::1"):
        bind(motion=3)
        made = Line.of(record("x"), "service")
        bind(motion=None)
        assert "motion" not in log_context.get()
    assert made.ids == {"request": r"r-1\n", "client": "::1", "motion": "3"}
    assert made.text().endswith(b"x [request=r-1\\n motion=3]\n")
    assert log_context.get() == {}


def test_a_line_whose_arguments_do_not_fit_is_said_all_the_same() -> None:
    assert "cannot be formatted" in Line.of(record("%d things", "no number"), "service").message
