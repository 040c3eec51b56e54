"""`cobot run` under the limits of a shell: it says what is missing, or works; it never hangs.

Each limit is one that the kernel keeps (setrlimit), as `ulimit` sets it. Nothing is left behind.
"""

from __future__ import annotations

import resource
import signal
import subprocess
from pathlib import Path

import httpx
import pytest
from running import WAIT_S, Run

HOME = {"name": "home"}


class LimitedRun(Run):
    """Under a limit from its beginning."""

    def __init__(self, folder: Path, limit: int, value: int) -> None:
        self._limit, self._value = limit, value
        super().__init__(folder)

    def start(self) -> subprocess.Popen[str]:
        soft, hard = resource.getrlimit(self._limit)
        resource.setrlimit(self._limit, (self._value, hard))  # what is started inherits it
        try:
            return super().start()
        finally:
            resource.setrlimit(self._limit, (soft, hard))


def test_sixty_four_descriptors_are_enough(tmp_path: Path) -> None:
    """And it is said, and answered, when clients have taken them all."""
    run = LimitedRun(tmp_path, resource.RLIMIT_NOFILE, 64)
    try:
        run.until(run.healthy)
        assert httpx.post(f"{run.url}/robot/move/named", json=HOME, timeout=WAIT_S).json()["success"]
    finally:
        run.process.send_signal(signal.SIGINT)
        run.process.send_signal(signal.SIGINT)
        assert run.process.wait(WAIT_S) == 0
    assert "Traceback" not in run.output
    assert not run.memory.exists()


@pytest.mark.parametrize(
    ("limit", "value", "words"),
    [
        (resource.RLIMIT_NOFILE, 8, "raise the limit (ulimit -n)"),
        (resource.RLIMIT_AS, 300_000 * 1024, "raise the limit of memory (ulimit -v)"),
        (resource.RLIMIT_FSIZE, 2**20, "raise the limit of the size of files (ulimit -f)"),
    ],
    ids=["descriptors", "memory", "file size"],
)
def test_a_limit_that_is_too_low_is_a_sentence_with_what_to_do(
    tmp_path: Path, limit: int, value: int, words: str
) -> None:
    run = LimitedRun(tmp_path, limit, value)
    assert run.process.wait(WAIT_S) != 0
    run.until(lambda: words in run.output)
    assert "Traceback" not in run.output
    assert not run.memory.exists()
