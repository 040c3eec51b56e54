"""The pool of processes. Oracles: Python's own pool of threads; the kernel's list of processes."""

from __future__ import annotations

import contextlib
import operator
import os
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from cobot.errors import LimitError
from cobot.studies import LocalPool, LostWorkerError

KILL = "__import__('os').kill(__import__('os').getpid(), 9)"


def test_the_pool_computes_what_a_pool_of_threads_does() -> None:
    with LocalPool(2) as ours, ThreadPoolExecutor(2) as theirs:
        assert list(ours.map(pow, range(20), range(20))) == list(theirs.map(pow, range(20), range(20)))
        assert ours.submit(int, "ff", base=16).result() == 255


def test_an_error_of_a_call_is_raised_for_its_caller_alone() -> None:
    with LocalPool(1) as pool:
        bad, good = pool.submit(operator.truediv, 1, 0), pool.submit(operator.truediv, 6, 3)
        assert good.result() == 2.0
        with pytest.raises(ZeroDivisionError):
            bad.result()


def test_the_errors_of_cobot_keep_their_class_and_text() -> None:
    with LocalPool(1) as pool, pytest.raises(LimitError, match="too far"):
        pool.submit(exec, "from cobot.errors import LimitError; raise LimitError('too far')").result()


def test_a_killed_worker_fails_its_own_call_and_is_replaced() -> None:
    with LocalPool(2) as pool:
        lost = pool.submit(eval, KILL)
        with pytest.raises(LostWorkerError, match="SIGKILL"):
            lost.result()
        assert list(pool.map(abs, range(-5, 0))) == [5, 4, 3, 2, 1]


def test_idle_workers_that_are_killed_are_replaced() -> None:
    with LocalPool(2) as pool:
        list(pool.map(abs, range(4)))
        for pid in pool.pids:
            os.kill(pid, signal.SIGKILL)
            with contextlib.suppress(ChildProcessError):  # the pool has noticed it already
                os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
        assert list(pool.map(abs, [-1, -2, -3])) == [1, 2, 3]


def test_what_a_call_prints_is_not_in_the_answer(capfd: pytest.CaptureFixture[str]) -> None:
    with LocalPool(1) as pool:
        pool.submit(print, "a note", flush=True).result()
    assert tuple(capfd.readouterr()) == ("", "a note\n")


def test_no_process_is_left_behind() -> None:
    with LocalPool(2) as pool:
        list(pool.map(abs, range(4)))
        pids = pool.pids
        assert pids
    assert not any(Path(f"/proc/{pid}").exists() for pid in pids)


def test_calls_that_have_not_begun_can_be_cancelled_and_running_ones_end_with_the_pool() -> None:
    pool = LocalPool(1)
    running = pool.submit(time.sleep, 600.0)
    waiting = pool.submit(abs, -1)
    assert waiting.cancel()
    pool.shutdown(cancel_futures=True)
    assert running.done()
    with pytest.raises(RuntimeError, match="has been shut down"):
        pool.submit(abs, -1)


def test_workers_that_die_at_once_are_not_started_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", "/nowhere")
    monkeypatch.setenv("PYTHONHOME", "/nowhere")
    with LocalPool(1) as pool, pytest.raises(Exception, match="5 worker processes in a row died"):
        pool.submit(abs, -1).result()


def test_a_pool_needs_a_worker() -> None:
    with pytest.raises(ValueError, match="workers is 0"):
        LocalPool(0)
