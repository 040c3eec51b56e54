"""What the commands print."""

from __future__ import annotations

import pytest

from cobot.commands.screen import MISSING, show_event, show_table, show_words


def test_an_event_is_a_line_without_empty_fields(capsys: pytest.CaptureFixture[str]) -> None:
    event = {"time": "2026-11-25T16:55:37.897123+00:00", "robot": None, "type": "refused"}
    data = {"by": "ada", "what": "POST /stop", "status": None, "reason": "", "count": 0}
    show_event(event | {"data": data})
    assert capsys.readouterr().out == "16:55:37.897 - refused by=ada what=POST /stop count=0\n"


def test_what_a_client_sent_cannot_control_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    """The oracle is `str.isprintable`, which is false for each control character."""
    event = {"time": "2026-11-25T16:55:37.897123+00:00", "robot": "iiwa", "type": "log"}
    show_event(event | {"data": {"message": "\x1b[2J\x1b]0;title\x07\r\nnext"}})
    show_table([{"id": "\x1b[31m"}], {"id": "job"})
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3
    assert all(map(str.isprintable, lines))


@pytest.mark.parametrize("forgotten", [0, 1, 2])
def test_what_a_program_prints_is_shown_once_and_nothing_of_the_runner(
    capsys: pytest.CaptureFixture[str], forgotten: int
) -> None:
    """Also where the service keeps no more than the newest lines."""
    old = ["T program: before", "T begun", "T program: before"]
    new = ["T program: one", "    | two", "    |   three", "T done", "    | of the runner", "T program: one"]
    show_words(old, (old + new)[forgotten:])
    assert capsys.readouterr().out == "one\ntwo\n  three\none\n"
    show_words(new, new)
    show_words([], [])
    assert not capsys.readouterr().out
    show_words(old, new)
    assert capsys.readouterr().out == f"{MISSING}\none\ntwo\n  three\none\n"
