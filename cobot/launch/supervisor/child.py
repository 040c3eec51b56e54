"""A process that is restarted whenever it ends."""

from __future__ import annotations

import logging
import os
import signal
import subprocess
import threading
import time
from dataclasses import dataclass, field

from cobot.errors import exhausted
from cobot.launch.forked import Forked
from cobot.launch.running_config import ProcessState
from cobot.logs.process import SUPERVISED
from cobot.logs.supervision import SupervisorLog

FIRST_BACKOFF_S = 0.2
QUICK = 3
"""Number of consecutive restarts after the first pause. After them, each pause is twice as long as the
previous one.
"""
MAX_BACKOFF_S = 5.0
STEADY_S = 10.0
"""Lifetime after which a process is trusted again, in seconds. Its next restart then begins with the first
pause.
"""

log = logging.getLogger("cobot")


@dataclass
class Child:
    """A process that is restarted whenever it ends.

    Attributes:
        blank: a forked process that already exists. It is used for the first start.
        failures: number of deaths and failed starts since the process was last trusted.
    """

    name: str
    command: list[str]
    log: SupervisorLog
    descriptors: tuple[int, ...] = ()
    environment: dict[str, str] = field(default_factory=dict, repr=False)
    blank: Forked | None = None
    process: subprocess.Popen[bytes] | Forked | None = None
    started_s: float = 0.0
    failures: int = 0
    restart_at_s: float = 0.0
    restarts: int = 0
    line: str = ""
    reader: threading.Thread | None = field(default=None, repr=False)

    def start(self) -> None:
        read_end, write_end = os.pipe()
        # Output that C libraries and the interpreter print goes past the process's log. If this thread does
        # not read it, such output is lost and blocks nothing.
        os.set_blocking(write_end, False)
        output = os.fdopen(read_end, "rb")
        environment = {**self.environment, SUPERVISED: "1"}
        blank, self.blank = self.blank, None
        try:
            if blank is not None and blank.become(self.command, write_end, self.descriptors, environment):
                self.process = blank
            else:
                self.process = subprocess.Popen(
                    self.command,
                    stdin=subprocess.DEVNULL,
                    stdout=write_end,
                    stderr=write_end,
                    pass_fds=self.descriptors,
                    env={**os.environ, **environment},
                    start_new_session=True,  # Ctrl-C reaches only the supervisor, which stops the arm first
                )
        except BaseException:
            output.close()
            raise
        finally:
            os.close(write_end)
        self.started_s = time.monotonic()
        try:
            self.reader = self.log.follow(self.name, output, self._keep_last_line)
        except RuntimeError:  # no memory is left for a thread
            self.process.kill()
            self.process.wait()
            raise

    def _keep_last_line(self, line: str) -> None:
        self.line = line

    def last_line(self) -> str:
        """The last line of a process that has ended."""
        if self.reader is not None:
            self.reader.join(1.0)
        return self.line or "it printed nothing"

    @property
    def state(self) -> ProcessState:
        return ProcessState(self.process.pid if self.process is not None else 0, self.restarts)

    @property
    def backoff_s(self) -> float:
        """The pause before the next start."""
        longer = min(max(0, self.failures - QUICK), 16)
        return min(FIRST_BACKOFF_S * 2.0**longer, MAX_BACKOFF_S)

    def ask_to_end(self) -> None:
        if self.process is not None:
            self.process.terminate()

    def end(self, timeout_s: float) -> None:
        """Ask the process to end, and kill it if it has not ended after a timeout."""
        if self.process is None:
            return
        self.ask_to_end()
        try:
            self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            log.error(
                "%s (pid %d) did not end within %.0f s and is killed", self.name, self.process.pid, timeout_s
            )
            self.process.kill()
            self.process.wait()
        if self.reader is not None:
            self.reader.join(1.0)

    def ensure_running(self) -> None:
        """Restart the process, after a pause, if it has ended. The pause grows with each failure until the
        process has lived for `STEADY_S`.
        """
        assert self.process is not None
        status = self.process.poll()
        now_s = time.monotonic()
        if status is None:
            if now_s - self.started_s > STEADY_S:
                self.failures = 0
        elif self.restart_at_s <= self.started_s:  # its end has not been reported yet
            self.failures += status != 0
            self.restart_at_s = now_s + self.backoff_s
            self._tell_end(self.process.pid, status)
        elif now_s >= self.restart_at_s:
            self._try_again(now_s)

    def _tell_end(self, pid: int, status: int) -> None:
        if status == 0:
            log.info("%s (pid %d) has ended as requested and is restarted", self.name, pid)
            return
        cause = signal.Signals(-status).name if status < 0 else f"status {status}"
        log.error("%s (pid %d) ended: %s; restart in %.1f s", self.name, pid, cause, self.backoff_s)

    def _try_again(self, now_s: float) -> None:
        try:
            self.start()
            self.restarts += 1
        except (OSError, RuntimeError) as exc:  # RuntimeError: a thread cannot be started
            cause = exhausted(exc) or exc
            self.failures += 1
            log.error("%s cannot be started: %s; next attempt in %.1f s", self.name, cause, self.backoff_s)
            self.restart_at_s = now_s + self.backoff_s
