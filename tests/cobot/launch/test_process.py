"""What a process asks of Linux. Oracle: Linux's own account in /proc."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from cobot.launch import process
from cobot.launch.process import AUTOGROUP, Niceness, as_command, set_niceness

SAYS = """
import os
from pathlib import Path
from cobot.launch.process import AUTOGROUP, Niceness, set_niceness
set_niceness(Niceness.{niceness}, session={session})
print(os.nice(0), AUTOGROUP.read_text() if os.access(AUTOGROUP, os.W_OK) else "")
"""


@pytest.mark.parametrize(("asked", "own_session"), [(True, True), (True, False), (False, True)])
@pytest.mark.parametrize("niceness", list(Niceness))
def test_what_answers_people_comes_before_other_sessions_too(
    niceness: Niceness, asked: bool, own_session: bool
) -> None:
    """Only what root, or CAP_SYS_NICE, may have; and the session of somebody else is left alone."""
    done = subprocess.run(
        [sys.executable, "-c", SAYS.format(niceness=niceness.name, session=asked)],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        start_new_session=own_session,
    )
    mine, _, session = done.stdout.strip().partition(" ")
    permitted = int(mine) == niceness
    assert permitted or (int(mine) == os.nice(0) > niceness)
    if not own_session:
        assert not session or session == AUTOGROUP.read_text(encoding="ascii").strip()
    elif session:  # empty where Linux has no such groups, or one may not be changed
        assert int(session.split()[-1]) == (niceness if permitted and asked else 0)


@pytest.mark.parametrize(("ends", "status"), [(BrokenPipeError(), 0), (KeyboardInterrupt(), 130)])
def test_a_command_ends_without_a_traceback(
    ends: BaseException, status: int, capfd: pytest.CaptureFixture[str]
) -> None:
    """As in `cobot study show FOLDER | head -1`, and after Ctrl-C."""

    def fail() -> int:
        raise ends

    stdout = os.dup(1)
    try:
        assert as_command(fail) == status
    finally:
        os.dup2(stdout, 1)
        os.close(stdout)
    assert "Traceback" not in capfd.readouterr().err


def test_a_session_asks_again_where_linux_takes_no_more_for_now(monkeypatch: pytest.MonkeyPatch) -> None:
    """As from two processes of a container that start in the same tenth of a second: sched(7)."""
    answers = [BlockingIOError(), BlockingIOError(), 2]
    asked = []

    def write(_: Path, text: str, encoding: str) -> int:
        asked.append(text)
        answer = answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    monkeypatch.setattr(Path, "write_text", write)
    monkeypatch.setattr(process, "AUTOGROUP_PAUSE_S", 0.0)
    monkeypatch.setattr(os, "setpriority", lambda *_: None)
    monkeypatch.setattr(os, "getsid", lambda _: os.getpid())
    set_niceness(Niceness.BACKGROUND, session=True)
    assert asked == ["10", "10", "10"]
