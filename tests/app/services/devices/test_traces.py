"""Messages for people. Oracle: a plain list of all that was added; the log as pytest catches it."""

from __future__ import annotations

import logging

import pytest

from app.services.devices.traces import CAPACITY, MAX_CHARACTERS, Level, Message, Traces


def test_the_newest_messages_are_kept_and_numbered() -> None:
    traces = Traces()
    added = [traces.add("text", str(n)) for n in range(CAPACITY + 5)]
    assert [message.number for message in added] == list(range(1, CAPACITY + 6))
    assert traces.newest(2 * CAPACITY) == added[5:]
    assert traces.newest(3) == added[-3:]
    assert traces.newest(0) == []
    assert traces.newest(10, after=CAPACITY + 3) == added[-2:]


def test_each_message_is_logged_and_told(caplog: pytest.LogCaptureFixture) -> None:
    traces, heard = Traces(), list[Message]()
    traces.listeners.append(heard.append)
    with caplog.at_level(logging.INFO, "cobot.trace"):
        traces.add("alarm", "the door is open", Level.ERROR, code=7, title="Door")
        traces.warn("force control has ended")
    assert [(message.kind, message.level, message.code) for message in heard] == [
        ("alarm", Level.ERROR, 7),
        ("text", Level.WARNING, 0),
    ]
    assert [(record.levelno, record.getMessage()) for record in caplog.records] == [
        (logging.ERROR, "Door: the door is open"),
        (logging.WARNING, "force control has ended"),
    ]


def test_a_long_message_is_cut_and_one_that_looks_like_a_format_is_not_one() -> None:
    traces = Traces()
    assert len(traces.add("text", "x" * (2 * MAX_CHARACTERS)).text) == MAX_CHARACTERS
    assert traces.add("text", "100 %s %d", title="50 %").text == "100 %s %d"
