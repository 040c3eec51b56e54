"""What a process asks of Linux. Oracle: Linux's own account in /proc."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from cobot.launch.process import AUTOGROUP, Niceness

SAYS = """
import os
from pathlib import Path
from cobot.launch.process import AUTOGROUP, Niceness, be
be(Niceness.{niceness}, session={session})
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
