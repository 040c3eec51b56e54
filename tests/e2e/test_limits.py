"""`cobot run` under the limits of a shell: it says what is missing, or works; it never hangs.

Nothing is left behind.
"""

from __future__ import annotations

import signal
from pathlib import Path

import httpx
import pytest
from cobot_run import WAIT_S, Run
from thorough import few

HOME = {"name": "home"}


class LimitedRun(Run):
    """Started by a shell that has set a limit."""

    def __init__(self, folder: Path, limit: str) -> None:
        self._limit = limit
        super().__init__(folder)

    def command(self) -> list[str]:
        return ["sh", "-c", f'ulimit {self._limit}; exec "$@"', "sh", *super().command()]


def test_sixty_four_descriptors_are_enough(tmp_path: Path) -> None:
    """And it is said, and answered, when clients have taken them all."""
    run = LimitedRun(tmp_path, "-n 64")
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
    ("limit", "words"),
    few(
        [
            ("-n 20", "raise the limit (ulimit -n)"),
            ("-v 400000", "raise the memory limit (ulimit -v)"),
            ("-v 1048575", "may have 1048575 kB of address space here, but cobot needs 1048576: raise"),
            ("-f 1024", "raise the limit of the size of files (ulimit -f)"),
        ]
    ),
)
def test_a_limit_that_is_too_low_is_a_sentence_with_what_to_do(
    tmp_path: Path, limit: str, words: str
) -> None:
    run = LimitedRun(tmp_path, limit)
    assert run.process.wait(WAIT_S) == 1
    run.until(lambda: words in run.output)
    assert "Traceback" not in run.output
    assert not run.memory.exists()
