"""A process that lives and does nothing any more: noticed by its heartbeat, and ended.

The service's heartbeat is a counter in shared memory that its event loop bumps, which rtloop watches too:
looking at it costs a read of eight bytes. When it stops for long, the process is ended, and started anew as
one that has died. What the arm does meanwhile is for rtloop to decide, long before.

A process that never began to beat is left alone: it may be loading, or be there to say why it cannot serve.
So is one that a debugger holds. One that SIGSTOP keeps from running is not: nobody can use the robot by it.
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
"""Of the time between two looks no more counts: where this process paused, the computer may have."""
LAST_WORDS_S = 1.0
"""So long a process may say where it stood, before it is killed."""

log = logging.getLogger("cobot")


class HeartbeatWatch:
    """Watches one process at a time, and its successor.

    Args:
        name: of the process, for people.
        beats: a number that is another one after each beat.
        timeout_s: without a beat for so long it hangs; None: for ever.
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
        """To be called again and again, with the process that there is now."""
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
        """End it, with a traceback of where it hangs in the log: faulthandler writes it on SIGABRT."""
        if is_traced(process.pid):
            self._silent_s = 0.0
            return
        self._asked = True
        log.error(
            "%s (pid %d) hangs%s: without a sign of life for %g s it is ended, and starts anew",
            self._name,
            process.pid,
            ", stopped by SIGSTOP" if is_stopped(process.pid) else "",
            self._timeout_s,
        )
        process.send_signal(signal.SIGABRT)
