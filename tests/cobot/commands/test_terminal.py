"""Colours, tables and the bar, as a terminal and a pipe get them."""

from __future__ import annotations

import io
import sys
import time

import pytest

from cobot.commands.terminal import ERASE_LINE, Bar, show, show_columns


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True

    def screen(self) -> str:
        """The characters of the current line that a terminal shows: those after the last erasure."""
        return self.getvalue().rsplit(ERASE_LINE, 1)[-1]


def use_terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """Put a terminal with 80 columns in the place of stdout and of stderr."""
    terminal = Terminal()
    monkeypatch.setattr(sys, "stdout", terminal)
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    return terminal


def test_a_style_is_for_terminals_that_want_colours(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The oracles are ECMA-48 (31 is red) and the convention of no-color.org."""
    terminal = use_terminal(monkeypatch)
    show("stopped", "red")
    assert terminal.getvalue() == "\x1b[31mstopped\x1b[0m\n"
    monkeypatch.setenv("NO_COLOR", "1")
    show("plain", "red")
    monkeypatch.delenv("NO_COLOR")
    monkeypatch.setenv("TERM", "dumb")
    show("plain", "red")
    assert terminal.getvalue().endswith("\nplain\nplain\n")


def test_a_pipe_gets_no_escape_sequence_and_no_bar(capsys: pytest.CaptureFixture[str]) -> None:
    show("stopped", "bold red")
    with Bar(shown=True).showing("moving") as bar:
        bar.update(1.0, 2.0)
    assert capsys.readouterr() == ("stopped\n", "")


def test_columns_are_aligned_also_with_characters_of_two_cells(capsys: pytest.CaptureFixture[str]) -> None:
    show_columns(("joint", "rad"), [("关节", "-1.5"), ("elbow", "12.25")], right=1)
    assert capsys.readouterr().out == "joint    rad\n关节    -1.5\nelbow  12.25\n"


def test_a_table_without_rows_is_its_heading(capsys: pytest.CaptureFixture[str]) -> None:
    show_columns(("job", "robot"), [], right=2)
    assert capsys.readouterr().out == "job  robot\n"


def test_the_bar_shows_the_part_that_is_done_and_the_time_that_is_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A quarter took 30 s, so three quarters take 90 s."""
    terminal, now_s = use_terminal(monkeypatch), [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now_s[0])
    with Bar(shown=True).showing("moving") as bar:
        assert terminal.screen() == "moving"
        now_s[0] += 30.0
        bar.update(1.0, 4.0)
        assert terminal.screen() == f"moving {'█' * 10}{'░' * 30}  25% 1:30"
        bar.update(9.0, 4.0, "there")
        assert terminal.screen() == f"there {'█' * 40} 100% 0:00"
        bar.update(0.0, 4.0)
        assert terminal.screen().endswith("  0% -:--")
        bar.erase()
        assert terminal.screen() == ""
        bar.update(1.0, 2.0, "x" * 200)
        assert terminal.screen() == "x" * 79
    assert terminal.screen() == ""


def test_a_bar_that_is_not_wanted_is_not_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = use_terminal(monkeypatch)
    with Bar(shown=False).showing("moving") as bar:
        bar.update(1.0, 2.0)
    assert terminal.getvalue() == ""
