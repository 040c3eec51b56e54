"""The program itself, from its first import on."""

from __future__ import annotations

import subprocess
import sys

INTERRUPTED_AT_ITS_IMPORT = """
import runpy, sys

class Interruption:
    def find_spec(self, name, *_):
        if name == "cobot.config":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Interruption())
runpy.run_module("cobot", run_name="__main__")
"""


def test_who_interrupts_it_while_it_starts_is_not_shown_where() -> None:
    command = [sys.executable, "-c", INTERRUPTED_AT_ITS_IMPORT]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "cobot: interrupted\n")
