"""What the tests of starting share."""

from __future__ import annotations

import logging
import signal
from collections.abc import Iterator

import pytest


@pytest.fixture
def signals_and_log() -> Iterator[None]:
    """As they were before a supervisor began."""
    numbers = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGCHLD)
    before = [signal.getsignal(number) for number in numbers]
    yield
    signal.set_wakeup_fd(-1)
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)
    log = logging.getLogger("cobot")
    for handler_of_log in log.handlers:
        handler_of_log.close()
    log.handlers.clear()
