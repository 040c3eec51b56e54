"""Ends a process that is alive but hangs, because its heartbeat has stopped.

The service's heartbeat is a counter of eight bytes in shared memory. The service's event loop increments it,
and rtloop also watches it. If the counter stops for long, the process is ended, and then restarted like one
that has ended on its own. Long before that, rtloop decides what the arm does.

A process that has never sent a heartbeat is not ended, because it may be loading, or may run only to report
why it cannot serve. A process with a debugger attached is not ended either. A process that SIGSTOP has
stopped is ended, because the robot cannot be used through it.
"""

from __future__ import annotations

import logging
import signal
import subprocess
import time
from collections.abc import Callable

from cobot.launch.forked import Forked
from cobot.launch.process import is_stopped, is_traced

MAX_STEP_S = 0.5
"""Maximum time that is counted between two checks, in seconds. If more time has passed, the computer may have
been paused.
"""
LAST_WORDS_S = 1.0
"""Time for a process to print its traceback before it is killed, in seconds."""

log = logging.getLogger("cobot")


class HeartbeatWatch:
    """Watches one process, and the process that replaces it after a restart.

    Args:
        name: process name for messages.
        beats: returns a number that changes with each heartbeat.
        timeout_s: time without a heartbeat after which the process is considered hung; None for no timeout.
    """

    def __init__(self, name: str, beats: Callable[[], int], timeout_s: float | None) -> None:
        self._name = name
        self._beats = beats
        self._timeout_s = timeout_s
        self._process: subprocess.Popen[bytes] | Forked | None = None
        self._beaten = 0
        self._has_begun = self._asked = False
        self._looked_s = self._silent_s = 0.0

    def look(self, process: subprocess.Popen[bytes] | Forked | None) -> None:
        """Check the current process. Call this periodically."""
        now_s, beaten = time.monotonic(), self._beats()
        step_s, self._looked_s = min(now_s - self._looked_s, MAX_STEP_S), now_s
        if process is not self._process:
            self._process, self._has_begun, self._asked = process, False, False
        elif beaten != self._beaten:
            self._has_begun, self._asked, self._silent_s = True, False, 0.0
        self._beaten = beaten
        if self._timeout_s is None or process is None or not self._has_begun or process.poll() is not None:
            return
        self._silent_s += step_s
        if self._silent_s > self._timeout_s + LAST_WORDS_S:
            process.kill()
        elif self._silent_s > self._timeout_s and not self._asked:
            self._end(process)

    def _end(self, process: subprocess.Popen[bytes] | Forked) -> None:
        """End the process. Before that, SIGABRT makes faulthandler write a traceback to the log, which shows
        where the process hangs.
        """
        if is_traced(process.pid):
            self._silent_s = 0.0
            return
        self._asked = True
        log.error(
            "%s (pid %d) hangs%s: no heartbeat for %g s; it is ended and restarted",
            self._name,
            process.pid,
            ", stopped by SIGSTOP" if is_stopped(process.pid) else "",
            self._timeout_s,
        )
        process.send_signal(signal.SIGABRT)
