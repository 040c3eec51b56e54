"""What the commands print."""

from __future__ import annotations

from cobot.commands.screen import event_line


def test_an_event_is_a_line_without_what_is_empty_and_a_warning_has_a_colour() -> None:
    event = {"time": "2026-11-25T16:55:37.897123+00:00", "robot": None, "type": "refused"}
    data = {"by": "ada", "what": "POST /stop", "status": None, "reason": "", "count": 0}
    line = event_line(event | {"data": data})
    assert line.plain == "16:55:37.897 - refused by=ada what=POST /stop count=0"
    assert line.style == "yellow"
    assert not event_line(event | {"type": "job", "data": {}}).style
