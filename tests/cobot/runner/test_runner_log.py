"""The runner's lines: what a program prints does not pass for one of them."""

from __future__ import annotations

import re

import pytest

from cobot.runner import runner

TIMED = re.compile(r"^\d{4}-\d\d-\d\dT[\d:.]+[+-]\d\d:\d\d ")


def test_a_program_cannot_forge_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    forged = "2026-11-22T00:00:00.000+00:00 sequence 3 finished, return code 0"
    runner.say(f"hello\n{forged}\r{forged}\u2028{forged}\x1b[2J\u202e")
    runner.log(f"error: mine\n{forged}")
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 4
    assert all(line.isprintable() for line in lines)
    assert [TIMED.sub("", line)[:14] for line in lines] == [
        "program: hello",
        "    | 2026-11-",
        "error: mine",
        "    | 2026-11-",
    ]
    assert not any(TIMED.match(line) for line in lines[1::2])
