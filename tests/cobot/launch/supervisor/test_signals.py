"""Signals to the supervisor: as many as somebody sends, as close together as they come."""

from __future__ import annotations

import subprocess
import sys

SCRIPT = """
import os, signal, sys
from cobot.launch.supervisor.signals import ProcessSignals

signals = ProcessSignals()
depth = 0

def interrupt(frame, event, argument):
    global depth
    if frame.f_code.co_filename == "<string>" or depth >= 20:
        return None
    depth += 1
    os.kill(os.getpid(), signal.SIGINT)  # in the middle of what the last one has brought about
    return interrupt

with signals.catch():
    sys.settrace(interrupt)
    os.kill(os.getpid(), signal.SIGINT)
    sys.settrace(None)
assert depth > 2, depth
assert signals.stopping
print("stopping")
"""


def test_a_signal_in_the_middle_of_the_last_one_does_not_stop_the_stop() -> None:
    """As of `timeout -s INT`, which signals a process and its group, or of who presses Ctrl-C twice."""
    command = [sys.executable, "-c", SCRIPT]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.stdout == "stopping\n", done.stderr
