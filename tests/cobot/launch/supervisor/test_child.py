"""A process that has died and cannot be started again at once, for want of descriptors or memory."""

from __future__ import annotations

import errno
import logging
import os
import time
from itertools import pairwise
from typing import Any

import pytest

from cobot.launch.supervisor.child import FIRST_BACKOFF_S, MAX_BACKOFF_S, QUICK, Child


class Dead:
    """A process that was killed."""

    pid = 4711
    returncode = -9

    def poll(self) -> int:
        return self.returncode


def test_a_start_that_fails_is_tried_again_with_growing_pauses(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    now_s, starts_s = 1000.0, []
    monkeypatch.setattr(time, "monotonic", lambda: now_s)

    def refuse(child: Child) -> None:
        starts_s.append(now_s)
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    monkeypatch.setattr(Child, "start", refuse)
    child: Any = object.__new__(Child)
    child.__dict__.update(name="rtloop", process=Dead(), started_s=990.0, failures=0, restart_at_s=0.0)
    with caplog.at_level(logging.ERROR, "cobot"):
        for _ in range(400):
            child.ensure_running()
            now_s += 0.1
    pauses_s = [round(after - before, 3) for before, after in pairwise(starts_s)]
    assert len(pauses_s) >= 8
    assert pauses_s[: QUICK - 1] == [pytest.approx(FIRST_BACKOFF_S, abs=0.11)] * (QUICK - 1)
    assert pauses_s == sorted(pauses_s)
    assert pauses_s[-1] <= MAX_BACKOFF_S + 0.11
    assert "rtloop cannot be started: no file descriptor is left" in caplog.text
